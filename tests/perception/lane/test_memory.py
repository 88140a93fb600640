"""The lane memory: what detections before a time without any still count for."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.estimators import lane_cv_settings
from perception.lane.memory import LaneMemory
from perception.lane.model.evidence import BoundarySupport, LaneFit
from perception.lane.model.geometry import WIDTH, LaneState
from perception.lane.model.prediction import VehicleMotion
from perception.lane.rating import Rating

SETTINGS = lane_cv_settings()
RATING = Rating(SETTINGS)
SURE_LOOKS = SETTINGS.evidence.sure_looks
PERIOD_S = 0.04


def lines() -> LaneFit:
    """A good lane between two lines."""
    mean = np.zeros(6)
    mean[WIDTH] = 3.4
    side = BoundarySupport(excess=0.35, extent_m=20.0, seen=True)
    return LaneFit(LaneState(mean, np.diag([0.01, 0.001, 1e-4, 1e-6, 0.01, 1e-4]) ** 2), side, side, 0.5)


def drive(memory: LaneMemory, detections: str, *, speed_mps: float = 8.0, t_s: float = 0.0) -> float:
    """One frame for each character of ``detections``, "x" with a lane; returns the time after the last frame."""
    for detection in detections:
        memory.predict(t_s, VehicleMotion(speed_mps, 0.0))
        if detection == "x":
            memory.update(RATING.candidate(lines()), t_s)
            memory.probability = 1.0
        elif memory.lane is not None:
            memory.coast()
        t_s += PERIOD_S
    return t_s


def looks_after(detections: str, *, speed_mps: float = 8.0) -> float:
    memory = LaneMemory(SETTINGS, RATING)
    drive(memory, detections, speed_mps=speed_mps)
    return memory.looks


def test_detections_in_a_row_count_one_each_up_to_the_number_that_is_sure():
    assert [looks_after("x" * n) for n in range(SURE_LOOKS + 3)] == [
        min(n, SURE_LOOKS) for n in range(SURE_LOOKS + 3)
    ]


@given(st.integers(1, 50), st.floats(0.5, 30.0))
def test_after_frames_without_a_detection_those_before_count_by_the_share_that_the_lane_keeps(gap, speed_mps):
    memory = LaneMemory(SETTINGS, RATING)
    t_s = drive(memory, "x" * SURE_LOOKS + "-" * gap, speed_mps=speed_mps)
    kept = memory.fade
    way_m, track = speed_mps * gap * PERIOD_S, SETTINGS.track
    assert kept == pytest.approx(
        math.exp(-min(gap * PERIOD_S / track.coast_decay_s, way_m / track.coast_decay_m))
    )
    drive(memory, "x", speed_mps=speed_mps, t_s=t_s)
    assert memory.looks == pytest.approx(min(kept * SURE_LOOKS + 1.0, SURE_LOOKS))


@given(st.lists(st.sampled_from("x-"), max_size=60), st.floats(0.5, 30.0))
def test_a_frame_without_a_detection_never_adds_to_those_that_count(frames, speed_mps):
    text = "".join(frames)
    assert looks_after(text + "-x", speed_mps=speed_mps) <= looks_after(text + "xx", speed_mps=speed_mps)
    assert 0.0 <= looks_after(text, speed_mps=speed_mps) <= SURE_LOOKS


def test_one_detection_after_a_long_time_without_any_is_less_probable_than_the_ones_before():
    sure, alone = LaneMemory(SETTINGS, RATING), LaneMemory(SETTINGS, RATING)
    drive(sure, "x" * 40)
    drive(alone, "x" * 40 + "-" * 40 + "x")
    chances = [RATING.probability_of(RATING.candidate(lines()), looks=one.looks) for one in (sure, alone)]
    assert alone.looks < 0.3 * SURE_LOOKS
    assert chances[1] < chances[0]


def test_a_lane_that_was_forgotten_starts_without_looks():
    gap = round(SETTINGS.track.max_coast_s / PERIOD_S) + 2
    assert looks_after("x" * SURE_LOOKS + "-" * gap + "x") == 1.0
