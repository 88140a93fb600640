"""Masks as a third witness: sure ones support the car, and take no contradiction of sure estimators away."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from supervisor_rig import ESTIMATE, STATE, Drive

from supervisor.rules.inference import FearRules
from trepid.config import CONFIG_DIR
from trepid.messages import Mode, SteeringEstimate

RULES = FearRules.load(CONFIG_DIR / "fear.yaml")
CV = replace(
    ESTIMATE,
    lateral_offset_m=0.1,
    heading_error_rad=0.0,
    curvature_1pm=0.0,
    curvature_rate_1pm2=0.0,
    confidence=0.95,
    marked=True,
)
SEGMENTS = replace(CV, estimator="segments", confidence=0.9)
UNSURE = replace(CV, confidence=0.1)
BLIND = {
    "cnn": SteeringEstimate.nothing(0.0, estimator="cnn", lookahead_m=8.0, reason="not a road of its world")
}
DRIVEN = replace(STATE, driver_override=True)


def after_taking_over(**estimates: SteeringEstimate) -> tuple[float, Mode, str]:
    """Fear, mode and cause of a car at 8 m/s with ``estimates``, a second after a driver let go."""
    drive = Drive(speed_mps=8.0, estimators=tuple(estimates))
    drive.last(3.0, **estimates, state=DRIVEN)
    decision = drive.last(1.0, **estimates)
    return decision.fear, decision.mode, decision.cause


def test_sure_masks_drive_a_street_on_which_lines_and_network_are_unsure_and_without_them_the_car_stands() -> (
    None
):
    fear, mode, _ = after_taking_over(cv=UNSURE, segments=SEGMENTS, **BLIND)
    assert fear <= 0.3 and mode is Mode.KEEP
    fear, mode, _ = after_taking_over(cv=UNSURE, **BLIND)
    assert fear >= 0.75 and mode is Mode.STOP


def test_masks_alone_are_checked_by_nothing_and_are_feared_as_lines_alone_the_more_the_less_sure() -> None:
    fears = [after_taking_over(segments=replace(SEGMENTS, confidence=c))[0] for c in (0.95, 0.6, 0.4, 0.1)]
    assert fears[0] == pytest.approx(0.5) and fears[-1] >= 0.75
    assert fears == sorted(fears)


@pytest.mark.parametrize("aside_m", [-0.9, 0.9])
def test_two_sure_sources_that_measure_different_lanes_are_feared(aside_m: float) -> None:
    drive = Drive(speed_mps=8.0, estimators=("cv", "cnn", "segments"))
    drive.last(3.0, cv=CV, segments=SEGMENTS, **BLIND, state=DRIVEN)
    assert drive.last(1.0, cv=CV, segments=SEGMENTS, **BLIND).fear <= 0.1
    aside = replace(SEGMENTS, lateral_offset_m=0.1 + aside_m)
    decision = drive.last(1.0, cv=CV, segments=aside, **BLIND)
    assert decision.fear >= 0.5 and decision.cause == "disagreement"


@pytest.mark.parametrize("wrong", [{"lateral_offset_m": 1.2}, {"curvature_1pm": 0.03}, {"lane_width_m": 6.0}])
def test_an_unsure_estimate_of_another_lane_does_not_block_sure_masks(wrong: dict[str, float]) -> None:
    other = replace(CV, confidence=0.25, **wrong)  # type: ignore[arg-type]
    fear, mode, _ = after_taking_over(cv=other, segments=SEGMENTS, **BLIND)
    assert fear <= 0.5 and mode is not Mode.STOP


@given(
    masks=st.floats(0.0, 1.0), more=st.floats(0.0, 1.0), lines=st.floats(0.0, 1.0), seen=st.floats(0.0, 1.0)
)
def test_surer_masks_never_raise_fear(masks: float, more: float, lines: float, seen: float) -> None:
    def fear(confidence: float) -> float:
        calm = {name: spec.calmest for name, spec in RULES.inputs.items()}
        measured = {"cv_confidence": lines, "cnn_confidence": seen, "second_confidence": min(lines, seen)}
        support = {"segments_support": confidence, "segments_confidence": confidence}
        return RULES.evaluate(calm | measured | support).fear

    low, high = sorted((masks, more))
    assert fear(high) <= fear(low) + 1e-9
