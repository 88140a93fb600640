"""Labels of the training: the delay and the smoothing of the recipe."""

import numpy as np
import pytest
from drive_rig import PERIOD_S

from learning.dataset.dataset import Rows
from learning.dataset.motion import Delay
from learning.training import labels
from learning.training.labels import measured_delay_s, training_labels, treat_labels
from learning.training.recipe import load_recipe
from trepid.config import InputError
from trepid.types import Column


def rows(course: Column, stretches: list[int] | None = None) -> Rows:
    """Rows every 0.1 s with these labels."""
    columns = {"frame": "<i8", "t_s": "<f8", "road_wheel_rad": "<f8", "route": "<U1", "stretch": "<i4"}
    found = np.zeros(len(course), [*columns.items()])
    found["frame"] = np.arange(len(course))
    found["t_s"], found["road_wheel_rad"] = 0.1 * np.arange(len(course)), course
    found["stretch"] = stretches or [0] * len(course)
    return found


def test_a_delay_gives_each_frame_the_label_that_was_recorded_later():
    found = treat_labels(rows(np.arange(6.0)), delay_s=0.2, smoothing_s=0.0)
    assert found == pytest.approx([2, 3, 4, 5, 5, 5])
    assert treat_labels(rows(np.arange(6.0)), delay_s=-0.15, smoothing_s=0.0)[3] == pytest.approx(1.5)


def test_no_label_comes_from_beyond_a_pause():
    course = np.array([0.0, 0, 0, 9, 9, 9])
    for treatment in ({"delay_s": 0.3, "smoothing_s": 0.0}, {"delay_s": 0.0, "smoothing_s": 0.2}):
        assert treat_labels(rows(course, [0, 0, 0, 1, 1, 1]), **treatment) == pytest.approx(course)


def test_smoothing_has_no_phase_and_keeps_a_straight_course():
    pulse = np.zeros(41)
    pulse[20] = 1.0
    found = treat_labels(rows(pulse), delay_s=0.0, smoothing_s=0.2)
    assert found == pytest.approx(found[::-1], abs=1e-3) and found.argmax() == 20
    assert found[20] == pytest.approx(0.1 / (0.2 * np.sqrt(2 * np.pi)), rel=1e-3)
    assert found.sum() == pytest.approx(1.0, rel=1e-3)
    course = 0.3 * np.arange(41)
    assert treat_labels(rows(course), delay_s=0.0, smoothing_s=0.2)[10:30] == pytest.approx(
        course[10:30], abs=1e-3
    )


def test_no_label_comes_from_beyond_frames_that_are_left_out():
    held = rows(np.arange(80.0))[np.r_[0:40, 70:80]]  # 3 s are left out of the stretch
    for smoothing_s in (0.0, 0.02):
        found = treat_labels(held, delay_s=0.5, smoothing_s=smoothing_s)
        assert found[[30, 38, 39, 40, 44]] == pytest.approx([35, 39, 39, 75, 79])


def test_a_single_frame_that_is_left_out_is_bridged():
    held = rows(np.arange(20.0))[np.r_[0:10, 11:20]]
    assert treat_labels(held, delay_s=0.2, smoothing_s=0.0)[[7, 8, 9]] == pytest.approx([9, 10, 11])


def test_the_recipe_as_shipped_learns_the_recorded_labels(data):
    recorded = data.rows("train")["road_wheel_rad"].astype(np.float32)
    assert (training_labels(data, load_recipe("donkey-linear", None)) == recorded).all()
    later = load_recipe("donkey-linear", None, overrides={"label_delay_s": str(PERIOD_S)})
    assert training_labels(data, later)[:-1] == pytest.approx(recorded[1:], abs=1e-4)


def test_a_measured_delay_is_undone_and_one_that_cannot_be_measured_is_refused(data, monkeypatch):
    measured = []

    def delay_of(rows: Rows) -> Delay:
        measured.append(set(rows["split"]))
        return Delay(0.3, 0.8, "shift of the view")

    monkeypatch.setattr(labels, "delay_of", delay_of)
    assert measured_delay_s(data) == -0.3 and measured == [{"train"}]
    monkeypatch.setattr(labels, "delay_of", lambda rows: Delay(None, 0.1, "shift of the view"))
    with pytest.raises(InputError, match="label_delay_s: the labels are not related to the motion"):
        measured_delay_s(data)
