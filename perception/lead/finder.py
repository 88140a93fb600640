"""The leader and the people from camera images: detection, tracks, and the choice of the vehicle ahead."""

import math
from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np

from perception.lane.model.prediction import VehicleMotion
from perception.lane.view import as_bgr, unusable
from perception.lead.boxes import BoxDetector, BoxSettings
from perception.lead.detection import Detection, Detector, NotFinite, StripDetector
from perception.lead.kinds import PERSON, ROAD_USER_KINDS, VEHICLE, detected_kinds
from perception.lead.picture import Pictures, PictureSettings
from perception.lead.published import PUBLISHED, fetched_detector
from perception.lead.runtimes import check_present
from perception.lead.tracker import Track, Tracker, TrackSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.config import CONFIG_DIR, InputError, Settings, fault_line, load, read, resource
from trepid.messages import Frame, LeadVehicle, RoadUsers, SteeringEstimate, VehicleState
from trepid.processes.settings import ProcessSpec
from trepid.scale import ReferenceWorld, scaled_settings
from trepid.topics import CAMERA_IMAGE, ROAD_USERS
from trepid.types import OpenShare, Positive

NODE = "perception.lead.node"  # the module of the process
_NO_PROCESS = "delete `lead: null` from processes.yaml"
_NO_DETECTOR = "`trepid detector fetch objectron`, then `detector: objectron` in lead.yaml"
MAX_STEP_S = 0.5  # a longer gap between two frames drops all tracks
SLOW_MPS = 1.0  # below, the wheel angle gives the arc more exactly than the yaw rate


class ChoiceSettings(Settings):
    """Section ``choice`` of ``config/lead.yaml``."""

    min_confidence: OpenShare
    into_lane_m: Positive
    keep_m: Positive
    always_m: Positive  # a leader is at most this far ahead, ...
    within_s: Positive  # ... or this far in time, if that is farther
    lane_width_m: Positive
    max_lane_age_s: Positive
    min_lane_confidence: OpenShare
    lane_reach_m: Positive
    max_speed_sigma_mps: Positive


class PublishedSettings(Settings):
    """Section ``published`` of ``config/lead.yaml``."""

    min_confidence: OpenShare
    max_aside_sigma_mps: Positive


class LeadSettings(Settings):
    """``config/lead.yaml``."""

    detector: Path | None  # None: the embedded one; a file, or a name of PUBLISHED
    weights: Path
    boxes: BoxSettings
    track: TrackSettings
    picture: PictureSettings
    people: TrackSettings
    published: PublishedSettings
    choice: ChoiceSettings


def lead_settings(detector: Path | None = None) -> LeadSettings:
    """``config/lead.yaml``, with ``detector``, a name or a file, instead of its own. Raises InputError."""
    settings = load(CONFIG_DIR / "lead.yaml", LeadSettings)
    if detector is None:
        return settings
    named = str(detector) in PUBLISHED
    return settings.model_copy(update={"detector": detector if named else detector.absolute()})


def check_lead(specs: Iterable[ProcessSpec]) -> None:
    """Raise InputError where the embedded lead detector, trained on drawn vehicles, would get real images."""
    specs = tuple(specs)
    real = any(CAMERA_IMAGE.key in spec.publishes and not spec.simulates for spec in specs)
    if real and any(spec.module == NODE for spec in specs) and lead_settings().detector is None:
        file = CONFIG_DIR / "lead.yaml"
        what = (
            "the embedded detector is trained on drawn vehicles, and the camera is real: name a detector that"
            " `trepid detector list` prints, or leave the process out by `lead: null` in processes.yaml"
        )
        raise InputError(fault_line(("detector",), what, read(file), file))


def blindness(specs: Iterable[ProcessSpec]) -> str:
    """One line about the people, cyclists and animals to whom a car with these processes is blind; "" for none.

    After the colon it names what would end that. Raises InputError where a process needs a detector that is not on
    this machine.
    """
    publishing = [spec for spec in specs if ROAD_USERS.key in spec.publishes]
    if any(spec.module != NODE for spec in publishing):
        return ""
    try:
        able = kinds_of_detector(lead_settings())
    except InputError:
        if publishing:
            raise
        able = ()  # no process needs it; the remedy names how to get one
    detects = able if publishing else ()
    unseen = [f"{kind}s" if kind != PERSON else "people" for kind in ROAD_USER_KINDS if kind not in detects]
    missing = (_NO_PROCESS, not publishing), (_NO_DETECTOR, not set(ROAD_USER_KINDS) <= set(able))
    remedy = ", ".join(step for step, applies in missing if applies)
    return f"the car is blind to {', '.join(unseen)}: {remedy}" if unseen else ""


def kinds_of_detector(settings: LeadSettings) -> tuple[str, ...]:
    """The kinds of road users besides vehicles that the detector in ``settings`` finds.

    Raises InputError for one that is not on this machine.
    """
    if settings.detector is None:
        return StripDetector.detects
    return detected_kinds(_boxes(settings.detector, settings)[1].kinds)


class LeadFinder:
    """Node: frames to the vehicle ahead, and to the people, cyclists and animals.

    It computes in the reference world (:mod:`trepid.scale`).
    """

    def __init__(self, detector: Detector, settings: LeadSettings, camera: Camera, vehicle: Vehicle) -> None:
        """``detector`` is built for the camera enlarged to the reference world."""
        self._reference = ReferenceWorld(vehicle.scale)
        camera, vehicle = scaled_settings(camera, 1 / vehicle.scale), vehicle.in_reference_world
        self._detect, self._settings, self._vehicle = detector, settings, vehicle
        self._camera, self._size = camera, (camera.width_px, camera.height_px)
        self._eye_m, self._nose_m = camera.x_m, vehicle.wheelbase_m + vehicle.front_overhang_m
        self._restart()

    def _restart(self) -> None:
        self._tracker = Tracker(self._settings.track, eye_m=self._eye_m)
        self._people = Tracker(self._settings.people, eye_m=self._eye_m, at_rest=True)
        self._pictures = Pictures(self._settings.picture, self._camera)
        self.road_users: RoadUsers | None = None  # in the last frame; None: it cannot be processed
        self.detections: list[Detection] = []  # in the last frame
        self._ahead: Track | None = None
        self._t_s: float | None = None

    @property
    def detector_text(self) -> str:
        """What the detector is, and how its file is read, in one line."""
        return self._detect.text

    def step(
        self,
        frame: Frame,
        state: VehicleState | None,
        lanes: Iterable[SteeringEstimate | None],
        *,
        now_s: float,
    ) -> LeadVehicle:
        """The vehicle ahead in ``frame``; confidence 0 without one, NaN when the image cannot be processed.

        ``state`` gives the ego motion; without it a vehicle has a place but no speed. The most confident of
        ``lanes``, the newest estimates, defines the corridor; without one, the arc that the ego vehicle drives.
        """
        state = self._reference.enlarge("state", state)
        lanes = [self._reference.enlarge(f"lane {number}", lane) for number, lane in enumerate(lanes)]
        gap_s = math.inf if self._t_s is None else frame.t_s - self._t_s
        if not 0 <= gap_s <= MAX_STEP_S:
            self._restart()
            gap_s = 0.0
        self._t_s = frame.t_s
        if unusable(frame.image):
            return self._unknown_lead(frame.t_s)
        image = as_bgr(frame.image)
        if image.shape[1::-1] != self._size:
            image = cv2.resize(image, self._size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        try:
            self.detections = self._detect(image)
        except NotFinite:
            return self._unknown_lead(frame.t_s)
        motion = _motion(state)
        speed_mps, yaw_rate_radps = motion or (0.0, 0.0)
        own = dict(speed_mps=speed_mps, yaw_rate_radps=yaw_rate_radps, dt_s=gap_s)
        vehicles = [one for one in self.detections if one.kind == VEHICLE]
        odometry = self._tracker.odometry
        own_mps = speed_mps if motion else math.nan
        self._tracker.step(self._pictures.confirm(vehicles, image, odometry, own_mps), **own)
        self._people.step([one for one in self.detections if one.kind != VEHICLE], **own)
        self.road_users = self._reference.restore(self._users(frame.t_s, moves=motion is not None))
        lane = usable_lane(self._settings.choice, lanes, t_s=frame.t_s)
        arc_1pm = self._arc_1pm(state, motion)
        self._ahead = self._choose(Corridor(self._settings.choice, lane, arc_1pm, motion, t_s=frame.t_s))
        pace = dict(speed_mps=own_mps, dt_s=gap_s, t_s=frame.t_s)
        self._pictures.step(self._ahead, vehicles, image, odometry, **pace)
        return self._reference.restore(self._message(frame.t_s, self._ahead, moves=motion is not None))

    def _unknown_lead(self, t_s: float) -> LeadVehicle:
        """The message of an image that cannot be processed; all tracks end."""
        self._restart()
        return LeadVehicle(t_s=t_s, distance_m=None, lateral_m=None, speed_mps=None, confidence=math.nan)

    def _choose(self, corridor: "Corridor") -> Track | None:
        """The nearest vehicle in the corridor; the present leader may be ``keep_m`` farther out."""
        choice, odometry = self._settings.choice, self._tracker.odometry
        nearest, nearest_m = None, math.inf
        for track in self._tracker.tracks:
            ahead_m, left_m = odometry.to_vehicle(track.state[:2])
            margin_m = choice.keep_m if track is self._ahead else 0.0
            confident = track.confidence >= choice.min_confidence
            if (
                confident
                and ahead_m < nearest_m
                and corridor.reaches_in_m(ahead_m, left_m, track.width_m) > -margin_m
            ):
                nearest, nearest_m = track, ahead_m
        return nearest

    def _users(self, t_s: float, *, moves: bool) -> RoadUsers:
        """The people, cyclists and animals that are more likely there than not."""
        limits, odometry = self._settings.published, self._people.odometry
        tracks = [track for track in self._people.tracks if track.confidence >= limits.min_confidence]
        places = [odometry.to_vehicle(track.state[:2]).tolist() for track in tracks]
        known = [
            moves and track.aside_sigma_mps(odometry.turn) <= limits.max_aside_sigma_mps for track in tracks
        ]
        speeds = [
            (odometry.turn.T @ track.state[2:]).tolist() if seen else (math.nan, math.nan)
            for track, seen in zip(tracks, known, strict=True)
        ]
        return RoadUsers(
            t_s=t_s,
            kinds=tuple(track.kind for track in tracks),
            x_m=tuple(x_m for x_m, _ in places),
            y_m=tuple(y_m for _, y_m in places),
            x_mps=tuple(x_mps for x_mps, _ in speeds),
            y_mps=tuple(y_mps for _, y_mps in speeds),
            confidences=tuple(track.confidence for track in tracks),
            detects=self._detect.detects,
        )

    def _message(self, t_s: float, track: Track | None, *, moves: bool) -> LeadVehicle:
        if track is None:
            return LeadVehicle(t_s=t_s, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)
        odometry = self._tracker.odometry
        ahead_m, left_m = odometry.to_vehicle(track.state[:2]).tolist()
        along_mps = float((odometry.turn.T @ track.state[2:])[0])
        known = moves and track.speed_sigma_mps <= self._settings.choice.max_speed_sigma_mps
        return LeadVehicle(
            t_s=t_s,
            distance_m=max(ahead_m - self._nose_m, 0.0),
            lateral_m=left_m,
            speed_mps=min(along_mps, self._pictures.most_mps) if known else None,
            confidence=track.confidence,
        )

    def _arc_1pm(self, state: VehicleState | None, motion: tuple[float, float] | None) -> float:
        """Curvature of the ego path: r/v, at low speed tan δ/L (predicted path of ISO 15622); 0 when unknown."""
        speed_mps, yaw_rate_radps = motion or (0.0, 0.0)
        if speed_mps > SLOW_MPS:
            return yaw_rate_radps / speed_mps
        wheel_rad = None if state is None else state.road_wheel_angle_rad
        if wheel_rad is None or not abs(wheel_rad) < math.pi / 2:
            return 0.0
        return math.tan(wheel_rad) / self._vehicle.wheelbase_m


def usable_lane(
    settings: ChoiceSettings, lanes: Iterable[SteeringEstimate | None], *, t_s: float
) -> SteeringEstimate | None:
    """The most confident of the fresh ``lanes`` above ``min_lane_confidence``; None without one."""
    fresh = [
        lane
        for lane in lanes
        if lane is not None
        and abs(t_s - lane.t_s) <= settings.max_lane_age_s
        and lane.confidence >= settings.min_lane_confidence
        and Lane.of_message(lane) is not None
    ]
    return max(fresh, key=lambda lane: lane.confidence, default=None)


def _motion(state: VehicleState | None) -> tuple[float, float] | None:
    """Speed and yaw rate; None unless both are known, and possible."""
    speed_mps, yaw_rate_radps = VehicleMotion.of(state)
    return None if speed_mps is None or yaw_rate_radps is None else (speed_mps, yaw_rate_radps)


class Corridor:
    """The strip of road ahead of the ego vehicle: the estimated lane, else the arc that it drives."""

    def __init__(
        self,
        settings: ChoiceSettings,
        lane: SteeringEstimate | None,
        arc_1pm: float,
        motion: tuple[float, float] | None,
        *,
        t_s: float,
    ) -> None:
        """``lane`` may be older than ``t_s``; ``motion`` moves it to now."""
        self._settings = settings
        self._width_m = settings.lane_width_m
        self._lane = Lane(0.0, 0.0, arc_1pm, 0.0)
        self._gone_m = self._turned_rad = 0.0
        speed_mps, yaw_rate_radps = motion or (0.0, 0.0)
        self._far_m = max(settings.always_m, settings.within_s * speed_mps)
        if lane is None:
            return
        if lane.has_boundaries:
            self._width_m = lane.lane_width_m or settings.lane_width_m
        self._lane = Lane.of_message(lane) or self._lane
        self._gone_m, self._turned_rad = speed_mps * (t_s - lane.t_s), yaw_rate_radps * (t_s - lane.t_s)

    def centre_m(self, ahead_m: float) -> float:
        """Lateral place of its centre at ``ahead_m``, + left; beyond ``lane_reach_m`` along its tangent."""
        along_m = ahead_m + self._gone_m
        near_m = min(along_m, self._settings.lane_reach_m)
        slope = self._lane.slope_at(near_m)
        return self._lane.y_m(near_m) + slope * (along_m - near_m) - self._turned_rad * ahead_m

    def reaches_in_m(self, ahead_m: float, left_m: float, width_m: float) -> float:
        """How far a vehicle reaches into it beyond the ``into_lane_m`` that make it a leader; -inf too far."""
        if ahead_m > self._far_m:
            return -math.inf
        beside_m = abs(left_m - self.centre_m(ahead_m)) - width_m / 2
        return self._width_m / 2 - self._settings.into_lane_m - beside_m


def make_detector(settings: LeadSettings, camera: Camera) -> Detector:
    """The detector that ``settings`` name. Raises InputError."""
    if settings.detector is None:
        return StripDetector(resource(settings.weights), camera)
    return box_detector(settings, camera)


def box_detector(settings: LeadSettings, camera: Camera) -> BoxDetector:
    """The detector of boxes that ``settings`` name. Raises InputError."""
    if settings.detector is None:
        raise InputError("the embedded detector finds no boxes; name another one in lead.yaml")
    path, layout = _boxes(settings.detector, settings)
    return BoxDetector(path, layout, camera)


def _boxes(detector: Path, settings: LeadSettings) -> tuple[Path, BoxSettings]:
    """The file of a detector of boxes, and how its output is read. Raises InputError without such a file."""
    if published := PUBLISHED.get(str(detector)):
        return fetched_detector(str(detector)), published.layout
    path = resource(detector)
    check_present(path)
    return path, settings.boxes


def lead_finder(settings: LeadSettings, camera: Camera, vehicle: Vehicle) -> LeadFinder:
    """The lead finder for ``camera`` on ``vehicle``, in the scale of its lanes. Raises InputError."""
    detector = make_detector(settings, scaled_settings(camera, 1 / vehicle.scale))
    return LeadFinder(detector, settings, camera, vehicle)


def build(
    *, camera: Path = CONFIG_DIR / "camera.yaml", vehicle: Path = CONFIG_DIR / "vehicle.yaml"
) -> LeadFinder:
    """The lead detector for the camera and vehicle files. Raises InputError."""
    return lead_finder(lead_settings(), load(camera, Camera), load(vehicle, Vehicle))
