"""An estimator that gives only a steering angle is validated, rated, fused and followed by that angle."""

import math
from collections.abc import Mapping
from dataclasses import replace

import pytest
from supervisor_rig import ESTIMATE, FRAME_S, STATE, STATISTICS

from supervisor.supervisor import Supervisor, build
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Decision, EstimateKind, Mode, SteeringEstimate

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
CURVATURE_1PM = 0.01
ANGLE = replace(
    SteeringEstimate.nothing(0.0, estimator="rule", lookahead_m=8.0, reason="", kind=EstimateKind.ANGLE),
    road_wheel_angle_rad=road_wheel_angle(CURVATURE_1PM, wheelbase_m=VEHICLE.wheelbase_m),
    confidence=0.9,
    lanes_detected=2,
)
STRAIGHT = replace(
    ESTIMATE,
    lateral_offset_m=0.0,
    heading_error_rad=0.0,
    curvature_1pm=0.0,
    curvature_rate_1pm2=0.0,
    confidence=0.95,
)


def drive_steadily(
    estimates: Mapping[str, SteeringEstimate], *, supervisor: Supervisor | None = None, speed_mps: float = 0.0
) -> Decision:
    """The decision after three seconds at ``speed_mps`` in which the estimates stay as they are."""
    supervisor = supervisor or build()
    for n in range(75):
        t_s = FRAME_S * n
        decision = supervisor.step(
            {name: replace(estimate, t_s=t_s) for name, estimate in estimates.items()},
            replace(STATISTICS, t_s=t_s),
            None,
            replace(STATE, t_s=t_s, speed_mps=speed_mps),
            now_s=t_s,
        )
    return decision


def pursuit_1pm(decision: Decision, ahead_m: float = 8.0) -> float:
    """Curvature [1/m] of the arc to the path ``ahead_m`` ahead."""
    assert decision.curvature_1pm is not None and decision.curvature_rate_1pm2 is not None
    assert decision.lateral_offset_m is not None and decision.heading_error_rad is not None
    at_axle = decision.curvature_1pm - decision.curvature_rate_1pm2 * decision.lookahead_m
    y_m = -decision.lateral_offset_m - decision.heading_error_rad * ahead_m + at_axle * ahead_m**2 / 2
    return 2 * y_m / ahead_m**2


@pytest.mark.parametrize("side", [1, -1])
def test_a_single_angle_is_driven_unchanged(side: int) -> None:
    assert ANGLE.road_wheel_angle_rad is not None
    decision = drive_steadily(
        {"rule": replace(ANGLE, road_wheel_angle_rad=side * ANGLE.road_wheel_angle_rad)}
    )
    assert decision.mode is Mode.CAUTION
    assert decision.path_source == "rule"
    assert decision.curvature_1pm == pytest.approx(side * CURVATURE_1PM)


def test_an_angle_and_a_lane_lead_to_a_path_between_them() -> None:
    decision = drive_steadily({"rule": ANGLE, "cv": STRAIGHT})
    assert decision.path_source == "rule+cv"
    assert 0.05 * CURVATURE_1PM < pursuit_1pm(decision) < 0.9 * CURVATURE_1PM
    assert decision.lateral_offset_m == pytest.approx(0.0, abs=1e-6), "an angle does not measure the offset"


@pytest.mark.parametrize("other", ["cv", "cnn"])
def test_an_angle_with_one_lane_estimator_neither_stops_nor_slows_the_car(other: str) -> None:
    same = replace(ANGLE, road_wheel_angle_rad=0.0, confidence=0.95)
    decision = drive_steadily({"rule": same, other: STRAIGHT})
    assert decision.mode is not Mode.STOP
    assert decision.fear < 0.25, decision.rules


def test_two_estimators_that_the_rules_do_not_name_are_rated_by_their_kind() -> None:
    decision = drive_steadily({"one": STRAIGHT, "two": STRAIGHT})
    assert decision.mode is not Mode.STOP
    assert decision.fear < 0.25, decision.rules


@pytest.mark.parametrize("broken", [None, math.nan, math.inf, 3.0])
def test_a_confident_estimate_without_a_possible_angle_is_broken(broken: float | None) -> None:
    decision = drive_steadily({"rule": replace(ANGLE, road_wheel_angle_rad=broken), "cv": STRAIGHT})
    assert (decision.mode, decision.fear) == (Mode.STOP, 1)


def test_an_angle_that_jumps_is_trusted_less() -> None:
    def share(jump_rad: float) -> float:
        supervisor = build()
        for n in range(75):
            t_s, turn = FRAME_S * n, jump_rad * (-1) ** n
            rule = replace(ANGLE, t_s=t_s, road_wheel_angle_rad=turn)
            decision = supervisor.step(
                {"rule": rule, "cv": replace(STRAIGHT, t_s=t_s)},
                replace(STATISTICS, t_s=t_s),
                None,
                replace(STATE, t_s=t_s, speed_mps=0.0),
                now_s=t_s,
            )
        assert decision.sources == ("rule", "cv")
        return decision.trust[0]

    assert share(0.03) < 0.5 * share(0.0)


def test_opposite_angles_contradict_each_other() -> None:
    assert ANGLE.road_wheel_angle_rad is not None
    left = replace(ANGLE, road_wheel_angle_rad=0.15)
    right = replace(ANGLE, road_wheel_angle_rad=-0.15)
    decision = drive_steadily({"one": left, "two": right}, speed_mps=8.0)
    assert len(decision.sources) < 2
    assert decision.disagreement_mps2 is not None and decision.disagreement_mps2 > 3.0
