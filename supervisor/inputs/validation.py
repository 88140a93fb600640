"""Validation of messages: the age of every message and the range of every number are checked here only."""

import math
from itertools import pairwise
from typing import ClassVar, NamedTuple, Self

from trepid.bounds import at_least
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane, Motion
from trepid.config import Settings
from trepid.messages import (
    SIGMA_AHEAD_M,
    EstimateKind,
    ImageStatistics,
    LeadVehicle,
    RoadUsers,
    SteeringEstimate,
    VehicleState,
)
from trepid.processes.lateness import LatenessLimits
from trepid.types import Positive

MAX_ANGLE_RAD = math.pi / 2
SHORTEST = 0.1  # of the wheelbase: L + K_us·v² of an oversteering car near its critical speed
SHARE = 0.7  # of the confidence of a neighbouring lane: lanes differ by decimetres (RAA: 3.25 to 3.75 m)


class ValidationSettings(Settings):
    """Section ``validation`` of ``config/supervisor.yaml``."""

    former_names: ClassVar = {"frozen_s": ("unused_frozen_s",), "frozen_speed_mps": ("moving_mps",)}

    clock_tolerance_s: Positive  # stamps may lie this far in the future
    fresh_s: Positive  # older estimates, statistics and leads are not used
    state_fresh_s: Positive  # older vehicle states are not used
    unused_frozen_s: Positive  # lanes in an image that has repeated itself for longer are not used ...
    moving_mps: Positive  # ... while the car moves at least so fast
    late: LatenessLimits  # of the messages for every frame: the car brakes until late ones are in time
    lost_s: Positive  # a process that has sent messages and none for this long is lost
    min_confidence: Positive  # estimates below are not used
    max_offset_m: Positive  # a message with a number beyond these is broken
    max_heading_rad: Positive
    max_curvature_1pm: Positive
    max_curvature_rate_1pm2: Positive
    max_speed_mps: Positive
    max_lead_distance_m: Positive
    max_sigma_m: Positive
    max_yaw_rate_radps: Positive
    min_lane_width_m: Positive
    max_lane_width_m: Positive
    max_unmarked_width_m: Positive  # wider roads without lines have two lanes, and ours is unknown

    def of_vehicle(self, vehicle: Vehicle) -> Self:
        """These, with a limit of the curvature that fits ``vehicle``."""
        return self.model_copy(update={"max_curvature_1pm": vehicle.possible_1pm(self.max_curvature_1pm)})

    def age_s(
        self,
        message: SteeringEstimate | ImageStatistics | LeadVehicle | RoadUsers | VehicleState | None,
        *,
        now_s: float,
    ) -> float:
        """Age of a message [s]; inf for None, for a stamp that is not finite, or one in the future."""
        latest_s = now_s + self.clock_tolerance_s
        if message is None or not math.isfinite(message.t_s) or message.t_s > latest_s:
            return math.inf
        return at_least(now_s - message.t_s, 0.0)


class ValidatedEstimate(NamedTuple):
    """The estimate of one estimator after the checks of age, range and consistency."""

    estimator: str
    age_s: float  # inf: no message, or an impossible stamp
    t_s: float  # NaN: none
    broken: bool  # confidence without a finite lane or angle, or a confidence outside 0..1
    confidence: float | None  # None: broken or lost
    lane: Lane | None  # at t_s; None: not to be used
    lookahead_m: float
    width_error_m: float | None  # beyond the usual widths of lanes; None: unknown
    measures_width: bool  # the estimator reports a boundary, measured or remembered
    width_m: float | None = None  # of the lane; None: unknown, or impossible
    marked: bool | None = None  # measured by painted lines; False: by the edges of the road
    from_memory: bool = False  # the estimator looks for boundaries and found none in this frame
    kind: EstimateKind = EstimateKind.LANE  # ANGLE: ``lane`` is the arc of the road-wheel angle from the axle
    ahead_sigma_m: tuple[float, ...] = ()  # of the lateral position at SIGMA_AHEAD_M; (): not stated
    speed_mps: float | None = None  # that a driving network proposes; None: no proposal

    def sigma_m(self, ahead_m: float) -> float:
        """Standard deviation of the lateral position of the lane at ``ahead_m``; 0 where it is not stated.

        Linear between the distances of SIGMA_AHEAD_M, and beyond them that of the last one.
        """
        return at_distance(self.ahead_sigma_m, ahead_m) if self.ahead_sigma_m else 0.0


def validate(
    name: str,
    estimate: SteeringEstimate | None,
    *,
    now_s: float,
    settings: ValidationSettings,
    wheelbase_m: float,
    frozen: bool = False,
    malformed: bool = False,
) -> ValidatedEstimate:
    """The ``estimate`` of the estimator ``name`` at ``now_s``. A valid message without a lane has confidence 0.

    ``frozen``: the image repeats itself while the car moves, so its lane is not used.
    ``malformed``: the newest message could not be decoded, so ``estimate`` is an older one and counts as broken.
    """
    age = settings.age_s(estimate, now_s=now_s)
    if estimate is None or age > settings.lost_s:
        t_s = estimate.t_s if estimate and math.isfinite(age) else math.nan
        return ValidatedEstimate(name, age, t_s, malformed, None, None, math.nan, None, False)
    angle = estimate.kind is EstimateKind.ANGLE
    lane = _arc_of(estimate, settings, wheelbase_m) if angle else _lane_of(estimate, settings)
    broken = malformed or not 0 <= estimate.confidence <= 1 or (estimate.confidence > 0 and lane is None)
    broken = broken or not _are_deviations(estimate.ahead_sigma_m, settings.max_sigma_m)
    said_mps = estimate.speed_mps
    proposed_mps = None if said_mps is None or math.isnan(said_mps) else said_mps
    broken = broken or not (proposed_mps is None or 0 <= proposed_mps <= settings.max_speed_mps)
    width_m, widest_m = estimate.lane_width_m, settings.max_unmarked_width_m
    # Only the edges of a road of more than one lane are measured; so may be an impossible width.
    two_lanes = estimate.marked is False and width_m is not None and not 0 < width_m <= widest_m
    usable = not (broken or frozen or two_lanes) and age <= settings.fresh_s
    usable = usable and estimate.confidence >= settings.min_confidence
    from_memory = estimate.marked is not None and estimate.lanes_detected == 0
    return ValidatedEstimate(
        estimator=name,
        age_s=age,
        t_s=estimate.t_s,
        broken=broken,
        confidence=None if broken else 0.0 if two_lanes else estimate.confidence,
        lane=lane if usable else None,
        lookahead_m=estimate.lookahead_m,
        width_error_m=_width_error_m(width_m, settings),
        measures_width=usable and not angle and (estimate.lanes_detected > 0 or from_memory),
        width_m=within(width_m, settings.max_offset_m) if usable else None,
        marked=estimate.marked if usable and not angle else None,
        from_memory=from_memory,
        kind=estimate.kind,
        ahead_sigma_m=estimate.ahead_sigma_m if usable else (),
        speed_mps=proposed_mps if usable else None,
    )


def in_own_lane(s: ValidatedEstimate, offset_m: float | None) -> ValidatedEstimate:
    """``s``, moved by whole lane widths to the lane of the car where it measures a neighbouring one.

    A marking filter may find the two lines of the next lane and report with confidence that the car is a lane's
    width away from the centre. Lanes of a road are parallel and about equally wide, so that such a lane is evidence
    of the ego lane, of reduced confidence, if the car is in its lane by the path so far.
    ``offset_m`` is the offset of the car on that path; None at the beginning, in a lane by assumption.
    """
    lane, width_m = s.lane, s.width_m
    if lane is None or width_m is None or not s.marked or s.width_error_m != 0.0 or s.confidence is None:
        return s
    lanes_over = round(lane.offset_m / width_m)
    if lanes_over == 0 or abs(offset_m or 0.0) > width_m / 2:
        return s
    own = lane._replace(offset_m=lane.offset_m - lanes_over * width_m)
    return s._replace(lane=own, confidence=SHARE * s.confidence)


def surest_of_marking(estimates: list[ValidatedEstimate]) -> ValidatedEstimate | None:
    """The estimate of highest confidence of those that distinguish lines from edges of the road."""
    marking = [e for e in estimates if e.marked is not None]
    return max(marking, key=lambda e: e.confidence or 0.0, default=None)


def state_doubt(state: VehicleState | None, *, now_s: float, settings: ValidationSettings) -> float | None:
    """How much of the state is not measured, or does not hold; None for a state that is missing or stale,
    or in which a car that is silent measures nothing.

    0: speed, wheel angle and yaw rate are measured. 0.5: one of them is left to compute the motion without the
    missing yaw rate. 1: the speed or the wheel angle is missing, or the torque of the driver is doubted.
    """
    if state is None or settings.age_s(state, now_s=now_s) > settings.state_fresh_s:
        return None
    silent = state.speed_mps is state.road_wheel_angle_rad is state.yaw_rate_radps is None
    if silent and not state.doubted:
        return None
    if state.speed_mps is None or state.road_wheel_angle_rad is None:
        return 1.0
    if state.yaw_rate_radps is None:
        return 1.0 if len(state.doubted) > 1 else 0.5
    return 1.0 if state.doubted else 0.0


def motion_of(
    state: VehicleState | None,
    *,
    now_s: float,
    settings: ValidationSettings,
    vehicle: Vehicle | None = None,
) -> Motion | None:
    """The motion of the vehicle; None when its state is missing, stale, or has an impossible number.

    With ``vehicle`` an absent wheel angle is not missed, and an absent yaw rate is that of the steady bicycle,
    ψ' = v·tan δ/(L + K_us·v²); :func:`state_doubt` rates what is absent.
    """
    if state is None or settings.age_s(state, now_s=now_s) > settings.state_fresh_s:
        return None
    speed_mps = within(state.speed_mps, settings.max_speed_mps)
    yaw_rate_radps = within(state.yaw_rate_radps, settings.max_yaw_rate_radps)
    wheel_rad = within(state.road_wheel_angle_rad, MAX_ANGLE_RAD)
    if speed_mps is None:
        return None
    if vehicle is not None and state.yaw_rate_radps is None and wheel_rad is not None:
        yaw_rate_radps = steady_yaw_rate_radps(vehicle, wheel_rad, speed_mps)
    unsteered = wheel_rad is None and not (vehicle is not None and state.road_wheel_angle_rad is None)
    if yaw_rate_radps is None or unsteered:
        return None
    return Motion(speed_mps, yaw_rate_radps)


def steady_yaw_rate_radps(vehicle: Vehicle, wheel_rad: float, speed_mps: float) -> float:
    """The yaw rate of the steady bicycle, v·tan δ/(L + K_us·v²)."""
    gradient = vehicle.understeer_gradient_rad_per_mps2
    length_m = at_least(vehicle.wheelbase_m + gradient * speed_mps**2, SHORTEST * vehicle.wheelbase_m)
    return speed_mps * math.tan(wheel_rad) / length_m


def is_frozen(
    frozen_s: float | None, speed_mps: float | None, *, after_s: float, from_mps: float, if_unknown: bool
) -> bool:
    """Whether no new image has come for more than ``after_s`` at a speed of at least ``from_mps``.

    Sensor noise never repeats. ``if_unknown`` stands for a comparison with None or NaN: True where the lane in the
    image would be used, False where evidence of a frozen camera is needed.
    """
    still = if_unknown if frozen_s is None or math.isnan(frozen_s) else frozen_s > after_s
    moves = if_unknown if speed_mps is None or math.isnan(speed_mps) else abs(speed_mps) >= from_mps
    return still and moves


def within(value: float | None, limit: float) -> float | None:
    """``value`` if its size is at most ``limit``, else None; NaN fails every comparison."""
    return value if value is not None and abs(value) <= limit else None


def _lane_of(estimate: SteeringEstimate, settings: ValidationSettings) -> Lane | None:
    """The lane at the rear axle; None unless every number is given, finite and possible."""
    numbers = (
        within(estimate.lateral_offset_m, settings.max_offset_m),
        within(estimate.heading_error_rad, settings.max_heading_rad),
        within(estimate.curvature_1pm, settings.max_curvature_1pm),
        within(estimate.curvature_rate_1pm2, settings.max_curvature_rate_1pm2),
    )
    lane = Lane.of_message(estimate)
    if lane is None or None in numbers or not 0 <= estimate.lookahead_m < math.inf:
        return None
    return None if within(lane.curvature_1pm, settings.max_curvature_1pm) is None else lane


def _are_deviations(sigma_m: tuple[float, ...], limit_m: float) -> bool:
    """Whether ``sigma_m`` holds nothing, or a possible deviation for every distance of SIGMA_AHEAD_M."""
    if not sigma_m:
        return True
    return len(sigma_m) == len(SIGMA_AHEAD_M) and False not in [0 <= sigma <= limit_m for sigma in sigma_m]


def at_distance(sigma_m: tuple[float, ...], ahead_m: float) -> float:
    """``sigma_m``, given at SIGMA_AHEAD_M, at ``ahead_m``: linear in between, constant beyond the ends."""
    for (near_m, low), (far_m, high) in pairwise(zip(SIGMA_AHEAD_M, sigma_m, strict=True)):
        if ahead_m <= far_m:
            return low + (high - low) * at_least(ahead_m - near_m, 0.0) / (far_m - near_m)
    return sigma_m[-1]


def _arc_of(estimate: SteeringEstimate, settings: ValidationSettings, wheelbase_m: float) -> Lane | None:
    """The arc from the rear axle that the road-wheel angle δ drives, κ = tan(δ)/L; None for an impossible angle."""
    angle_rad = within(estimate.road_wheel_angle_rad, MAX_ANGLE_RAD)
    if angle_rad is None or not 0 <= estimate.lookahead_m < math.inf:
        return None
    curvature_1pm = within(math.tan(angle_rad) / wheelbase_m, settings.max_curvature_1pm)
    return None if curvature_1pm is None else Lane(0.0, 0.0, curvature_1pm, 0.0)


def _width_error_m(width_m: float | None, settings: ValidationSettings) -> float | None:
    if width_m is None or not math.isfinite(width_m):
        return None
    beyond_m = at_least(settings.min_lane_width_m - width_m, width_m - settings.max_lane_width_m)
    return at_least(beyond_m, 0.0)
