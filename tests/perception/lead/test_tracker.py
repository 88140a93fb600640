"""The tracker: a vehicle that was sure does not vanish because the detector is unsure of it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from perception.lead.detection import Detection
from perception.lead.finder import lead_settings
from perception.lead.tracker import Track, Tracker

SETTINGS = lead_settings().track
DT_S, OWN_MPS, FIRST_M = 0.04, 5.0, 40.0
CONFIDENCES = st.floats(0.01, 0.99)


class Approach:
    """The own car nears a standing vehicle at a constant speed."""

    def __init__(self) -> None:
        self.tracker, self._way_m = Tracker(SETTINGS, eye_m=1.0), 0.0

    def see(self, confidence: float | None, seconds: float) -> list[Track]:
        """The tracks after these seconds with detections of this confidence at its place; None: no detection."""
        for _ in range(round(seconds / DT_S)):
            self._way_m += OWN_MPS * DT_S
            at = Detection(FIRST_M - self._way_m, 0.2, 1.8, confidence or 0.5)
            seen = [] if confidence is None else [at]
            self.tracker.step(seen, speed_mps=OWN_MPS, yaw_rate_radps=0.0, dt_s=DT_S)
        return self.tracker.tracks


def test_a_sure_vehicle_stays_while_the_detector_is_unsure_of_it() -> None:
    drive = Approach()
    drive.see(0.95, 2.0)
    (track,) = drive.see(0.05, 4.0)
    assert track.confidence == pytest.approx(1 / (1 + math.exp(-SETTINGS.max_log_odds)))
    assert drive.tracker.odometry.to_vehicle(track.state[:2])[0] == pytest.approx(FIRST_M - 30.0, abs=0.3)


def test_a_vehicle_that_was_sure_for_a_moment_only_goes_with_unsure_detections() -> None:
    drive = Approach()
    drive.see(0.95, SETTINGS.sure_s / 2)
    assert drive.see(0.05, 0.5) == []


@pytest.mark.parametrize("confidence", [None, SETTINGS.unsure_confidence / 2])
def test_a_sure_vehicle_without_a_detection_at_its_place_goes_after_its_misses(
    confidence: float | None,
) -> None:
    drive = Approach()
    drive.see(0.95, 2.0)
    frames = math.ceil((SETTINGS.max_log_odds - SETTINGS.lost_log_odds) / -SETTINGS.miss_log_odds)
    assert len(drive.see(confidence, (frames - 1) * DT_S)) == 1
    assert drive.see(confidence, 2 * DT_S) == []


@given(st.lists(CONFIDENCES, max_size=30), CONFIDENCES, CONFIDENCES)
def test_a_more_confident_detection_never_lowers_the_confidence(
    before: list[float], one: float, other: float
) -> None:
    low, high = sorted((one, other))
    found = []
    for last in (low, high):
        drive = Approach()
        drive.see(0.95, 1.4)
        for confidence in (*before, last):
            drive.see(confidence, DT_S)
        found.append(max((track.confidence for track in drive.tracker.tracks), default=0.0))
    assert found[0] <= found[1]


@given(CONFIDENCES)
def test_a_detection_at_the_place_of_a_sure_vehicle_is_no_stronger_evidence_against_it_than_none(
    confidence: float,
) -> None:
    found = []
    for last in (confidence, None):
        drive = Approach()
        drive.see(0.95, 2.0)
        (track,) = drive.see(last, DT_S)
        found.append(track.confidence)
    assert found[0] >= found[1]
