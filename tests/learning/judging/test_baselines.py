"""What a small error beside predictions without an image says about learning."""

import numpy as np
import pytest
from drive_rig import made_dataset, write_tub
from hypothesis import given
from hypothesis import strategies as st

from learning.dataset.card import card_of
from learning.judging.baselines import Baselines, no_variance


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Baselines:
    folder = tmp_path_factory.mktemp("drive")
    return Baselines(made_dataset(folder / "d", write_tub(folder / "tub", 360)), "test")


def names(drive: Baselines, angles) -> list[str]:
    return [one.finding for one in drive.learning(angles).findings]


def test_the_recorded_angles_themselves_leave_no_finding(drive):
    learning = drive.learning(drive.true_rad.copy())
    assert learning.findings == () and "0.00 of the error of the best constant" in learning.conclusion


def test_each_prediction_without_an_image_is_no_better_than_itself(drive):
    for name, angles in drive.predicted_rad.items():
        expected = "no_better_than_previous" if name == "previous_200ms" else "no_better_than_constant"
        assert expected in names(drive, angles)


def test_a_model_between_the_previous_angle_and_a_constant_has_the_first_finding_alone(drive):
    ago, true = drive.predicted_rad["previous_200ms"], drive.true_rad
    between = true + 1.2 * (np.where(np.isfinite(ago), ago, true) - true)
    assert names(drive, between) == ["no_better_than_previous"]
    assert "let the network drive in the simulator" in drive.learning(between).conclusion


def test_a_model_is_compared_on_the_frames_that_it_answers(drive):
    half = drive.true_rad.copy()
    half[::2] = np.nan
    assert names(drive, half) == []
    assert names(drive, np.full_like(half, np.nan)) == ["no_answer"]


@given(offset_rad=st.floats(-0.4, 0.4), spread_rad=st.floats(0, 0.01))
def test_angles_show_no_steering_by_their_spread_alone_wherever_their_mean_is(offset_rad, spread_rad):
    angles = offset_rad + spread_rad * np.array([-1.0, 1.0] * 8)
    if abs(np.degrees(spread_rad) - 0.1) > 1e-6:
        assert bool(no_variance(angles, "test")) == (np.degrees(spread_rad) < 0.1)


def test_the_card_of_a_straight_drive_names_the_splits_without_steering(tmp_path):
    flat = made_dataset(tmp_path / "d", write_tub(tmp_path / "tub", 360, gain=0.001))
    found = [one["finding"] for one in card_of(flat)["findings"]]
    for split in ("train", "validation", "test"):
        assert f"the angles of the {split} frames hardly vary: any constant fits them" in found
