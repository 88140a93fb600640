"""The disturbances and faults of the benchmark, the grades of each, and the causes that name it rightly."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from sim_harness.scenarios.faults import (
    BlackFrames,
    EstimatorBias,
    Fault,
    FrozenCamera,
    LateFrames,
    LostLane,
    LostProcess,
    Quantity,
    WrongMeasurement,
)
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from trepid.causes import Cause

GRADES = (0, 1, 2, 3, 4, 5)
PERIOD_S = 0.8  # of the faults that come and go: each grade adds a tenth of it, or a fifth for lost lanes
UNTIL_S = 4.0  # after the start of the run: the end of the last span


class Stress(NamedTuple):
    """One disturbance or fault."""

    causes: frozenset[Cause]  # that name it; others are wrong
    changes: Callable[[int, float], Mapping[str, Any]]  # of the scenario, by grade and station of the run [m]
    state_delay_s: float = 0.0  # age of the vehicle state, for each grade
    yaw_bias_radps: float = 0.0  # added to the yaw rate that the vehicle reports, for each grade
    behind_camera: bool = True  # the images are those of grade 0
    behind_perception: bool = False  # and so is what perception makes of them


SIGHT = frozenset({Cause.LOW_CONFIDENCE, Cause.UNCONFIRMED, Cause.NO_ROAD})
"""Names of a road that is hard to see for a reason without a name of its own."""
MISMEASURED = frozenset({Cause.DISAGREEMENT, Cause.JITTER, Cause.LANE_WIDTH})
"""Names of an image that an estimator reads wrongly."""
HARD_ROAD = SIGHT | MISMEASURED | {Cause.SINGLE_SOURCE, Cause.WEAK_EDGES, Cause.ODD_ROAD}


def _disturbance_stress(kind: DisturbanceKind, *causes: Cause, hard: bool = False) -> Stress:
    def changes(grade: int, station_m: float) -> Mapping[str, Any]:
        to_m = station_m if kind is DisturbanceKind.TUNNEL_EXIT else None
        return {"disturbances": [Disturbance(kind=kind, grade=grade, to_m=to_m)]}

    named = frozenset(causes) | (HARD_ROAD if hard else frozenset())
    return Stress(named, changes, behind_camera=False)


def _faulty(faults: Callable[[int], list[Fault]], *causes: Cause, behind: bool = False) -> Stress:
    return Stress(frozenset(causes), lambda grade, _: {"faults": faults(grade)}, behind_perception=behind)


def _fault_stress(faults: Callable[[int], list[Fault]], *causes: Cause) -> Stress:
    """Faults of the estimates after they are made."""
    return _faulty(faults, *causes, behind=True)


def _spans(fault: Callable[..., Fault], share: float, **fields: Any) -> list[Fault]:
    """A fault that holds for ``share`` of every period."""
    if share >= 1.0:
        return [fault(from_s=0.0, **fields)]
    begins = [number * PERIOD_S for number in range(round(UNTIL_S / PERIOD_S))]
    return [fault(from_s=begin, to_s=begin + share * PERIOD_S, **fields) for begin in begins]


def _lost(process: str) -> Callable[[int], list[Fault]]:
    return lambda grade: _spans(LostProcess, grade / 10, kind="lost_process", process=process)


def _bias_faults(*estimators: str, **each_grade: float) -> Callable[[int], list[Fault]]:
    def faults(grade: int) -> list[Fault]:
        fields = {name: grade * value for name, value in each_grade.items()}
        return [EstimatorBias(kind="estimator_bias", from_s=0.0, estimator=e, **fields) for e in estimators]

    return faults


def _unsure(*estimators: str) -> Callable[[int], list[Fault]]:
    def faults(grade: int) -> list[Fault]:
        sure = 1.0 - 0.19 * grade
        return [
            EstimatorBias(kind="estimator_bias", from_s=0.0, estimator=e, confidence=sure) for e in estimators
        ]

    return faults


def _blind(*estimators: str) -> Callable[[int], list[Fault]]:
    return lambda grade: [
        fault for e in estimators for fault in _spans(LostLane, grade / 5, kind="lost_lane", estimator=e)
    ]


def _measurement_stress(quantity: Quantity, each_grade: float) -> Stress:
    """A measurement of the car that is off by ``each_grade`` [SI] from the start of the run on."""
    return _faulty(
        lambda grade: [
            WrongMeasurement(
                kind="wrong_measurement",
                from_s=0.0,
                quantity=quantity,
                form="offset",
                by=grade * each_grade,
            )
        ],
        Cause.DOUBTED_STATE,
    )


def _nothing(grade: int, station_m: float) -> Mapping[str, Any]:
    return {}


_KIND = DisturbanceKind
STRESSES: dict[str, Stress] = {
    "night": _disturbance_stress(_KIND.NIGHT, Cause.DARK),
    "low_sun": _disturbance_stress(_KIND.LOW_SUN, Cause.OVER_EXPOSED, Cause.DARK, hard=True),
    "glare": _disturbance_stress(_KIND.GLARE, Cause.OVER_EXPOSED, hard=True),
    "over_exposure": _disturbance_stress(_KIND.OVER_EXPOSURE, Cause.OVER_EXPOSED),
    "tunnel_exit": _disturbance_stress(_KIND.TUNNEL_EXIT, Cause.OVER_EXPOSED, Cause.DARK),
    "tree_shadows": _disturbance_stress(_KIND.TREE_SHADOWS, Cause.DARK, hard=True),
    "building_shadows": _disturbance_stress(_KIND.BUILDING_SHADOWS, Cause.DARK, hard=True),
    "bridge_shadows": _disturbance_stress(_KIND.BRIDGE_SHADOWS, Cause.DARK, hard=True),
    "rain": _disturbance_stress(_KIND.RAIN, Cause.FOG, Cause.DIRTY_LENS, hard=True),
    "wet_road": _disturbance_stress(_KIND.WET_ROAD, Cause.OVER_EXPOSED, hard=True),
    "snow": _disturbance_stress(_KIND.SNOW, Cause.FOG, Cause.UNMARKED, hard=True),
    "fog": _disturbance_stress(_KIND.FOG, Cause.FOG),
    "dirt": _disturbance_stress(_KIND.DIRT, Cause.DIRTY_LENS),
    "motion_blur": _disturbance_stress(_KIND.MOTION_BLUR, Cause.BLURRED, hard=True),
    "rolling_shutter": _disturbance_stress(_KIND.ROLLING_SHUTTER, hard=True),
    "noise": _disturbance_stress(_KIND.NOISE, Cause.DARK, hard=True),
    "jpeg": _disturbance_stress(_KIND.JPEG, Cause.BLURRED, hard=True),
    # vehicles that stand over the line are vehicles ahead, too
    "occlusion": _disturbance_stress(
        _KIND.OCCLUSION, Cause.OCCLUDED, Cause.NARROW, Cause.LEAD_CLOSE, hard=True
    ),
    "late frames": _faulty(
        lambda grade: [LateFrames(kind="late_frames", from_s=0.0, delay_s=0.05 * grade)], Cause.STALE_DATA
    ),
    "missing frames": _faulty(_lost("camera"), Cause.STALE_DATA),
    "frozen camera": _faulty(
        lambda grade: _spans(FrozenCamera, grade / 10, kind="frozen_camera"), Cause.FROZEN_CAMERA
    ),
    "black frames": _faulty(
        lambda grade: _spans(BlackFrames, grade / 10, kind="black_frames"), Cause.DARK, Cause.FROZEN_CAMERA
    ),
    "cv silent": _faulty(_lost("cv"), Cause.LOST_ESTIMATOR),
    "cnn silent": _faulty(_lost("cnn"), Cause.LOST_ESTIMATOR),
    "cv aside": _fault_stress(_bias_faults("cv", lateral_m=0.2), Cause.DISAGREEMENT),
    "cnn aside": _fault_stress(_bias_faults("cnn", lateral_m=0.2), Cause.DISAGREEMENT),
    "both aside": _fault_stress(_bias_faults("cv", "cnn", lateral_m=0.25), Cause.OFF_CENTRE),
    "cv turned": _fault_stress(_bias_faults("cv", heading_rad=0.03), Cause.DISAGREEMENT),
    "cv bent": _fault_stress(_bias_faults("cv", curvature_1pm=0.006), Cause.DISAGREEMENT),
    "cnn bent": _fault_stress(_bias_faults("cnn", curvature_1pm=0.006), Cause.DISAGREEMENT),
    "cv unsure": _fault_stress(_unsure("cv"), *SIGHT, Cause.SINGLE_SOURCE),
    "both unsure": _fault_stress(_unsure("cv", "cnn"), *SIGHT),
    "cv blind": _fault_stress(_blind("cv"), *SIGHT, Cause.SINGLE_SOURCE, Cause.JITTER),
    "both blind": _fault_stress(_blind("cv", "cnn"), *SIGHT, Cause.JITTER),
    "old state": Stress(
        frozenset({Cause.VEHICLE_STATE_LOST}), _nothing, state_delay_s=0.04, behind_perception=True
    ),
    "yaw rate off": Stress(
        frozenset({Cause.DOUBTED_STATE, Cause.DISAGREEMENT, Cause.OFF_CENTRE}),
        lambda *_: {},
        yaw_bias_radps=0.1,
    ),
    "wrong speed": _measurement_stress("speed", 1.0),
    "wrong wheel angle": _measurement_stress("wheel_angle", 0.02),
    "wrong yaw rate": _measurement_stress("yaw_rate", 0.05),
}
"""Name -> the stress. The names of the world's disturbances are those of :class:`DisturbanceKind`."""
NOTHING = "nothing"
"""The name of the drive without a stress, grade 0 of them all."""


def stress_of(name: str) -> Stress:
    """The stress of a name in STRESSES, or NOTHING."""
    return STRESSES.get(name) or Stress(frozenset(), _nothing, behind_perception=True)
