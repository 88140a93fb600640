import math

import numpy as np
import pytest
from drawn_road_rig import CAMERA, SETTINGS, VEHICLE, WHITE, look, ribbon, road

from perception.camera.ground_fit import Optics
from perception.camera.self_calibration import calibrate_by_images
from perception.estimators import entry_of
from perception.lane.lane_cv import LaneCv
from perception.lane.unknown_camera import OTHER_LANE, LaneOfUnknownCamera
from perception.lane.which_lane import WhichLane
from trepid.messages import Frame, VehicleState

DASHCAM = CAMERA.model_copy(
    update=dict(fx_px=288.0, fy_px=288.0, height_m=1.3, pitch_down_rad=0.0, cx_px=159.5, cy_px=119.5, x_m=1.7)
)
STRAIGHT = (0.1, 0.0, 0.0, 0.0)


def assumed_camera(image):
    return calibrate_by_images([image], SETTINGS.self_calibration)


def unknown(image):
    return LaneOfUnknownCamera(SETTINGS, assumed_camera(image), VEHICLE)


def estimate_by(finder, image, t_s=0.0, state=None):
    return finder.step(Frame(t_s=t_s, image=image), state, now_s=t_s)


def test_a_marked_lane_that_is_the_same_at_all_heights_is_sure():
    image = road(STRAIGHT, camera=DASHCAM)
    seen = estimate_by(unknown(image), image)
    assert seen.lanes_detected == 2 and seen.confidence > 0.6
    assert seen.lane_width_m == pytest.approx(3.4, rel=0.15)


@pytest.mark.parametrize("width_m", [2.2, 5.6])
def test_a_width_that_only_an_unlikely_height_explains_is_less_sure_than_with_a_camera_file(width_m):
    height_m = 1.3 * 3.4 / width_m  # at which the lane would be 3.4 m wide
    image = road(STRAIGHT, camera=DASHCAM, width_m=width_m)
    known = look(image, DASHCAM.model_copy(update={"height_m": height_m}))
    seen = estimate_by(unknown(image), image)
    assert known.confidence > 0.6
    assert seen.confidence < known.confidence - 0.1


def test_an_unmarked_street_of_two_lanes_is_not_surely_one_lane():
    image = road(STRAIGHT, camera=DASHCAM, width_m=6.8, left=None, right=None, verge_m=0.0)
    low = look(image, DASHCAM.model_copy(update={"height_m": 0.8}))
    seen = estimate_by(unknown(image), image)
    assert low.confidence > seen.confidence and seen.confidence < 0.5


def test_a_lane_with_a_dashed_line_inside_is_less_sure():
    plain = road(STRAIGHT, camera=DASHCAM, width_m=4.0)
    divided = plain.copy()
    ribbon(divided, DASHCAM, STRAIGHT, 0.06, 0.12, WHITE, lambda station_m: station_m % 6 < 3)
    sure, doubtful = estimate_by(unknown(plain), plain), estimate_by(unknown(divided), divided)
    assert doubtful.confidence < 0.8 * sure.confidence


def test_a_line_inside_the_lane_is_found_and_an_arrow_is_not_one():
    plain = road(STRAIGHT)
    divided, arrow = plain.copy(), plain.copy()
    ribbon(divided, CAMERA, STRAIGHT, 0.5, 0.12, WHITE, lambda station_m: station_m % 6 < 3)
    ribbon(arrow, CAMERA, STRAIGHT, 0.1, 0.12, WHITE, lambda station_m: 8 < station_m < 12)
    found = []
    for image in (plain, divided, arrow):
        finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
        estimate_by(finder, image)
        found.append(finder.line_within)
    assert found[0] == found[2] == 0.0 and found[1] > 0.2


def test_a_lane_that_noise_moves_is_less_sure():
    image = road(STRAIGHT, camera=DASHCAM)
    steady, finder = estimate_by(unknown(image), image), unknown(image)
    finder._agreement_in = lambda *_: 0.5  # the lane in the changed image
    seen = estimate_by(finder, image)
    assert seen.confidence == pytest.approx(0.5 * steady.confidence, rel=0.1)


def test_the_place_of_the_lane_is_less_certain_than_with_a_camera_file():
    image = road((0.5, 0.05, 0.0, 0.0), camera=DASHCAM)
    seen, known = estimate_by(unknown(image), image), look(image, assumed_camera(image))
    pairs = list(zip(seen.ahead_sigma_m, known.ahead_sigma_m, strict=True))
    assert all(own > other for own, other in pairs[:4])


@pytest.mark.parametrize("height_m", [1.1, 1.3, 1.55])
def test_the_height_is_known_to_five_per_cent_after_seconds_between_two_lines(height_m):
    camera = DASHCAM.model_copy(update={"height_m": height_m})
    images = [road(STRAIGHT, camera=camera, seed=number) for number in range(40)]
    finder = LaneOfUnknownCamera(
        SETTINGS, calibrate_by_images(images[:9], SETTINGS.self_calibration), VEHICLE
    )
    for number, image in enumerate(images):
        seen = estimate_by(finder, image, t_s=0.04 * number)
    assert finder.belief.height_m == pytest.approx(height_m, rel=0.05)
    assert finder.belief.height_sigma < SETTINGS.self_calibration.height_sigma / 2
    assert seen.confidence > 0.6 and seen.lane_width_m == pytest.approx(3.4, rel=0.1)


def optics_of(camera, assumed, *, turned=True):
    """What an exact drive measures of ``camera``."""
    return Optics(
        focal_height_pxm=camera.fx_px * camera.height_m,
        focal_height_sigma=0.005,
        focal_px=camera.fx_px if turned else None,
        focal_sigma=0.01 if turned else math.inf,
        horizon_px=assumed.horizon_row_px - camera.horizon_row_px,
        aside_px=0.0,
    )


def test_odometry_makes_a_lane_of_unusual_height_and_lens_sure_and_right():
    camera = DASHCAM.model_copy(update={"height_m": 1.9, "fx_px": 240.0, "fy_px": 240.0})
    image = road(STRAIGHT, camera=camera)
    finder = unknown(image)
    before = estimate_by(finder, image)
    finder.add_optics(optics_of(camera, finder.camera))
    after = estimate_by(finder, image, t_s=0.04)
    assert finder.belief.height_m == pytest.approx(1.9, rel=0.03) and finder.camera.fx_px == pytest.approx(
        240, rel=0.03
    )
    assert after.confidence > before.confidence + 0.1
    assert after.lane_width_m == pytest.approx(3.4, rel=0.05)
    assert after.lateral_offset_m == pytest.approx(0.1, abs=0.06)


def test_dashes_of_known_length_narrow_the_product_of_height_and_focal_length():
    camera = DASHCAM.model_copy(update={"height_m": 1.5, "fx_px": 320.0, "fy_px": 320.0})
    images = [road(STRAIGHT, camera=camera, dashed=True, seed=number) for number in range(60)]
    products = []
    for period_m in (None, 9.0):
        vehicle = VEHICLE.model_copy(update={"dash_period_m": period_m})
        finder = LaneOfUnknownCamera(SETTINGS, assumed_camera(images[0]), vehicle)
        for number, image in enumerate(images):
            estimate_by(finder, image, t_s=0.04 * number)
        products.append(finder.belief.height_m * finder.belief.focal_px)
    without, known = np.abs(np.log(np.array(products) / (1.5 * 320.0)))
    assert known < 0.7 * without and known < 0.1


def test_the_search_goes_on_unless_the_camera_is_clearly_another_one():
    image = road(STRAIGHT, camera=DASHCAM)
    finder = unknown(image)
    finder.add_optics(optics_of(DASHCAM, finder.camera))
    finders = finder._finders
    finder.add_optics(optics_of(DASHCAM, finder.camera))
    assert finder._finders is finders


def test_a_lane_is_followed_through_a_clip_and_lost_in_the_dark():
    finder, state = (
        None,
        VehicleState(
            t_s=0.0, speed_mps=8.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
        ),
    )
    for number in range(12):
        image = road(STRAIGHT, camera=DASHCAM, seed=number)
        finder = finder or unknown(image)
        seen = estimate_by(finder, image, t_s=0.04 * number, state=state)
    assert seen.lateral_offset_m == pytest.approx(0.1, abs=0.1) and seen.reason == ""
    dark = np.zeros_like(image)
    for number in range(12, 110):
        seen = estimate_by(finder, dark, t_s=0.04 * number, state=state)
    assert seen.confidence == 0.0 and seen.lateral_offset_m is None and seen.ahead_sigma_m == ()


def test_an_image_that_cannot_be_used_gives_no_lane():
    finder = unknown(road(STRAIGHT, camera=DASHCAM))
    seen = finder.step(Frame(t_s=0.0, image=np.zeros((8, 8, 3), np.uint8)), None, now_s=0.0)
    assert seen.confidence == 0.0 and "too small" in seen.reason


def test_the_reason_names_another_lane_at_other_heights():
    image = road(STRAIGHT, camera=DASHCAM)
    finder = unknown(image)
    finder._probabilities = lambda: np.full(4, 0.3)  # the lanes at the four heights contradict each other
    assert estimate_by(finder, image).reason == OTHER_LANE


def test_only_an_assumed_camera_is_unknown():
    assert isinstance(entry_of("cv").build(CAMERA, VEHICLE), LaneCv)
    assert isinstance(entry_of("cv").build(CAMERA, VEHICLE, assumed=True), WhichLane)


def test_a_twin_finds_the_same_lane_and_keeps_a_state_of_its_own():
    finder, image = LaneCv(SETTINGS, CAMERA, VEHICLE), road(STRAIGHT)
    estimate_by(finder, image)
    twin = finder.twin()
    other = estimate_by(twin, road((0.3, 0.02, 0.0, 0.0)), t_s=0.04)
    assert estimate_by(finder, image, t_s=0.04).lateral_offset_m == pytest.approx(0.1, abs=0.05)
    assert other.lateral_offset_m > 0.15
