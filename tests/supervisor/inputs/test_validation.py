"""The validity of a single estimate."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
from supervisor_rig import ESTIMATE

from supervisor.inputs.validation import validate
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load

LIMITS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).validation


@pytest.mark.parametrize(
    ("width_m", "marked", "seen"),
    [
        (3.5, False, True),
        (6.4, False, True),
        (None, False, True),
        (7.4, True, True),
        (7.4, False, False),
        (math.nan, False, False),
        (math.inf, False, False),
    ],
)
def test_edges_of_two_lanes_without_lines_are_no_lane(
    width_m: float | None, marked: bool, seen: bool
) -> None:
    estimate = replace(ESTIMATE, t_s=1.0, lane_width_m=width_m, marked=marked)
    found = validate("cv", estimate, now_s=1.04, settings=LIMITS, wheelbase_m=1.75)
    assert (found.lane is not None) is seen
    assert found.confidence == (ESTIMATE.confidence if seen else 0.0)


def test_a_remembered_lane_has_a_width_and_an_estimator_without_boundaries_has_none() -> None:
    remembered = replace(ESTIMATE, t_s=1.0, lanes_detected=0, marked=True, lane_width_m=2.0)
    found = validate("cv", remembered, now_s=1.04, settings=LIMITS, wheelbase_m=1.75)
    assert (found.from_memory, found.measures_width) == (True, True)
    assert found.width_error_m == pytest.approx(LIMITS.min_lane_width_m - 2.0)
    whole = validate("cnn", replace(remembered, marked=None), now_s=1.04, settings=LIMITS, wheelbase_m=1.75)
    assert (whole.from_memory, whole.measures_width) == (False, False)


def test_the_former_names_of_settings_still_work_with_a_warning(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, text = tmp_path / "supervisor.yaml", (CONFIG_DIR / "supervisor.yaml").read_text(encoding="utf-8")
    former = {"validation:": "sightings:", "unused_frozen_s: 0.1": "frozen_s: 0.12"}
    for name, other in former.items():
        assert name in text
        text = text.replace(name, other)
    path.write_text(text, encoding="utf-8")
    assert load(path, SupervisorSettings).validation == LIMITS.model_copy(update={"unused_frozen_s": 0.12})
    warnings = capsys.readouterr().err
    assert "sightings is now validation" in warnings and "frozen_s is now unused_frozen_s" in warnings


def test_a_lane_is_believed_that_is_somewhat_tighter_than_the_car_turns() -> None:
    """tan 0.8/1.32 m is 0.78/m, R = 1.3 m; a car that turns wider than R = 3 m keeps the limit of the settings."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    nimble = vehicle.model_copy(update={"wheelbase_m": 1.32, "max_road_wheel_angle_rad": 0.8})
    for car, bend_1pm, seen in ((vehicle, 0.7, False), (nimble, 0.7, True), (nimble, 1.3, False)):
        estimate = replace(ESTIMATE, t_s=1.0, curvature_1pm=bend_1pm, curvature_rate_1pm2=0.0)
        limits = LIMITS.of_vehicle(car)
        found = validate("tape", estimate, now_s=1.04, settings=limits, wheelbase_m=car.wheelbase_m)
        assert (found.lane is not None) is seen
