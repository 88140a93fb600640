import os
from dataclasses import asdict
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_road_rig import CAMERA, SETTINGS, VEHICLE, WHITE, YELLOW, look, ribbon, road

from perception.camera.self_calibration import calibrate_by_images, vanishing_point
from perception.lane.lane_cv import LaneCv
from perception.lane.model.geometry import lane_curve
from perception.techniques.steering.lane import straight_lane
from perception.techniques.steering.rule import ImageLine
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.messages import Frame, SteeringEstimate, VehicleState

DATA = Path(os.environ.get("TREPID_DATA", ROOT.parent / "shared" / "data"))
needs_data = pytest.mark.skipif(
    not DATA.is_dir(), reason="real images are not part of the project (TREPID_DATA)"
)


@pytest.mark.parametrize("lane", [(0.0, 0.0, 0.0, 0.0), (0.4, -0.05, 0.0, 0.0), (-0.3, 0.08, 0.0, 0.0)])
@pytest.mark.parametrize(("left", "dashed"), [(WHITE, False), (YELLOW, False), (WHITE, True)])
def test_the_lane_between_two_lines_is_measured_from_one_frame(lane, left, dashed):
    seen = look(road(lane, left=left, dashed=dashed))
    assert seen.lanes_detected == 2 and seen.confidence > 0.4 and seen.reason == ""
    assert seen.lateral_offset_m == pytest.approx(lane[0], abs=0.06)
    assert seen.heading_error_rad == pytest.approx(lane[1], abs=0.02)
    assert seen.lane_width_m == pytest.approx(3.4, abs=0.1)


@pytest.mark.parametrize("lane", [(0.3, 0.05, 0.0, 0.0), (-0.4, -0.03, 0.0, 0.0)])
def test_the_fit_agrees_with_the_closed_form_for_two_straight_lines(lane):
    level = CAMERA.model_copy(update={"pitch_down_rad": 0.0, "height_m": 1.5})
    seen = look(road(lane, camera=level), level)
    lines = []
    for path in (seen.left_boundary_px, seen.right_boundary_px):
        x_px, y_px = np.array(path).T
        m, k = np.polyfit(y_px, x_px, 1)
        lines.append(ImageLine(m=m, k=k))
    closed = straight_lane(*lines, focal_px=level.fx_px, centre_x_px=level.cx_px, height_m=level.height_m)
    # The closed form holds at the foot point of the camera, the estimate at the rear axle.
    at_camera_m = seen.lateral_offset_m + level.x_m * np.sin(seen.heading_error_rad)
    assert closed.heading_rad == pytest.approx(seen.heading_error_rad, abs=0.01)
    assert closed.offset_m == pytest.approx(at_camera_m, abs=0.03)
    assert closed.width_m == pytest.approx(seen.lane_width_m, abs=0.05)


@pytest.mark.parametrize("curvature", [1 / 15, -1 / 15, 1 / 40, -1 / 40, 1 / 200])
def test_bends_down_to_a_radius_of_15_m_are_measured(curvature):
    seen = look(road((0.1, 0.02, curvature, 0.0)))
    assert seen.curvature_1pm == pytest.approx(curvature, abs=0.15 * abs(curvature) + 0.0015)
    assert seen.lateral_offset_m == pytest.approx(0.1, abs=0.12)


@pytest.mark.parametrize("lane", [(0.3, 0.04, 0.0, 0.0), (-0.2, 0.0, 0.03, 0.0)])
def test_the_mirrored_image_has_the_mirrored_lane(lane):
    image = road(lane, right=YELLOW)
    # The principal point of a mirrored picture lies at width - 1 - cx.
    mirror = CAMERA.model_copy(update={"cx_px": CAMERA.width_px - 1 - CAMERA.cx_px})
    one, other = look(image), look(np.ascontiguousarray(image[:, ::-1]), mirror)
    assert other.lateral_offset_m == pytest.approx(-one.lateral_offset_m, abs=0.02)
    assert other.heading_error_rad == pytest.approx(-one.heading_error_rad, abs=0.005)
    assert other.road_wheel_angle_rad == pytest.approx(-one.road_wheel_angle_rad, abs=0.005)


def test_one_line_and_the_remembered_width_keep_the_lane():
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    for number in range(10):
        image = road((0.2, 0.0, 0.0, 0.0), width_m=3.1, left=WHITE if number < 3 else None, verge_m=3.0)
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.lateral_offset_m == pytest.approx(0.2, abs=0.1)
    assert seen.confidence > 0.3
    assert seen.marked is True


@pytest.mark.parametrize("side", [1, -1])
def test_specks_next_to_the_missing_line_do_not_change_the_width(side):
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    specks = np.random.default_rng(3).uniform([4.0, 1.7], [9.0, 2.2], (12, 2)) * (1, side)
    for number in range(10):
        image = road(
            (0.0, 0.0, 0.0, 0.0), **{"left" if side > 0 else "right": None}, verge_m=3.0, seed=number
        )
        for u, v in CAMERA.pixel_from_road(specks):
            cv2.line(image, (round(u) - 1, round(v)), (round(u) + 1, round(v)), WHITE)
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.lanes_detected == 1
    assert seen.lane_width_m == pytest.approx(SETTINGS.prior.width_m, abs=0.02)
    assert seen.lateral_offset_m == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("lane", [(0.0, 0.0, 0.0, 0.0), (0.3, -0.04, 0.0, 0.0), (-0.2, 0.02, 0.03, 0.0)])
def test_the_lane_of_an_unmarked_road_is_measured_by_its_edges(lane):
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    for number in range(6):
        image = road(lane, width_m=3.6, left=None, right=None, verge_m=0.0, seed=number)
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.lateral_offset_m == pytest.approx(lane[0], abs=0.15)
    assert seen.lane_width_m == pytest.approx(3.6, abs=0.3)
    assert 0.2 < seen.confidence < 1
    assert seen.marked is False


@pytest.mark.parametrize("side", [1, -1])
def test_a_line_around_the_corner_of_a_side_road_is_not_the_lane_that_was_shown_straight(side):
    finder, speed_mps, period_s, seen = LaneCv(SETTINGS, CAMERA, VEHICLE), 5.0, 0.04, []
    bare = road((0.0, 0.0, 0.0, 0.0), left=None, right=None, verge_m=9.0)
    corner = bare.copy()
    ribbon(corner, CAMERA, (0.0, 0.0, side * 0.09, 0.0), side * 1.7, 0.12, WHITE)
    for number, image in enumerate(
        [road((0.0, 0.0, 0.0, 0.0), verge_m=9.0)] * 8 + [bare] * 4 + [corner] * 20
    ):
        t_s = number * period_s
        state = VehicleState(
            t_s=t_s, speed_mps=speed_mps, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
        )
        seen.append(finder.step(Frame(t_s=t_s, image=image), state, now_s=t_s))
    alone = [LaneCv(SETTINGS, CAMERA, VEHICLE).step(Frame(t_s=0.0, image=corner), None, now_s=0.0)]
    assert abs(alone[0].curvature_1pm) > 0.05  # it is a lane by itself
    assert max(abs(one.curvature_1pm) for one in seen) < 0.002
    assert max(abs(one.lateral_offset_m) for one in seen) < 0.1
    assert [one.confidence for one in seen[8:]] == sorted([one.confidence for one in seen[8:]], reverse=True)


@pytest.mark.parametrize("side", ["left", "right"])
def test_with_one_boundary_ever_seen_the_confidence_is_at_most_one_half(side):
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    for number in range(20):
        image = road((0.0, 0.0, 0.0, 0.0), **{side: None}, verge_m=3.0, seed=number)
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
        assert seen.lanes_detected == 1 and seen.confidence <= 0.5


def test_an_edge_of_the_road_at_the_usual_width_is_as_good_as_the_second_line():
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    for number in range(20):
        image = road((0.0, 0.0, 0.0, 0.0), right=None, verge_m=0.0, seed=number)
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.confidence > 0.5


@pytest.mark.parametrize("offset_m", [-1.6, -1.2])
def test_the_guard_makes_both_lanes_of_an_unmarked_road_improbable(offset_m):
    confidence = {}
    for guarded in (True, False):
        finder = LaneCv(SETTINGS, CAMERA, VEHICLE, guarded=guarded)
        for number in range(12):
            image = road(
                (offset_m, 0.0, 0.0, 0.0), width_m=6.4, left=None, right=None, verge_m=0.0, seed=number
            )
            seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
        assert seen.lane_width_m == pytest.approx(6.4, abs=0.2)
        confidence[guarded] = seen.confidence
    assert confidence[True] < confidence[False] / 10


def test_a_car_in_the_middle_of_a_road_for_both_ways_without_a_line_is_unsure():
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    for number in range(20):
        image = road((0.0, 0.0, 0.0, 0.0), width_m=6.0, left=None, right=None, verge_m=0.0, seed=number)
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.lane_width_m == pytest.approx(6.0, abs=0.2)
    assert seen.confidence < 0.5


def test_a_lost_lane_is_kept_with_falling_confidence_and_then_dropped():
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    state = VehicleState(
        t_s=0.0, speed_mps=5.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )
    for number in range(5):
        finder.step(Frame(t_s=0.04 * number, image=road((0.2, 0.0, 0.0, 0.0))), state, now_s=0.0)
    dark = np.zeros((240, 320, 3), np.uint8)
    coasting = [finder.step(Frame(t_s=0.2 + 0.1 * n, image=dark), state, now_s=0.0) for n in range(32)]
    confidence = [seen.confidence for seen in coasting]
    assert (np.diff(confidence[:9]) < 0).all()
    assert coasting[3].lateral_offset_m == pytest.approx(0.2, abs=0.1)
    assert coasting[3].lanes_detected == 0 and "not seen" in coasting[3].reason
    assert_no_lane(coasting[-1])


def test_patches_next_to_a_pause_of_the_lines_do_not_replace_the_remembered_lane():
    def confidences(patches: bool) -> list[float]:
        finder, found = LaneCv(SETTINGS, CAMERA, VEHICLE), []
        for number in range(32):
            line = WHITE if number < 8 else None
            image = road((0.0, 0.0, 0.0, 0.0), left=line, right=line, verge_m=4.0, seed=number)
            for side in (1, -1) if patches and line is None else ():
                ribbon(
                    image,
                    CAMERA,
                    (0.0, 0.0, 0.0, 0.0),
                    side * 2.5,
                    0.8,
                    (75, 75, 75),
                    lambda s: int(s) % 3 == 0,
                )
            found.append(finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0).confidence)
        return found

    with_patches, without = confidences(patches=True), confidences(patches=False)
    assert min(np.subtract(with_patches, without)) > -0.05
    assert without[-1] < 0.2


@pytest.mark.parametrize("other_lane", [1, -1, 0])
def test_in_a_pause_of_the_lines_the_edges_of_the_road_give_heading_and_bend(other_lane):
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    for number in range(28):
        line, turned_rad = (WHITE, 0.0) if number < 8 else (None, 0.003 * (number - 8))
        image = road(
            (0.1, turned_rad, 0.0, 0.0),
            left=line,
            right=line,
            verge_m=0.3,
            other_lane=other_lane,
            seed=number,
        )
        seen = finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen.heading_error_rad == pytest.approx(turned_rad, abs=0.01)
    assert seen.lateral_offset_m == pytest.approx(0.1, abs=0.1)
    assert seen.lane_width_m == pytest.approx(3.4, abs=0.1)
    assert seen.lanes_detected == 2 and seen.marked is False
    assert seen.confidence > SETTINGS.good_probability


@pytest.mark.parametrize("frames", [20, 21, 22])
def test_lines_after_an_unmarked_section_are_found_at_the_next_look_for_them(frames):
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    marked = []
    for number in range(frames + SETTINGS.track.lines_every):
        line = WHITE if number >= frames else None
        image = road((0.1, 0.0, 0.0, 0.0), left=line, right=line, verge_m=0.2, seed=number)
        marked.append(finder.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0).marked)
    assert not any(marked[:frames]) and marked[-1]


@pytest.mark.parametrize("speed_mps", [1.0, 8.0, 25.0])
def test_the_confidence_of_a_remembered_lane_falls_with_time_or_way_the_later(speed_mps):
    finder, track = LaneCv(SETTINGS, CAMERA, VEHICLE), SETTINGS.track

    def confidence_of(number, image):
        state = VehicleState(
            t_s=0.04 * number,
            speed_mps=speed_mps,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=0.0,
            driver_override=False,
        )
        return finder.step(Frame(t_s=state.t_s, image=image), state, now_s=state.t_s).confidence

    confidence_of(0, road((0.1, 0.0, 0.0, 0.0)))
    dark = np.zeros((240, 320, 3), np.uint8)
    first, *_, last = (confidence_of(number, dark) for number in range(1, 12))
    lost = 0.4 * min(1.0 / track.coast_decay_s, speed_mps / track.coast_decay_m)
    assert last / first == pytest.approx(np.exp(-lost), rel=0.03)


@pytest.mark.parametrize(("offset_m", "remembered_s"), [(0.2, SETTINGS.track.max_coast_s), (2.4, 0.25)])
def test_a_lane_of_low_probability_is_dropped_sooner(offset_m, remembered_s):
    finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
    image = road((offset_m, 0.0, 0.0, 0.0), verge_m=4.0)  # a lane next to the vehicle has a low score
    seen = finder.step(Frame(t_s=0.0, image=image), None, now_s=0.0)
    assert seen.lateral_offset_m == pytest.approx(offset_m, abs=0.1)
    assert (seen.confidence > SETTINGS.good_probability) == (offset_m < 1.0)
    dark = np.zeros((240, 320, 3), np.uint8)
    coasting = [finder.step(Frame(t_s=0.04 * n, image=dark), None, now_s=0.0) for n in range(1, 80)]
    unseen = [seen.lateral_offset_m is None for seen in coasting]
    assert 0.04 * unseen.index(True) == pytest.approx(remembered_s, abs=0.05)
    assert all(unseen[unseen.index(True) :])


def test_the_same_frames_give_the_same_estimates_bit_for_bit():
    frames = [Frame(t_s=0.04 * n, image=road((0.1 * n, 0.0, 0.01, 0.0), seed=n)) for n in range(4)]

    def drive():
        finder = LaneCv(SETTINGS, CAMERA, VEHICLE)
        return [asdict(finder.step(frame, None, now_s=9.0)) for frame in frames]

    assert drive() == drive()


def assert_no_lane(seen: SteeringEstimate) -> None:
    assert seen.reason and seen.confidence == 0 and seen.lanes_detected == 0
    assert seen.lateral_offset_m is seen.heading_error_rad is seen.curvature_1pm is None
    assert seen.road_wheel_angle_rad is seen.lane_width_m is seen.curvature_rate_1pm2 is None
    assert seen.left_boundary_px == seen.right_boundary_px == ()


RANDOM = np.random.default_rng(5)
NO_ROAD = {
    "black": np.zeros((240, 320, 3), np.uint8),
    "white": np.full((240, 320, 3), 255, np.uint8),
    "noise": RANDOM.integers(0, 256, (240, 320, 3), dtype=np.uint8),
    "1x1": np.zeros((1, 1, 3), np.uint8),
    "ramp": np.tile(np.linspace(0, 255, 320, dtype=np.uint8)[None, :, None], (240, 1, 3)),
    "tall": np.zeros((600, 40, 3), np.uint8),
    "float": RANDOM.uniform(0, 255, (240, 320, 3)),
    "flat vector": np.zeros(320, np.uint8),
}


@pytest.mark.parametrize("name", NO_ROAD)
def test_images_without_a_road_give_a_reason_and_no_numbers(name):
    assert_no_lane(look(NO_ROAD[name]))


@pytest.mark.parametrize("turn", [np.flipud, np.rot90, lambda image: np.rot90(image, 3)])
@pytest.mark.parametrize("lines", [WHITE, None])
def test_roads_upside_down_or_on_their_side_have_a_low_confidence(turn, lines):
    image = np.ascontiguousarray(turn(road((0.0, 0.0, 0.0, 0.0), left=lines, right=lines)))
    assert look(image).confidence < 0.5


def test_grey_images_are_as_good_as_colour_for_white_lines():
    grey = cv2.cvtColor(road((0.2, 0.0, 0.0, 0.0)), cv2.COLOR_BGR2GRAY)
    for image in (grey, grey[:, :, None]):
        assert look(image).lateral_offset_m == pytest.approx(0.2, abs=0.06)


def test_boundaries_are_pixels_of_the_input_image_every_ten_rows_from_the_bottom():
    big = CAMERA.resize(960, 720)
    lane = (0.2, 0.0, 0.0, 0.0)
    seen = look(road(lane, camera=big), big)
    for path, side in ((seen.left_boundary_px, 1), (seen.right_boundary_px, -1)):
        rows = [y for _, y in path]
        assert len(path) > 20 and all(y % 10 == 0 for y in rows)
        assert np.diff(rows) == pytest.approx(-10)
        truth = lane_curve(np.array([*lane, 3.4, 0.0]), np.arange(0.0, 40.0, 0.5))
        edge = truth[0 if side > 0 else 1]
        u, v = big.pixel_from_road(np.column_stack([edge.real, edge.imag])[6:]).T
        for x_px, y_px in path:
            if v.min() < y_px < v.max():
                assert x_px == pytest.approx(np.interp(-y_px, -v, u), abs=6)


def test_lens_distortion_is_corrected_and_applied_to_the_boundaries():
    lens = CAMERA.model_copy(update={"distortion": (-0.12, 0.02, 0.0, 0.0, 0.0)})
    straight = road((0.2, 0.0, 0.0, 0.0))
    columns, rows = np.meshgrid(np.arange(320.0), np.arange(240.0))
    pixels = np.stack([columns.ravel(), rows.ravel()], axis=1)
    source = cv2.undistortPoints(
        pixels[:, None], lens.intrinsics, np.array(lens.distortion), P=lens.intrinsics
    )
    maps = source.reshape(240, 320, 2).astype(np.float32)
    bent = cv2.remap(straight, maps, None, cv2.INTER_LINEAR)
    seen = look(bent, lens)
    assert seen.lateral_offset_m == pytest.approx(0.2, abs=0.06)
    undistorted = look(straight)
    (x, y), (x_straight, _) = seen.left_boundary_px[2], undistorted.left_boundary_px[2]
    assert abs(x - x_straight) > 2
    assert bent[int(y), round(x)].astype(int) == pytest.approx(np.array(WHITE), abs=60)


def test_the_horizon_of_an_unknown_camera_is_estimated_from_the_lines():
    for pitch_rad in (0.0, 0.08, 0.14):
        camera = CAMERA.model_copy(update={"pitch_down_rad": pitch_rad})
        found = vanishing_point(road((0.0, 0.0, 0.0, 0.0), camera=camera), SETTINGS.self_calibration)
        assert found.y * camera.height_px == pytest.approx(camera.horizon_row_px, abs=5)


@needs_data
@pytest.mark.parametrize("name", ["straight_lines1.jpg", "straight_lines2.jpg"])
@pytest.mark.parametrize("known", [True, False])
def test_straight_highway_lanes_have_two_lines_heading_and_width(name, known):
    image = cv2.imread(str(DATA / "highway_udacity_adv" / "test_images" / name))
    camera = (
        load(CONFIG_DIR / "cameras" / "udacity_highway.yaml", Camera)
        if known
        else calibrate_by_images([image], SETTINGS.self_calibration)
    )
    seen = look(image, camera)
    assert seen.lanes_detected == 2
    assert abs(np.degrees(seen.heading_error_rad)) < 2
    assert seen.lane_width_m == pytest.approx(3.7, rel=0.15)
