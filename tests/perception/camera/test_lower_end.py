import cv2
import numpy as np
import pytest
from bonnet_rig import PILLAR, VENTS, WIPER, with_bonnet, with_outlines
from drawn_road_rig import CAMERA, VEHICLE, road

from perception.camera.lower_end import LOOKS, SAME, LowerEnd, rim
from perception.estimators import entry_of
from trepid.messages import Frame

DASHCAM = CAMERA.model_copy(
    update=dict(fx_px=288.0, fy_px=288.0, height_m=1.3, pitch_down_rad=0.0, cx_px=159.5, cy_px=119.5, x_m=1.7)
)
ROAD = road((0.1, 0.0, 0.0, 0.0), camera=DASHCAM)
NIGHT = (ROAD * 0.2).astype(np.uint8)


@pytest.mark.parametrize("image", [ROAD, NIGHT], ids=["day", "night"])
@pytest.mark.parametrize("share", [0.08, 0.15, 0.3])
@pytest.mark.parametrize(("grey", "waves"), [(3, 0), (170, 40)], ids=["dark", "light"])
def test_the_road_ends_above_the_highest_place_of_a_bonnet(image, share, grey, waves):
    assert 1 - share - 0.04 <= rim(with_bonnet(image, grey, share=share, waves=waves)) <= 1 - share


def test_a_level_rim_is_found_as_well_as_an_arched_one():
    level, arched = (rim(with_bonnet(ROAD, 3, arch=arch)) for arch in (0.0, 0.5))
    assert level == pytest.approx(0.8, abs=0.04) and arched == pytest.approx(0.8, abs=0.04)


@pytest.mark.parametrize("image", [ROAD, NIGHT, np.full((240, 320, 3), 90, np.uint8)])
def test_a_road_without_a_bonnet_reaches_the_lower_edge(image):
    assert rim(image) == 1.0


def test_noise_has_no_rim():
    rng = np.random.default_rng(5)
    assert rim(rng.integers(0, 256, (240, 320, 3), dtype=np.uint8)) == 1.0


def test_a_stop_line_of_one_lane_is_no_rim():
    image = ROAD.copy()
    image[190:205, 40:210] = 230
    assert rim(image) == 1.0


def test_the_rim_of_a_mirrored_or_larger_image_is_at_the_same_height():
    image = with_bonnet(ROAD, 3)
    large = cv2.resize(image, (640, 480))
    assert rim(image[:, ::-1]) == pytest.approx(rim(image), abs=SAME)
    assert rim(large) == pytest.approx(rim(image), abs=SAME)


def test_a_rim_counts_at_once_and_stays_when_single_images_show_none():
    end, image = LowerEnd(), with_bonnet(ROAD, 3)
    first = end.step(image)
    assert first < 0.85
    shown = [end.step(ROAD if number % 3 == 0 else image) for number in range(2 * LOOKS)]
    assert shown[LOOKS:] == [first] * LOOKS


def test_a_shadow_that_the_car_approaches_is_no_lower_end():
    end = LowerEnd()
    ends = []
    for share in np.linspace(0.4, 0.05, 12):  # of the image, in the shade below its edge
        image = ROAD.copy()
        image[round((1 - share) * len(image)) :] //= 3
        ends.append(end.step(image))
    assert set(ends[3:]) == {1.0}


def test_the_lower_end_is_forgotten_where_the_road_is_seen_again():
    end = LowerEnd()
    for _ in range(LOOKS):
        end.step(with_bonnet(ROAD, 3))
    assert [end.step(ROAD) for _ in range(LOOKS)][-1] == 1.0


def test_trees_behind_a_level_road_are_no_rim():
    image = np.full((240, 320, 3), 200, np.uint8)
    image[150:] = 60
    assert rim(image) < 0.7
    assert rim(image, horizon=0.6) == 1.0
    assert rim(with_bonnet(image, 200, share=0.1), horizon=0.6) < 0.95


@pytest.mark.parametrize("name", ["cv", "cnn", "arcs"])
@pytest.mark.parametrize(("grey", "share"), [(3, 0.15), (200, 0.25)])
def test_under_a_bonnet_an_estimator_with_a_camera_file_has_the_same_lane_as_without(name, grey, share):
    seen = {}
    for covered in (False, True):
        estimator = entry_of(name).build(CAMERA, VEHICLE)
        for number in range(4):
            image = road((0.2, 0.02, 0.0, 0.0), seed=number)
            image = with_bonnet(image, grey, share=share, waves=8.0) if covered else image
            seen[covered] = estimator.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen[True].confidence > 0.9 * seen[False].confidence > 0.7
    assert seen[True].lateral_offset_m == pytest.approx(seen[False].lateral_offset_m, abs=0.1)
    assert seen[True].curvature_1pm == pytest.approx(seen[False].curvature_1pm, abs=0.004)


@pytest.mark.parametrize(("name", "within_m"), [("cv", 0.05), ("cnn", 0.2)])
@pytest.mark.parametrize(
    ("outlines", "look"), [(PILLAR, {"grey": 12}), (WIPER, {"grey": 10}), (VENTS, {"lighter": 60})]
)
@pytest.mark.parametrize("side", [-1, 1])
def test_what_stands_still_in_the_image_moves_no_lane(name, within_m, outlines, look, side):
    seen = {}
    for covered in (False, True):
        estimator = entry_of(name).build(CAMERA, VEHICLE)
        for number in range(8):
            image = road((0.2, 0.02, 0.0, 0.0), seed=number)
            if covered:
                image = with_outlines(image[:, ::side], outlines, **look)[:, ::side].copy()
            seen[covered] = estimator.step(Frame(t_s=0.04 * number, image=image), None, now_s=0.0)
    assert seen[True].confidence > 0.9 * seen[False].confidence > 0.7
    assert seen[True].lateral_offset_m == pytest.approx(seen[False].lateral_offset_m, abs=within_m)
