from dataclasses import replace

import numpy as np
import pytest
from bonnet_rig import with_bonnet
from drawn_road_rig import CAMERA, SETTINGS, VEHICLE, WHITE, road

from perception.camera.lower_end import LOOKS
from perception.camera.odometry import StateOdometry
from perception.camera.self_calibration import calibrate_by_images, typical_camera
from perception.estimators import build_beside, entry_of
from perception.lane.lane_cv import LaneCv
from perception.lane.model.geometry import WIDTH, E
from perception.lane.model.prediction import VehicleMotion
from perception.lane.street.pairs import Boundary, BoundaryKind, Pair
from perception.lane.street.profile import StreetCourse
from perception.lane.which_lane import (
    NO_HORIZON,
    RememberedFrame,
    WhichLane,
    move_pairs,
    scale_lane,
)
from trepid.car.vehicle import Traffic
from trepid.messages import Frame, VehicleState

DASHCAM = CAMERA.model_copy(
    update=dict(fx_px=288.0, fy_px=288.0, height_m=1.3, pitch_down_rad=0.0, cx_px=159.5, cy_px=119.5, x_m=1.7)
)
STRAIGHT = (0.1, 0.0, 0.0, 0.0)


def assumed_camera(image):
    return calibrate_by_images([image], SETTINGS.self_calibration)


def unknown(image, vehicle=VEHICLE):
    return WhichLane(SETTINGS, assumed_camera(image), vehicle)


def estimate_by(finder, image, t_s=0.0):
    return finder.step(Frame(t_s=t_s, image=image), None, now_s=t_s)


def test_a_self_calibrated_camera_gets_the_estimator_of_streets():
    image = road(STRAIGHT, camera=DASHCAM)
    camera = calibrate_by_images([image], SETTINGS.self_calibration)
    assert isinstance(entry_of("cv").build(camera, VEHICLE, assumed=True), WhichLane)


def test_a_plain_marked_lane_is_sure_and_both_finders_have_it():
    image = road(STRAIGHT, camera=DASHCAM)
    finder = unknown(image)
    seen = estimate_by(finder, image)
    assert seen.confidence > 0.6 and seen.lanes_detected == 2 and len(finder.looks) == 2
    assert seen.lane_width_m == pytest.approx(3.4, rel=0.15)


@pytest.mark.parametrize(("doubted", "own"), [(False, 0.9), (True, 0.1)])
def test_of_two_lanes_that_agree_one_that_its_own_finder_doubts_is_not_reported(doubted, own):
    image = road(STRAIGHT, camera=DASHCAM)
    finder = unknown(image)
    estimate_by(finder, image)
    paired = finder.looks[1].estimate
    left_px, right_px = paired.left_boundary_px, paired.right_boundary_px
    slid = tuple(
        (x + 0.06 * (right - x), y) for (x, y), (right, _) in zip(left_px, right_px, strict=False)
    )  # a lane of the search beside the line by 6 % of the width
    aside = replace(paired, confidence=own, lanes_detected=2, left_boundary_px=slid)
    finder._searched.step = lambda *_, **__: aside
    seen = estimate_by(finder, image, t_s=0.1)
    reported = np.array(seen.left_boundary_px[:5])[:, 0]
    width = np.array(right_px[:5])[:, 0] - np.array(left_px[:5])[:, 0]
    share = (reported - np.array(left_px[:5])[:, 0]) / width
    assert share == pytest.approx(0.0 if doubted else 0.06, abs=0.02)
    assert seen.confidence > 0.5


def test_an_image_without_a_lane_has_no_confidence():
    image = np.full((240, 320, 3), 90, np.uint8)
    assert estimate_by(unknown(image), image).confidence < 0.1


@pytest.mark.parametrize(("pitch_rad", "reason"), [(0.0, ""), (0.55, NO_HORIZON)])
def test_a_camera_that_looks_too_far_down_for_a_horizon_is_named_in_place_of_a_lane(pitch_rad, reason):
    image = road(STRAIGHT, camera=DASHCAM.model_copy(update={"pitch_down_rad": pitch_rad}))
    seen = estimate_by(unknown(image), image)
    assert seen.reason == reason and (seen.lateral_offset_m is None) == bool(reason)


@pytest.mark.parametrize("height_px", [56, 60, 64])
def test_a_low_wide_image_with_less_road_than_edges_need_shows_none(height_px):
    """As many rows as lines need, and none at the lower resolution of the edges."""
    settings = SETTINGS.self_calibration
    camera = typical_camera(320, height_px, 0.70 + (height_px - 56) / 200, settings)
    seen = LaneCv(SETTINGS, camera, VEHICLE).step(
        Frame(t_s=0.0, image=np.full((height_px, 320, 3), 90, np.uint8)), None, now_s=0.0
    )
    assert seen.lateral_offset_m is None and seen.reason == "the image shows no road"


@pytest.mark.parametrize("grey", [12, 190])
def test_a_bonnet_below_the_road_takes_no_confidence_from_the_lane(grey):
    image = road(STRAIGHT, camera=DASHCAM)
    covered = with_bonnet(image, grey)
    bare, seen = (
        estimate_by(entry_of("cv").build(assumed_camera(one), VEHICLE, assumed=True), one)
        for one in (image, covered)
    )
    assert seen.confidence > 0.9 * bare.confidence > 0.5
    assert seen.lateral_offset_m == pytest.approx(bare.lateral_offset_m, abs=0.1)
    assert [row for _, row in seen.left_boundary_px[:8]] == [row for _, row in bare.left_boundary_px[:8]]
    for name in ("left_boundary_px", "right_boundary_px"):  # straight on, under the bonnet
        near = [np.array(getattr(one, name)[:8])[:, 0] for one in (seen, bare)]
        assert near[0] == pytest.approx(near[1], abs=6.0)


def test_the_camera_keeps_its_size_and_what_is_known_of_it_when_a_bonnet_appears():
    image = road(STRAIGHT, camera=DASHCAM)
    covered, camera = with_bonnet(image, 12), assumed_camera(image)
    finder = WhichLane(SETTINGS, camera, VEHICLE)
    assumed = finder.belief
    looks = SETTINGS.unknown_camera.width_looks
    for number in range(looks + 1):
        estimate_by(finder, image, t_s=0.04 * number)
    known = finder.belief
    assert known.height_sigma < assumed.height_sigma  # by the width of the lane
    for number in range(looks + 1, looks + LOOKS + 1):
        estimate_by(finder, covered, t_s=0.04 * number)
    assert finder.belief == known and finder.camera.height_px == len(image)
    assert finder._searched.camera.height_px < 0.85 * len(image)


@pytest.mark.parametrize(
    ("traffic", "on_left"), [(Traffic.LEFT, 1.0), (Traffic.RIGHT, 0.0), (Traffic.UNKNOWN, 0.5)]
)
def test_the_side_of_the_traffic_is_that_of_the_car_file(traffic, on_left):
    image = road(STRAIGHT, camera=DASHCAM)
    assert unknown(image, VEHICLE.model_copy(update={"traffic": traffic})).on_left == on_left


def test_kept_pairs_move_against_the_vehicle():
    line = Boundary(1.6, BoundaryKind.LINE, 0.5, 0.9)
    kept = RememberedFrame(0.0, StreetCourse(0.1, 0.0, 0.4), (Pair(line, line, 0.5, 1.0),))
    (pair,) = move_pairs(kept, VehicleMotion(10.0, None), 0.1)
    assert pair.left.left_m == pytest.approx(1.6 - 0.1, abs=0.01)


def test_a_lane_of_a_higher_camera_is_wider_and_bends_less():
    state = SETTINGS.prior.lane
    larger = scale_lane(state, 1.5)
    assert larger.mean[WIDTH] == pytest.approx(1.5 * state.mean[WIDTH])
    assert larger.covariance[E, E] == pytest.approx(2.25 * state.covariance[E, E])


def test_estimators_of_an_assumed_camera_share_their_lane_finder_and_estimate_as_alone():
    images = [road(STRAIGHT, camera=DASHCAM, seed=number) for number in range(3)]
    camera = assumed_camera(images[0])
    frames = [Frame(t_s=0.04 * number, image=image) for number, image in enumerate(images)]
    alone = {name: entry_of(name).build(camera, VEHICLE, assumed=True) for name in ("cnn", "cv")}
    beside = build_beside(alone, camera, VEHICLE, assumed=True, odometry=StateOdometry.NONE)
    assert beside["cnn"]._witness is beside["cv"]
    for frame in frames:
        for name, one in alone.items():
            assert beside[name].step(frame, None, now_s=0.0) == one.step(frame, None, now_s=0.0)


def test_the_same_frame_again_has_the_same_estimate():
    image = road(STRAIGHT, camera=DASHCAM)
    finder, frame = WhichLane(SETTINGS, assumed_camera(image), VEHICLE), Frame(t_s=0.0, image=image)
    first = finder.step(frame, None, now_s=0.0)
    assert finder.step(frame, None, now_s=0.1) is first
    assert finder.step(Frame(t_s=0.04, image=image), None, now_s=0.1) is not first


@pytest.mark.parametrize("scale", [1.0, 0.1])
def test_a_small_car_with_an_assumed_camera_has_a_lane_of_its_own_size(scale):
    vehicle = VEHICLE.model_copy(update={"lane_width_m": 3.3 * scale})
    image = road(STRAIGHT, camera=DASHCAM, width_m=3.3)
    camera = assumed_camera(image).model_copy(update={"height_m": 1.3 * scale, "x_m": 1.7 * scale})
    built = build_beside(["cv"], camera, vehicle, assumed=True, odometry=StateOdometry.NONE)
    seen = built["cv"].step(Frame(t_s=0.0, image=image), None, now_s=0.0)
    assert seen.lane_width_m == pytest.approx(3.3 * scale, rel=0.15)


@pytest.mark.parametrize("paint", [None, WHITE])
@pytest.mark.parametrize("name", ["cv", "cnn"])
def test_in_the_middle_of_a_road_for_both_ways_without_a_line_there_no_estimator_is_sure(name, paint):
    lane = (0.0, 0.0, 0.0, 0.0)
    image = road(lane, width_m=6.2, left=paint, right=paint, verge_m=0.0, camera=DASHCAM)
    chosen = build_beside([name], assumed_camera(image), VEHICLE, assumed=True, odometry=StateOdometry.NONE)
    assert estimate_by(chosen[name], image).confidence < 0.5


def test_an_image_with_one_channel_is_a_grey_one():
    image = road(STRAIGHT, camera=DASHCAM)[:, :, 1]
    state = VehicleState(
        t_s=0.0, speed_mps=8.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )
    flat, deep = (
        unknown(image).step(Frame(t_s=0.0, image=one), state, now_s=0.0) for one in (image, image[..., None])
    )
    assert flat == deep and flat.lateral_offset_m is not None
