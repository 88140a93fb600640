"""The harness set: short rendered clips, each with its road, light and weather, from one seed."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from perception.lane.settings import steering_settings
from sim_harness.lockstep.oracle import Oracle
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.drawn import SPEEDS_MPS, BendShape, MarkingKind, random_road
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.messages import Frame, SimTruth, SteeringEstimate, VehicleState
from trepid.types import Image

VERSION = 1  # of the set: the same seed draws the same frames
PERIOD_S = 0.04
AIM_M = (
    steering_settings().lookahead_m
)  # along the lane: second place of comparison, and aim point of the wheel angle
WARM_UP_FRAMES, SCORED_FRAMES = 10, 22  # the warm-up of trackers is 0.4 s
CLEAR, GAP = "clear", "gap"
GRADES: tuple[int, ...] = (1, 2, 3, 4, 5)
CLIPS_PER_GRADE, GAP_CLIPS = 2, 4
QUICK_GRADES: tuple[int, ...] = (3,)
GAP_M, BEFORE_GAP_M, AFTER_GAP_M = 30.0, 12.0, 2.0
GAP_SPEED_MPS = 10.0
WEAVE_M, WEAVE_LENGTH_M = (0.05, 0.35), (35.0, 60.0)  # weaving of a driver
MOUTH_M = 4.0  # ahead of the start of a clip: where its tunnel ends


@dataclass(frozen=True, slots=True)
class ClipCase:
    """One clip of the set."""

    seed: int
    number: int  # of the clip with this condition and grade
    condition: str  # "clear", "gap" or a kind of disturbance
    grade: int  # 0 for clear and gap
    kind: MarkingKind
    shape: BendShape
    snow_cover: float = 0.0  # the share of the road under trodden snow

    @property
    def key(self) -> str:
        """Name of the clip within the set of one seed."""
        snow = f"-snow{self.snow_cover:g}" if self.snow_cover else ""
        return f"{self.condition}-{self.grade}-{self.number}-{self.kind}-{self.shape}{snow}".replace(" ", "_")


@dataclass(frozen=True, slots=True)
class ClipFrame:
    """A frame, the vehicle state, and the true lane."""

    frame: Frame
    state: VehicleState
    truth: SteeringEstimate
    x_m: float
    y_m: float
    yaw_rad: float
    road: Road
    in_gap: bool  # no paint to the left or the right of the vehicle


def harness_set(seed: int, *, quick: bool = False, repeats: int = 1) -> list[ClipCase]:
    """The clips of a seed: every kind of road and shape in clear weather, every grade of every disturbance, gaps.

    Roads are assigned to disturbances in rounds of random order: each occurs once per round.
    """
    pairs = [(kind, shape) for kind in MarkingKind for shape in BendShape]
    rng = np.random.default_rng((seed, 60))
    if quick:
        chosen = [pairs[3 * i + i % 3] for i in range(len(MarkingKind))]
        clear = [ClipCase(seed, 0, CLEAR, 0, *pair) for pair in chosen]
        grades, count, gaps = QUICK_GRADES, 1, 1
    else:
        clear = [ClipCase(seed, n, CLEAR, 0, *pair) for n in range(repeats) for pair in pairs]
        grades, count, gaps = GRADES, CLIPS_PER_GRADE * repeats, GAP_CLIPS * repeats
    deck = _deal_pairs(pairs, rng)
    disturbed = [
        ClipCase(seed, n, kind.value, grade, *next(deck))
        for kind in DisturbanceKind
        for grade in grades
        for n in range(count)
    ]
    gap_kinds = (MarkingKind.YELLOW, MarkingKind.WHITE, MarkingKind.CONCRETE, MarkingKind.DOUBLE)
    broken = [ClipCase(seed, n, GAP, 0, gap_kinds[n % 4], BendShape.STRAIGHT) for n in range(gaps)]
    return [*clear, *disturbed, *broken]


def _deal_pairs(
    pairs: list[tuple[MarkingKind, BendShape]], rng: np.random.Generator
) -> Iterator[tuple[MarkingKind, BendShape]]:
    while True:
        for index in rng.permutation(len(pairs)).tolist():
            yield pairs[index]


def moments(
    case: ClipCase, camera: Camera, vehicle: Vehicle, *, frames: Sequence[Image] | None = None
) -> Iterator[ClipFrame]:
    """The frames of a clip with their truth; ``frames`` are images that have been rendered before."""
    names = b"".join(name.encode() for name in (case.condition, case.kind, case.shape))
    rng = np.random.default_rng([case.seed, 61, case.number, case.grade, *names])
    speed_mps, gap_m, count = SPEEDS_MPS[case.shape], None, WARM_UP_FRAMES + SCORED_FRAMES
    if case.condition == GAP:
        start_m = float(rng.uniform(8, 15))
        gap_m, speed_mps = (start_m + BEFORE_GAP_M, start_m + BEFORE_GAP_M + GAP_M), GAP_SPEED_MPS
        count = math.ceil((BEFORE_GAP_M + GAP_M + AFTER_GAP_M) / (speed_mps * PERIOD_S))
    road = random_road(case.kind, case.shape, rng, gap_m=gap_m, snow_cover=case.snow_cover)
    if gap_m is None:
        bend_m = sum(segment.length_m for segment in road.settings.segments[:3])
        start_m = float(rng.uniform(8.0, min(bend_m, 120.0)))
    course = Course(road, speed_mps, start_m, rng)
    disturbances = _disturbances(case, start_m)
    if case.condition == DisturbanceKind.LOW_SUN:
        azimuth = road.heading_at(start_m) + float(rng.normal(0, 0.3))
        road = Road(road.settings.model_copy(update={"sun_azimuth_rad": azimuth}))
    if frames is None:
        renderer = Renderer(road, camera, seed=int(rng.integers(2**31)), disturbances=disturbances)
        drawn = (course.picture(renderer, number * PERIOD_S) for number in range(count))
    oracle = Oracle("truth", road, vehicle)
    for number, image in enumerate(drawn if frames is None else frames):
        yield _moment(course, image, oracle, number * PERIOD_S, gap_m, vehicle)


def _disturbances(case: ClipCase, start_m: float) -> tuple[Disturbance, ...]:
    if case.condition in (CLEAR, GAP):
        return ()
    kind = DisturbanceKind(case.condition)
    if kind is DisturbanceKind.TUNNEL_EXIT:
        return (Disturbance(kind=kind, grade=case.grade, from_m=0.0, to_m=start_m + MOUTH_M),)
    return (Disturbance(kind=kind, grade=case.grade),)


class Course:
    """A vehicle that weaves about the middle of its lane: e(s) = a·sin(2π·s/λ + φ)."""

    def __init__(self, road: Road, speed_mps: float, start_m: float, rng: np.random.Generator) -> None:
        self.road, self.speed_mps, self.start_m = road, speed_mps, start_m
        self._swing_m = float(rng.uniform(*WEAVE_M))
        self._rate = 2 * math.pi / float(rng.uniform(*WEAVE_LENGTH_M))
        self._phase = float(rng.uniform(0, 2 * math.pi))

    def station_m(self, t_s: float) -> float:
        """Station [m] along the lane centre."""
        return self.start_m + self.speed_mps * t_s

    def offset_m(self, t_s: float) -> float:
        """Offset [m] to the left of the lane centre."""
        return self._swing_m * math.sin(self._rate * self.station_m(t_s) + self._phase)

    def heading_error_rad(self, t_s: float) -> float:
        """tan ψ = e'(s)/(1 − κ·e)."""
        station_m = self.station_m(t_s)
        slope = self._swing_m * self._rate * math.cos(self._rate * station_m + self._phase)
        return math.atan2(slope, 1 - self.road.curvature_at(station_m) * self.offset_m(t_s))

    def yaw_rad(self, t_s: float) -> float:
        """Heading of the vehicle [rad]."""
        return self.road.heading_at(self.station_m(t_s)) + self.heading_error_rad(t_s)

    def speed_along_mps(self, t_s: float) -> float:
        """Speed of the rear axle [m/s]: ṡ·(1 − κ·e)/cos ψ."""
        stretch = 1 - self.road.curvature_at(self.station_m(t_s)) * self.offset_m(t_s)
        return self.speed_mps * stretch / math.cos(self.heading_error_rad(t_s))

    def yaw_rate_radps(self, t_s: float) -> float:
        """Yaw rate [rad/s], by central differences."""
        return (self.yaw_rad(t_s + 1e-3) - self.yaw_rad(t_s - 1e-3)) / 2e-3

    def picture(self, renderer: Renderer, t_s: float) -> Image:
        """Image of the camera."""
        station_m = self.station_m(t_s)
        motion = ShutterMotion(self.speed_along_mps(t_s), self.yaw_rate_radps(t_s))
        x_m, y_m = self.road.position(station_m, self.offset_m(t_s))
        return renderer.render(x_m, y_m, self.yaw_rad(t_s), t_s=t_s, station_m=station_m, motion=motion)


def _moment(
    course: Course,
    image: Image,
    oracle: Oracle,
    t_s: float,
    gap_m: tuple[float, float] | None,
    vehicle: Vehicle,
) -> ClipFrame:
    station_m, offset_m, heading = course.station_m(t_s), course.offset_m(t_s), course.heading_error_rad(t_s)
    speed_mps, rate = course.speed_along_mps(t_s), course.yaw_rate_radps(t_s)
    state = VehicleState(
        t_s=t_s,
        speed_mps=speed_mps,
        road_wheel_angle_rad=math.atan(vehicle.wheelbase_m * rate / speed_mps),
        yaw_rate_radps=rate,
        driver_override=False,
    )
    pose = (*course.road.position(station_m, offset_m), course.yaw_rad(t_s))
    truth = replace(
        oracle.step(truth_at(course.road, station_m, offset_m, t_s=t_s, heading_rad=heading)),
        road_wheel_angle_rad=_needed_angle_rad(course.road, station_m, pose, vehicle),
    )
    in_gap = gap_m is not None and gap_m[0] <= station_m <= gap_m[1]
    return ClipFrame(Frame(t_s=t_s, image=image), state, truth, *pose, course.road, in_gap)


def _needed_angle_rad(
    road: Road, station_m: float, pose: tuple[float, float, float], vehicle: Vehicle
) -> float:
    """Road-wheel angle [rad] of an arc through the lane centre AIM_M ahead: κ = 2·y/(x² + y²).

    The lane centre is that of the road: the oracle's clothoid is up to 0.4 m off where a bend begins in between.
    """
    x_m, y_m, yaw_rad = pose
    aim_x_m, aim_y_m = road.position(station_m + AIM_M, 0.0)
    dx_m, dy_m = aim_x_m - x_m, aim_y_m - y_m
    left_m = dy_m * math.cos(yaw_rad) - dx_m * math.sin(yaw_rad)
    return road_wheel_angle(2 * left_m / (dx_m**2 + dy_m**2), wheelbase_m=vehicle.wheelbase_m)


def truth_at(
    road: Road,
    station_m: float,
    offset_m: float,
    *,
    t_s: float,
    heading_rad: float = 0.0,
    speed_mps: float = 8.0,
) -> SimTruth:
    """State for the oracle, which reads the place on the road only; at 8 m/s its look-ahead is 8 m."""
    return SimTruth(
        t_s=t_s, x_m=0.0, y_m=0.0, yaw_rad=0.0, station_m=station_m, lateral_offset_m=offset_m,
        heading_error_rad=heading_rad, curvature_1pm=road.curvature_at(station_m),
        lane_width_m=road.width_at(station_m), lateral_accel_mps2=0.0, longitudinal_accel_mps2=0.0, departures=0,
        interventions=0, collisions=0, section="", lead_gap_m=None, lead_x_m=None, lead_y_m=None,
        lead_yaw_rad=None, finished=False, speed_mps=speed_mps,
    )  # fmt: skip
