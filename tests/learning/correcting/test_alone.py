"""A network alone in the simulator: it is followed whatever it says, and the expert beside it steers back."""

import math
from pathlib import Path

import numpy as np
import pytest
from drive_alone_rig import drive_straight

from learning.correcting.alone import EXPERT, check
from learning.correcting.corrections import AROUND_S, STEADY, Drift, around, build_corrections, correction_log
from learning.dataset.sources.log import Faults
from learning.dataset.sources.recording import read_drive
from sim_harness.lockstep.closed_loop import Result
from trepid.config import InputError
from trepid.recording.reader import read_recording
from trepid.topics import estimate_topic

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def straight_on(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    return drive_straight(tmp_path_factory.mktemp("bend"), curvature_1pm=0.05)


def test_a_network_that_steers_straight_leaves_a_left_bend_to_the_right(
    straight_on: tuple[Path, Result],
) -> None:
    path, result = straight_on
    assert result.metrics.interventions >= 1
    assert result.metrics.distance_m == pytest.approx(18, abs=1), "the time is that of the route"
    seen = read_recording(path, estimate_topic(EXPERT).key).of(estimate_topic(EXPERT))
    offsets = np.array([one.lateral_offset_m for _, one in seen])
    assert offsets.min() < -0.5 and offsets.max() < 0.1


def test_the_expert_steers_further_into_the_bend_the_further_the_car_is_outside(
    straight_on: tuple[Path, Result],
) -> None:
    path, _ = straight_on
    seen = [one for _, one in read_recording(path, estimate_topic(EXPERT).key).of(estimate_topic(EXPERT))]
    bend = [one for one in seen if one.curvature_1pm > 0.049]
    outside = max(bend, key=lambda one: -one.lateral_offset_m)
    centred = min(bend, key=lambda one: abs(one.lateral_offset_m))
    assert outside.road_wheel_angle_rad > centred.road_wheel_angle_rad > 0


def test_a_network_that_knows_no_image_is_followed_alone(tmp_path: Path) -> None:
    _, result = drive_straight(tmp_path, curvature_1pm=0.0, unlike=9.0)
    assert result.metrics.interventions == 0 and result.metrics.distance_m == pytest.approx(18, abs=1)


def test_frames_in_a_drift_get_the_angle_of_the_expert_and_steady_ones_are_left_out(
    straight_on: tuple[Path, Result],
) -> None:
    path, _ = straight_on
    log = correction_log(path, "ahead", Drift(0.15, math.radians(2)), Faults(strict=True))
    why = np.array(log.why)
    expert = read_drive(path, Faults(strict=True), labels_of=EXPERT)
    assert set(why) == {"", STEADY}
    assert log.steering == pytest.approx(expert.steering) and (log.steering[why == ""] > 0.03).any()
    assert (np.abs(log.steering[why == STEADY]) < math.radians(2)).all()
    measured = read_drive(path, Faults(strict=True))
    assert np.median(np.abs(measured.steering)) < 0.001, "the wheel was straight, but after an intervention"


def test_a_drive_without_drift_has_no_corrections(straight_on: tuple[Path, Result], tmp_path: Path) -> None:
    path, _ = straight_on
    assert build_corrections(tmp_path / "none", [path], "ahead", Drift(9.0, 1.5)) is None
    found = build_corrections(tmp_path / "some", [path], "ahead", Drift())
    assert found is not None and found.wheel.k_us == 0.0, "the expert knows no understeer"


def test_a_frame_counts_up_to_a_second_before_and_after_a_drift() -> None:
    t_s = np.arange(0, 10, 0.5)
    found = around(t_s, t_s == 5.0)
    assert t_s[found].tolist() == [4.0, 4.5, 5.0, 5.5, 6.0] and AROUND_S == 1.0
    assert not around(t_s, t_s > 99).any()


@pytest.mark.parametrize(
    ("scenario", "changes", "what"),
    [
        ("lost_cnn", {}, "no process 'cnn'"),
        ("straight", {"sight": "truth"}, "a network needs images"),
        ("strait", {}, "no scenario 'strait'"),
    ],
)
def test_a_scenario_that_a_network_cannot_drive_alone_is_refused(
    scenario: str, changes: dict[str, str], what: str
) -> None:
    with pytest.raises(InputError, match=what):
        check(scenario, "ahead", changes)


def test_a_network_may_not_have_the_name_of_the_expert() -> None:
    with pytest.raises(InputError, match="'expert' is the name of the estimates of the exact lane"):
        check("straight", EXPERT, {})
