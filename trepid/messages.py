"""Every message of Trepid, as frozen dataclasses: the one source of truth for fields, units and signs.

The ROS 2 types and their ``.msg`` text are derived from these classes (see :mod:`trepid.wire`).

Signs: ISO 8855, positive to the left. ``t_s`` is the capture time of the camera frame that a message goes
back to, carried unchanged from the frame to the command, so that age and latency can be read off anywhere.

Absence is explicit: ``None`` means "not detected" or "not known" (NaN on the wire). It is never 0.0 and never the
previous value.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType

from trepid.types import Image

PixelPath = tuple[tuple[float, float], ...]
"""Image polyline as (x, y) pixels of the input image, from the bottom up."""

SIGMA_AHEAD_M = (0.0, 5.0, 10.0, 20.0, 30.0, 40.0)
"""Distances ahead of the rear axle [m] at which an estimate states how well it knows the lane centre. They hold in
the reference world (:mod:`trepid.scale`); of a car at scale s they are s times as long."""


class Mode(StrEnum):
    """The driving mode that the supervisor demands."""

    KEEP = "KEEP"  # keep the lane at the planned speed
    CAUTION = "CAUTION"  # keep the lane, slower
    FOLLOW = "FOLLOW"  # no estimator detects the road: follow the path of the vehicle ahead
    STOP = "STOP"  # minimal-risk manoeuvre; latched until standstill


class Stop(StrEnum):
    """Deceleration that the supervisor demands: that of a STOP; in another mode until late messages are in time."""

    NONE = "none"
    COMFORT = "comfort"  # -1 m/s²
    EMERGENCY = "emergency"  # at most 4 m/s² (UN R157 minimal-risk manoeuvre limit)


class Limit(StrEnum):
    """The least of the speed caps of the supervisor, which is the speed cap of a decision."""

    UNKNOWN = ""  # not stated, as in older recordings
    CRUISE = "cruise"  # the cruise speed: nothing else limits the speed
    FEAR = "fear"
    RECOVERY = "recovery"  # fear has fallen, or the drive begins: the speed rises slowly
    PROCESS = "process"  # a process is lost whose loss means slower
    LEAD = "lead"  # the gap to the vehicle ahead, or its pace while it is followed
    ROAD_USER = "road_user"  # a person, cyclist or animal
    SIGHT = "sight"  # the way that the camera sees
    NETWORK = "network"  # the speed that a driving network proposes
    STOP = "stop"


@dataclass(frozen=True, slots=True, kw_only=True)
class Frame:
    """One camera frame (sensor_msgs/Image)."""

    t_s: float
    image: Image


@dataclass(frozen=True, slots=True, kw_only=True)
class CompressedFrame:
    """A camera frame as JPEG, for recorders and displays (sensor_msgs/CompressedImage)."""

    t_s: float
    jpeg: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class ImageStatistics:
    """Statistics of the pixels of a frame, from which its quality is rated."""

    t_s: float
    brightness: float  # mean grey level, 0..1
    contrast: float  # standard deviation of grey, 0..1
    over_exposed: float  # share of pixels at or near white, 0..1
    under_exposed: float  # share of pixels at or near black, 0..1
    sharpness: float  # variance of the Laplacian of grey in [0, 255]² units; small = blurred
    frozen_s: float  # time since the last image that is not a repetition [s]; 0 for a new image
    spots: float  # share of the tiles with a stationary dark spot, 0..1: dirt on the lens
    # distance from the rear axle, along the lane, up to which the image shows lane and ground; None: not known
    sight_m: float | None = None
    sight_sigma_m: float | None = None  # standard deviation of sight_m
    sight_cause: str = (
        ""  # cause that ends the sight (trepid.causes): fog, dark, over_exposed, crest, occluded; "": none
    )


class EstimateKind(StrEnum):
    """The quantity that an estimator measures."""

    LANE = "lane"  # the lane state; its road-wheel angle is computed from it
    ANGLE = "angle"  # the road-wheel angle alone; the lane state is None


@dataclass(frozen=True, slots=True, kw_only=True)
class SteeringEstimate:
    """The lane state measured by one estimator, and the road-wheel angle that a kinematic vehicle would need.

    The lane centre in the vehicle frame is the clothoid with offset, heading error, curvature and curvature
    rate below. ``curvature_1pm`` holds at ``lookahead_m`` ahead of the rear axle, so the curvature at the axle
    is ``curvature_1pm - curvature_rate_1pm2 * lookahead_m``.

    An estimate of kind ``ANGLE`` (a printed steering rule, a network trained on angles) carries only
    ``road_wheel_angle_rad``: its lane fields and its lane width are None, and ``confidence`` is that of the angle.
    """

    t_s: float
    estimator: str
    # rear-axle centre relative to the lane centre, + = vehicle left of centre
    lateral_offset_m: float | None = None
    heading_error_rad: float | None = None  # vehicle heading minus lane heading
    curvature_1pm: float | None = None  # lane curvature at the look-ahead, + = bends left
    curvature_rate_1pm2: float | None = None  # dκ/ds of the lane
    lookahead_m: float  # where curvature_1pm holds
    road_wheel_angle_rad: float | None = None  # atan(L·κ_cmd): free of speed and of understeer
    confidence: float  # 0..1, calibrated: 0 = no estimate; NaN: the newest frame cannot be used
    lanes_detected: int = 0  # detected boundaries of the ego lane: 0, 1 or 2
    lane_width_m: float | None = None
    latency_ms: float | None = None  # time spent on this estimate; filled by the shell, None in lock-step
    reason: str  # why there is no estimate or why confidence is low; "" without a reason
    left_boundary_px: PixelPath = ()
    right_boundary_px: PixelPath = ()
    marked: bool | None = None  # the boundaries are painted lines; False: edges of the road; None: not known
    kind: EstimateKind = EstimateKind.LANE  # the same for every message of an estimator
    # standard deviation of the lateral position of the lane centre at SIGMA_AHEAD_M; (): not known
    ahead_sigma_m: tuple[float, ...] = ()
    # that a driving network proposes, at least 0; it may only lower the speed of the car. None: no proposal
    speed_mps: float | None = None

    @property
    def has_boundaries(self) -> bool:
        """Whether boundaries are detected in the image or remembered; the width of others is a regression."""
        return self.lanes_detected > 0 or self.marked is not None

    @classmethod
    def nothing(
        cls,
        t_s: float,
        *,
        estimator: str,
        lookahead_m: float,
        reason: str,
        kind: EstimateKind = EstimateKind.LANE,
    ) -> "SteeringEstimate":
        """An estimate without lane and angle, and the reason."""
        return cls(
            t_s=t_s, estimator=estimator, lookahead_m=lookahead_m, confidence=0.0, reason=reason, kind=kind
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class LeadVehicle:
    """The vehicle ahead, relative to the rear axle of the ego vehicle."""

    t_s: float
    distance_m: float | None  # along x, from the front bumper of the ego vehicle to the rear of the other
    lateral_m: float | None  # + = left of the axis of the ego vehicle
    speed_mps: float | None
    confidence: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RoadUsers:
    """The people, cyclists and animals ahead: their ground points in the vehicle frame, one item each.

    ``detects`` names the kinds that the detector can find at all. The car is blind to a kind that is not named.
    """

    t_s: float
    kinds: tuple[str, ...] = ()  # "person", "cyclist", "animal"
    x_m: tuple[float, ...] = ()  # of the ground point, from the rear axle of the ego vehicle
    y_m: tuple[float, ...] = ()
    x_mps: tuple[float, ...] = ()  # velocity over ground, along the axes of the vehicle; NaN: not known yet
    y_mps: tuple[float, ...] = ()
    confidences: tuple[float, ...] = ()
    detects: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleState:
    """The measured state of the vehicle. ``t_s`` is the time of measurement."""

    t_s: float
    speed_mps: float | None
    road_wheel_angle_rad: float | None
    yaw_rate_radps: float | None
    driver_override: bool  # the driver steers: reported by the vehicle or detected by the limiter
    driver_torque_nm: float | None = None  # at the steering wheel, + = to the left; None: not measured
    saturated: bool | None = None  # the limiter cuts the steering demand continuously; None: not monitored
    # names of the fields that are None because their sender calls them invalid, or because physics contradicts them
    doubted: tuple[str, ...] = ()
    stop_pressed: bool = False  # a person stops the car: its stop button holds it


QUANTITIES: Mapping[str, str] = MappingProxyType(
    {
        "speed_mps": "speed",
        "road_wheel_angle_rad": "wheel angle",
        "yaw_rate_radps": "yaw rate",
        "driver_torque_nm": "driver torque",
    }
)
"""Field of VehicleState that may be doubted -> its name in texts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Odometry:
    """Motion measured by the driver of a car (nav_msgs/Odometry): the part that Trepid uses."""

    t_s: float
    speed_mps: float  # along x of the vehicle
    yaw_rate_radps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Decision:
    """The decision of the supervisor: fear and its cause, mode, path and speed."""

    t_s: float | None  # capture time of the newest frame; None: no frame yet
    decided_s: float  # time of the decision; a running supervisor also decides without frames
    mode: Mode
    stop: Stop
    fear: float  # 0..1
    level: str  # very_low, low, medium, high, very_high
    cause: str  # cause of the fear; "none" when calm
    part: str = ""  # part concerned: "camera", "lens", "traffic", "road", "vehicle", an estimator
    rules: tuple[str, ...] = ()  # the rules that fired, strongest first
    rule_strengths: tuple[float, ...] = ()
    inputs: tuple[str, ...] = ()  # names of the inputs of the rules ...
    # ... and their values, from which the rule file gives the same fear
    input_values: tuple[float | None, ...] = ()
    # The fused path, in the terms of SteeringEstimate and valid at path_t_s; all None when there is no path.
    path_t_s: float | None
    lateral_offset_m: float | None
    heading_error_rad: float | None
    curvature_1pm: float | None
    curvature_rate_1pm2: float | None
    lookahead_m: float
    path_source: str  # e.g. "cv+cnn", "cv", "memory", "lead", "none"
    sources: tuple[str, ...]  # estimator names …
    trust: tuple[float, ...]  # … and their weights in the fusion, sum 1 (empty without fusion)
    disagreement_mps2: float | None = None  # |Δκ_cmd|·v² between estimators, v a look-ahead a second
    sight_m: float | None = None  # distance from the rear axle that the car may rely on; None: not known
    sight_cause: str = ""  # cause that ends it (trepid.causes); "": none
    sight_cap_mps: float | None = None  # the speed from which the car stops within it; None: no limit
    # why the car stands or brakes to standstill, and what would end that; "": it may drive
    waits_for: str = ""
    road_user: str = ""  # kind of the road user that sets the speed cap, or is braked for hard; "": none
    road_user_m: float | None = None  # ... and its distance ahead of the front bumper
    lane_unseen_s: float | None = None  # since the newest frame with a lane; None: there was none so far
    lead_m: float | None = None  # distance of the vehicle ahead from the front bumper; None: none
    line_warning: str = (
        ""  # side of the edge of the lane that a wheel is about to cross: "left", "right"; "": none
    )
    line_crossing_s: float | None = (
        None  # until a wheel is over an edge; None: not known, or none comes to it
    )
    limited_by: Limit = Limit.UNKNOWN  # what sets the speed cap
    # last, because a recording is searched by the last bytes of its decisions (cockpit/logbook/recall.py)
    speed_factor: float  # 0..1, non-increasing in fear
    speed_cap_mps: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Command:
    """The command to the vehicle (ackermann_msgs/AckermannDriveStamped)."""

    t_s: float | None  # capture time of the underlying frame; None: no frame yet
    road_wheel_angle_rad: float
    road_wheel_rate_radps: float = 0.0  # 0 = as fast as the limits allow, as in AckermannDrive
    speed_mps: float  # target speed
    accel_mps2: float  # the demand; negative brakes
    jerk_mps3: float = 0.0  # likewise


@dataclass(frozen=True, slots=True, kw_only=True)
class SimTruth:
    """The true pose on the road, from the simulator. No driving process may read it."""

    t_s: float
    x_m: float
    y_m: float
    yaw_rad: float
    station_m: float  # travelled along the lane centre line
    lateral_offset_m: float
    heading_error_rad: float
    curvature_1pm: float
    lane_width_m: float
    lateral_accel_mps2: float
    longitudinal_accel_mps2: float
    departures: int  # so far
    interventions: int  # so far
    collisions: int  # so far
    section: str  # name of the part of the road, e.g. "unmarked"
    lead_gap_m: float | None  # bumper to bumper, to the nearest vehicle in the lane of the ego vehicle
    lead_x_m: float | None
    lead_y_m: float | None
    lead_yaw_rad: float | None
    finished: bool  # the end of the route is reached
    elapsed_s: float | None = None  # time of the run; negative in a run-up, None while the world stands
    speed_mps: float | None = None
    yaw_rate_radps: float | None = None
    traffic_x_m: tuple[float, ...] = ()  # of every other vehicle of the scenario, at its rear axle
    traffic_y_m: tuple[float, ...] = ()
    traffic_yaw_rad: tuple[float, ...] = ()
    traffic_speed_mps: tuple[float, ...] = ()
    manoeuvres: tuple[str, ...] = ()  # kinds of the current phases of vehicles and road users
    user_x_m: tuple[
        float, ...
    ] = ()  # of every person, cyclist and animal, at the middle of its ground contact
    user_y_m: tuple[float, ...] = ()
    user_yaw_rad: tuple[float, ...] = ()
    user_speed_mps: tuple[float, ...] = ()


class Health(StrEnum):
    """Level of a diagnostic status, as in diagnostic_msgs/DiagnosticStatus."""

    OK = "ok"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True, slots=True, kw_only=True)
class Diagnostic:
    """The state of one process (diagnostic_msgs/DiagnosticArray with one status)."""

    t_s: float
    process: str
    health: Health
    message: str
    values: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class DriverInput:
    """The demand of a driver at a game pad or keyboard. ``t_s`` is the time of reading."""

    t_s: float
    connected: bool  # the device exists and can be read
    allowed: bool  # the dead man's switch is held, and no stop button was pressed since it was last released
    override: bool  # the driver drives in place of the controller
    road_wheel_angle_rad: float | None  # demand of the driver; None: the controller steers
    accel_mps2: float | None  # likewise; None without override
    speed_mps: float | None
    record: bool  # the driver wants the drive recorded


@dataclass(frozen=True, slots=True, kw_only=True)
class StopRequest:
    """A press of the stop button of the page, or its release. ``t_s`` is the time of the press."""

    t_s: float
    stop: bool  # False: the car may drive again; heard at standstill only


@dataclass(frozen=True, slots=True, kw_only=True)
class Timing:
    """When a process handled frames: one entry per frame that triggered a step, on the clock of the drive [s].

    ``t_s`` is the time of this report. The difference of consecutive times is the time spent in transport, in
    waiting for the process, and in the step with the serialization of its output.
    """

    t_s: float
    process: str
    frame_s: tuple[float, ...]  # capture of the frame
    published_s: tuple[float | None, ...]  # publication of the message that triggered the step
    received_s: tuple[float, ...]  # its arrival in the process
    began_s: tuple[float, ...]  # begin of the step
    sent_s: tuple[float, ...]  # the output is handed to the transport, or to the actuator


@dataclass(frozen=True, slots=True, kw_only=True)
class Steps:
    """The inputs of consecutive steps of one node, from which a recording is run again bit for bit.

    ``t_s`` is the time of this report.
    """

    t_s: float
    process: str
    first: int  # number of the first of these steps since the start of the node
    outputs: tuple[str, ...]  # keys of the topics that each step publishes
    inputs: tuple[str, ...]  # keys of the topics that it reads
    began_s: tuple[float, ...]  # the time that each step was given
    # publication of the message used, of every input, step by step; None: no message so far
    read_s: tuple[float | None, ...]
    broken: tuple[float, ...]  # places in read_s with a newer message that could not be decoded


@dataclass(frozen=True, slots=True, kw_only=True)
class Losses:
    """Processes that do not run, as reported by the launcher: lost ones, by the effect of their loss (``loss`` in
    ``processes.yaml``), and those whose start a drive awaits.
    """

    t_s: float
    stop: tuple[str, ...]  # the car stops
    slow: tuple[str, ...]  # the car slows down until they are back
    awaited: tuple[str, ...] = ()  # a standing car does not start before they report


Derived = (
    ImageStatistics
    | SteeringEstimate
    | LeadVehicle
    | RoadUsers
    | VehicleState
    | Decision
    | SimTruth
    | DriverInput
    | StopRequest
    | Timing
    | Steps
    | Losses
)
"""Messages of Trepid's own; the others travel as standard types of ROS 2."""
Message = Frame | CompressedFrame | Odometry | Command | Diagnostic | Derived
