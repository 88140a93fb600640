"""The picture of the leader: its growth bounds its speed on any ground, and a near vehicle does not vanish."""

import math
from collections.abc import Callable

import cv2
import numpy as np
import pytest

from perception.lead.detection import Detection
from perception.lead.finder import lead_settings
from perception.lead.picture import EVEN, Pictures
from perception.lead.tracker import Track, Tracker
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.types import Image

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
SETTINGS = lead_settings()
DT_S = 0.04
FINER = 16  # columns of a pixel
GROUND, BODY, LAMP = (90, 95, 92), (120, 60, 40), (40, 40, 190)


def picture(at: Detection, true_m: float, *, half_m: float = 0.9) -> Image:
    """A car ``true_m`` from the lens, in the rows where flat ground has the place ``at``."""
    image = np.full((CAMERA.height_px, CAMERA.width_px, 3), GROUND, np.uint8)
    column, row = CAMERA.pixel_from_road([(at.ahead_m, at.left_m)])[0]
    per_m = CAMERA.fx_px / true_m
    finer = np.arange(CAMERA.width_px * FINER)
    off_m = ((finer + 0.5) / FINER - 0.5 - column) / per_m
    colour = np.tile(np.array(GROUND, float), (len(off_m), 1))
    colour[(off_m >= -half_m) & (off_m <= half_m)] = BODY
    colour[(np.abs(off_m) > 0.55) & (np.abs(off_m) < 0.85)] = LAMP
    colour = cv2.blur(colour.reshape(-1, FINER, 3).mean(axis=1), (1, 3))  # as a lens
    image[round(row - 1.4 * per_m) : round(row)] = colour.round()
    return image


def follow_pictures(
    true_m: Callable[[float], float],
    flat_m: Callable[[float], float],
    own_mps: float,
    *,
    seconds: float = 1.2,
    left_m: float = 0.3,
    draw: Callable[[Detection, float], Image] = picture,
) -> Pictures:
    """The pictures of a leader at these distances from the lens: true, and by flat ground."""
    tracker, pictures = Tracker(SETTINGS.track, eye_m=CAMERA.x_m), Pictures(SETTINGS.picture, CAMERA)
    for number in range(round(seconds / DT_S) + 1):
        t_s = number * DT_S
        seen = Detection(flat_m(t_s) + CAMERA.x_m, left_m, 1.8, 0.95)
        tracker.step([seen], speed_mps=own_mps, yaw_rate_radps=0.0, dt_s=DT_S if number else 0.0)
        frame = dict(speed_mps=own_mps, dt_s=DT_S, t_s=t_s)
        pictures.step(tracker.tracks[0], [seen], draw(seen, true_m(t_s)), tracker.odometry, **frame)
    return pictures


@pytest.mark.parametrize("lead_mps", [0.0, 2.0])
@pytest.mark.parametrize("own_mps", [6.0, 10.0])
def test_a_vehicle_beyond_a_crest_is_no_faster_than_the_growth_of_its_picture_allows(
    own_mps: float, lead_mps: float
) -> None:
    seconds, flat_m, far_m = 1.2, 20.0, 45.0
    pictures = follow_pictures(
        lambda t_s: far_m - (own_mps - lead_mps) * t_s, lambda t_s: flat_m, own_mps, seconds=seconds
    )
    span_s, settings = SETTINGS.picture.span_s, SETTINGS.picture
    end_m = far_m - (own_mps - lead_mps) * (seconds - 2 * DT_S)  # of the median of five frames
    growth_1ps = math.log((end_m + (own_mps - lead_mps) * span_s) / end_m) / span_s
    slack_mps = settings.sigmas * settings.stretch_sigma / span_s * flat_m
    # The car is 8 pixels wide, and the blur of the lens, which does not grow with it, hides a part of the growth.
    least_mps = own_mps - growth_1ps * flat_m
    assert least_mps <= pictures.most_mps <= own_mps - 0.6 * growth_1ps * flat_m + slack_mps
    assert pictures.most_mps >= lead_mps


def test_on_flat_ground_the_bound_is_not_below_the_speed_of_the_vehicle() -> None:
    pictures = follow_pictures(lambda t_s: 25.0 - 4.0 * t_s, lambda t_s: 25.0 - 4.0 * t_s, 7.0)
    slack_mps = SETTINGS.picture.sigmas * SETTINGS.picture.stretch_sigma / SETTINGS.picture.span_s * 25.0
    assert 3.0 <= pictures.most_mps <= 3.0 + 2.0 * slack_mps


@pytest.mark.parametrize("lead_mps", [8.0, 10.0])
def test_a_leader_that_keeps_its_distance_or_drives_away_has_no_bound(lead_mps: float) -> None:
    away = (lead_mps - 8.0) * 1.0
    assert follow_pictures(lambda t_s: 18.0 + away * t_s, lambda t_s: 18.0, 8.0).most_mps == math.inf


def test_mirrored_pictures_give_the_same_bound() -> None:
    def lowest_speed_mps(side: float) -> float:
        return follow_pictures(
            lambda t_s: 40.0 - 8.0 * t_s, lambda t_s: 22.0, 8.0, left_m=side * 0.4
        ).most_mps

    assert lowest_speed_mps(1.0) == pytest.approx(lowest_speed_mps(-1.0), abs=0.3)


def test_a_vehicle_that_shows_its_side_gets_no_bound_by_the_growth_of_it() -> None:
    tracker, pictures = Tracker(SETTINGS.track, eye_m=CAMERA.x_m), Pictures(SETTINGS.picture, CAMERA)
    for number in range(30):
        seen = Detection(12.0, 0.0, 1.8, 0.95)
        tracker.step([seen], speed_mps=5.0, yaw_rate_radps=0.0, dt_s=DT_S if number else 0.0)
        image = picture(seen, 10.8)
        column = round(CAMERA.pixel_from_road([(12.0, 0.0)])[0][0] + 0.9 * CAMERA.fx_px / 10.8)
        image[:, column : column + number] = (30, 30, 35)  # a dark side
        frame = dict(speed_mps=5.0, dt_s=DT_S, t_s=number * DT_S)
        pictures.step(tracker.tracks[0], [seen], image, tracker.odometry, **frame)
    assert pictures.most_mps == math.inf


def test_a_place_that_is_wrong_by_a_row_leaves_the_bound_of_a_far_vehicle() -> None:
    noise = iter(np.random.default_rng(5).choice([-1, 0, 1], 100))

    def draw_astray(at: Detection, true_m: float) -> Image:
        """A car with other colours in every row."""
        image = picture(at, true_m)
        _, row = CAMERA.pixel_from_road([(at.ahead_m, at.left_m)])[0]
        for up in range(1, 7):
            image[round(row) - up, :] = np.roll(image[round(row) - up, :], up, axis=1)
        return np.roll(image, next(noise), axis=0)

    pictures = follow_pictures(lambda t_s: 45.0 - 8.0 * t_s, lambda t_s: 20.0, 8.0, draw=draw_astray)
    assert 0.0 <= pictures.most_mps < 7.0


def test_a_bound_that_is_no_longer_measured_rises_by_the_acceleration_of_a_vehicle() -> None:
    rng = np.random.default_rng(7)

    def draw(at: Detection, true_m: float) -> Image:
        image = picture(at, true_m)
        return image if true_m > 36.0 else rng.integers(0, 255, image.shape, np.uint8)

    measured = follow_pictures(lambda t_s: 45.0 - 8.0 * t_s, lambda t_s: 20.0, 8.0, seconds=1.12, draw=draw)
    later = follow_pictures(lambda t_s: 45.0 - 8.0 * t_s, lambda t_s: 20.0, 8.0, seconds=1.92, draw=draw)
    risen_mps = SETTINGS.picture.accel_mps2 * 0.8
    assert later.most_mps == pytest.approx(measured.most_mps + risen_mps, abs=1e-6)


def test_without_the_own_speed_there_is_no_bound() -> None:
    assert follow_pictures(lambda t_s: 45.0 - 8.0 * t_s, lambda t_s: 20.0, math.nan).most_mps == math.inf


def test_another_leader_starts_without_a_bound() -> None:
    pictures = follow_pictures(lambda t_s: 45.0 - 10.0 * t_s, lambda t_s: 20.0, 10.0)
    assert pictures.most_mps < 10.0
    seen = Detection(21.2, 0.3, 1.8, 0.95)
    tracker = Tracker(SETTINGS.track, eye_m=CAMERA.x_m)
    tracker.step([seen], speed_mps=10.0, yaw_rate_radps=0.0, dt_s=0.0)
    frame = dict(speed_mps=10.0, dt_s=DT_S, t_s=1.24)
    pictures.step(tracker.tracks[0], [seen], picture(seen, 20.0), tracker.odometry, **frame)
    assert pictures.most_mps == math.inf


NEAR_M = 4.0  # from the lens
LEADER = Detection(NEAR_M + CAMERA.x_m, 0.2, 1.8, 0.95)


def standing(seconds: float) -> tuple[Pictures, Tracker]:
    """Behind a standing vehicle that was detected for so long."""
    tracker, pictures = Tracker(SETTINGS.track, eye_m=CAMERA.x_m), Pictures(SETTINGS.picture, CAMERA)
    for number in range(round(seconds / DT_S) + 1):
        tracker.step([LEADER], speed_mps=0.0, yaw_rate_radps=0.0, dt_s=DT_S if number else 0.0)
        frame = dict(speed_mps=0.0, dt_s=DT_S, t_s=number * DT_S)
        pictures.step(leader(tracker), [LEADER], picture(LEADER, NEAR_M), tracker.odometry, **frame)
    return pictures, tracker


def leader(tracker: Tracker) -> Track:
    """The only track."""
    (track,) = tracker.tracks
    return track


@pytest.mark.parametrize("detections", [[], [LEADER._replace(confidence=0.3)]])
def test_a_near_vehicle_that_looks_as_before_is_there_for_ever(detections: list[Detection]) -> None:
    pictures, tracker = standing(2.0)
    confidence = leader(tracker).confidence
    for _ in range(500):
        found = pictures.confirm(detections, picture(LEADER, NEAR_M), tracker.odometry, 0.0)
        tracker.step(found, speed_mps=0.0, yaw_rate_radps=0.0, dt_s=DT_S)
    assert leader(tracker).confidence == pytest.approx(confidence)
    assert tracker.odometry.to_vehicle(leader(tracker).state[:2])[0] == pytest.approx(LEADER.ahead_m, abs=0.1)


def test_a_near_vehicle_that_drove_away_is_not_there() -> None:
    pictures, tracker = standing(2.0)
    for far_m in (8.0, 20.0, math.inf):
        gone = LEADER._replace(ahead_m=far_m + CAMERA.x_m) if far_m < math.inf else LEADER
        image = picture(gone, far_m) if far_m < math.inf else np.full_like(picture(LEADER, NEAR_M), GROUND)
    assert pictures.confirm([], image, tracker.odometry, 0.0) == []


def test_a_faster_car_a_farther_vehicle_and_a_short_sight_of_it_rest_on_the_detector_alone() -> None:
    pictures, tracker = standing(2.0)
    image = picture(LEADER, NEAR_M)
    assert pictures.confirm([], image, tracker.odometry, SETTINGS.picture.slow_mps + 0.1) == []
    assert pictures.confirm([], image, tracker.odometry, math.nan) == []
    tracker.odometry.move(-1.0, 0.0, 3.0)
    assert pictures.confirm([], image, tracker.odometry, 0.0) == []
    short, tracker = standing(0.5 * SETTINGS.picture.sure_s)
    assert short.confirm([], image, tracker.odometry, 0.0) == []


def test_sure_detections_and_other_vehicles_stay_as_they_are() -> None:
    pictures, tracker = standing(2.0)
    image, other = picture(LEADER, NEAR_M), Detection(9.0, 5.0, 1.8, 0.8)
    sure = [LEADER, other]
    assert pictures.confirm(sure, image, tracker.odometry, 0.0) == sure
    kept = pictures.confirm([other], image, tracker.odometry, 0.0)
    assert kept[0] == other and [one.confidence for one in kept] == [0.8, EVEN]
