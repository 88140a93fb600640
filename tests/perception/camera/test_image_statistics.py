import cv2
import numpy as np
import pytest
from drawn_road_rig import CAMERA, road

from perception.camera.image_statistics import ImageStatistician
from trepid.messages import Frame, ImageStatistics


def statistics(image: np.ndarray) -> ImageStatistics:
    return ImageStatistician().step(Frame(t_s=0.0, image=image), now_s=0.0)


def scene(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(60, 180, (240, 320, 3), dtype=np.uint8)


@pytest.mark.parametrize(("level", "over", "under"), [(0, 0.0, 1.0), (128, 0.0, 0.0), (255, 1.0, 0.0)])
def test_flat_images_have_their_level_no_contrast_and_the_right_exposure(level, over, under):
    seen = statistics(np.full((240, 320, 3), level, np.uint8))
    assert seen.brightness == pytest.approx(level / 255)
    assert (seen.contrast, seen.sharpness) == (0.0, 0.0)
    assert (seen.over_exposed, seen.under_exposed) == (over, under)


def test_half_black_half_white_is_half_of_everything():
    image = np.zeros((240, 320, 3), np.uint8)
    image[:, 160:] = 255
    seen = statistics(image)
    assert seen.brightness == pytest.approx(0.5) and seen.contrast == pytest.approx(0.5)
    assert (seen.over_exposed, seen.under_exposed) == (0.5, 0.5)


def test_sharpness_is_the_variance_of_the_laplacian_and_falls_with_blur():
    grey = cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY)
    sharp = statistics(grey)
    assert sharp.sharpness == pytest.approx(cv2.Laplacian(grey, cv2.CV_64F).var())
    assert statistics(cv2.GaussianBlur(grey, (0, 0), 2)).sharpness < 0.1 * sharp.sharpness


def test_a_frozen_camera_is_detected_with_and_without_a_new_capture_time():
    for stamps in ([0.0, 0.04, 0.08], [0.0, 0.0, 0.0]):
        statistician = ImageStatistician()
        seen = [
            statistician.step(Frame(t_s=t_s, image=scene().copy()), now_s=0.04 * number).frozen_s
            for number, t_s in enumerate(stamps)
        ]
        assert seen == pytest.approx([0.0, 0.04, 0.08])


def test_an_image_with_one_changed_pixel_is_not_frozen():
    statistician = ImageStatistician()
    image = scene()
    statistician.step(Frame(t_s=0.0, image=image), now_s=0.0)
    changed = image.copy()
    changed[100, 100] ^= 8
    assert statistician.step(Frame(t_s=1.0, image=changed), now_s=1.0).frozen_s == 0.0


@pytest.mark.parametrize("shape", [(1, 1), (1, 1, 3), (2, 500, 3), (240, 320), (240, 320, 1), (240, 320, 4)])
def test_odd_shapes_are_measured_like_any_other(shape):
    assert statistics(np.full(shape, 100, np.uint8)).brightness == pytest.approx(100 / 255, abs=0.01)


def drive_past(
    *, spots: np.ndarray | None = None, frames: int = 4, speed_hps: float | None = None
) -> list[float]:
    """Share of spotted tiles while textured pictures stream by behind ``spots``, a mask."""
    statistician = ImageStatistician()
    seen = []
    for number in range(frames):
        image = 100 + scene(number) // 8  # as asphalt
        if spots is not None:
            image[spots] = image[spots] // 4
        t_s = 0.04 * number
        seen.append(statistician.step(Frame(t_s=t_s, image=image), now_s=t_s, speed_hps=speed_hps).spots)
    return seen


def blots(rows: slice) -> np.ndarray:
    """Blots of 16 pixels, 40 apart."""
    mask = np.zeros((240, 320), bool)
    for top in range(10, 240, 40):
        for left in range(10, 320, 40):
            mask[top : top + 16, left : left + 16] = True
    kept = np.zeros_like(mask)
    kept[rows] = mask[rows]
    return kept


def test_spots_all_over_a_moving_image_are_dirt_from_the_second_frame_on():
    assert drive_past(spots=blots(slice(None)))[:3] == [0.0, 1.0, 1.0]
    assert drive_past() == [0.0] * 4


def test_few_spots_are_dirt_once_they_have_stood_still_for_a_quarter_of_a_second():
    few = blots(slice(None)) & (np.arange(320) < 80)
    seen = drive_past(spots=few, frames=14)
    assert seen[:5] == [0.0] * 5 and min(seen[9:]) > 0.2


def test_few_spots_that_stand_still_for_two_frames_are_no_dirt():
    few = blots(slice(None)) & (np.arange(320) < 80)
    statistician = ImageStatistician()
    for number in range(30):
        image = 100 + scene(number) // 8
        moved = np.roll(few, 20 * (number // 2), axis=(0, 1))  # as a pattern of the ground, frame by frame
        image[moved] = image[moved] // 4
        t_s = 0.04 * number
        assert statistician.step(Frame(t_s=t_s, image=image), now_s=t_s).spots == 0.0


FEW = blots(slice(None)) & (np.arange(320) < 80)


def test_a_slower_car_takes_longer_to_know_dirt_from_what_it_passes():
    known = [
        [share > 0.2 for share in drive_past(spots=FEW, frames=30, speed_hps=speed_hps)].index(True)
        for speed_hps in (20.0, 1.0, -0.5, 0.3)
    ]
    assert known[0] == known[1] < known[2] < known[3]
    assert known[2] == pytest.approx(2 * known[1], abs=1)


def test_a_standing_car_learns_nothing_of_its_lens_and_forgets_nothing():
    statistician, seen = ImageStatistician(), []
    for number in range(60):
        stands, dirty = number < 20 or number >= 40, number >= 20
        spots = blots(slice(None)) if not dirty else FEW
        image = 100 + scene(0 if stands else number) // 8
        image[spots] = image[spots] // 4
        t_s = 0.04 * number
        found = statistician.step(Frame(t_s=t_s, image=image), now_s=t_s, speed_hps=0.0 if stands else 6.0)
        seen.append(found.spots)
    assert max(seen[:20]) == 0.0  # dark windows of a house: all that is seen stands still
    assert min(seen[30:]) > 0.2


def test_spots_in_one_part_of_the_image_are_no_dirt():
    assert max(drive_past(spots=blots(slice(0, 120)))) == 0.0
    stripes = np.zeros((240, 320), bool)
    stripes[:, 20::40] = stripes[:, 21::40] = True  # a dark line along the road
    assert max(drive_past(spots=stripes)) == 0.0


@pytest.mark.parametrize("side", [1, -1])
def test_kerbs_that_run_to_the_horizon_are_no_dirt_under_standing_houses(side):
    far = blots(slice(0, 160))  # houses and trees ahead look alike for a second
    kerbs = np.zeros((240, 320), np.uint8)
    for away_px in (-500, -340, -180, 180, 340, 500):
        cv2.line(kerbs, (160, 115), (160 + side * away_px, 240), 1, 9)
    assert max(drive_past(spots=far | (kerbs > 0), frames=14)) == 0.0
    dirt = blots(slice(None)) & (np.arange(320) < 160)
    assert min(drive_past(spots=dirt | (kerbs > 0), frames=14)[9:]) > 0.3


def image_at_bridge(ahead_m: float, *, shade: float, girders: bool, seed: int) -> np.ndarray:
    """A road in the shadow of a bridge 8 m wide, its deck above and its pillars aside, ``ahead_m`` away.

    Light falls between the ``girders``, in stripes along the road.
    """
    image = road((0.1, 0.0, 0.0, 0.0), dashed=True, seed=seed).astype(np.float32)
    horizon, at_1_m = CAMERA.horizon_row_px, CAMERA.fy_px * CAMERA.height_m
    top, bottom = (int(min(horizon + at_1_m / max(away_m, 0.5), 240)) for away_m in (ahead_m + 8, ahead_m))
    lit = np.arange(320) // 20 % 2 == 0 if girders else np.zeros(320, bool)
    image[top:bottom, ~lit] *= shade
    px_per_m = CAMERA.fy_px / max(ahead_m, 2.0)
    above, below = (max(int(horizon - height_m * px_per_m), 0) for height_m in (6.0, 4.5))
    image[above:below] = 40
    for left_m in (-9.0, -3.5, 5.0, 9.0):
        column = int(CAMERA.cx_px - left_m * px_per_m)
        image[below:bottom, max(column - 2, 0) : max(column + 2, 0)] = 45
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("girders", [False, True])
@pytest.mark.parametrize("shade", [0.15, 0.5])
def test_the_shadow_of_a_bridge_over_the_road_is_no_dirt(shade: float, girders: bool) -> None:
    statistician = ImageStatistician(CAMERA.horizon_row_px / CAMERA.height_px)
    for number, ahead_m in enumerate(np.arange(12.0, -2.0, -0.4)):  # at 10 m/s
        image = image_at_bridge(float(ahead_m), shade=shade, girders=girders, seed=number)
        t_s = 0.04 * number
        assert statistician.step(Frame(t_s=t_s, image=image), now_s=t_s).spots == 0.0


def test_noise_with_coinciding_dark_spots_is_no_dirt():
    statistician, lots = ImageStatistician(), np.random.default_rng(0)
    for number in range(20):
        image = lots.integers(40, 220, (24, 32, 3), dtype=np.uint8)
        assert statistician.step(Frame(t_s=0.04 * number, image=image), now_s=0.04 * number).spots == 0.0


@pytest.mark.parametrize("loop", [1, 2, 7])
def test_a_loop_of_images_is_a_frozen_camera(loop):
    statistician = ImageStatistician()
    seen = [
        statistician.step(Frame(t_s=0.04 * number, image=scene(number % loop)), now_s=0.04 * number).frozen_s
        for number in range(3 * loop + 2)
    ]
    since_s = np.maximum(np.arange(3 * loop + 2) - (loop - 1), 0) * 0.04
    assert seen == pytest.approx(list(since_s))


@pytest.mark.parametrize("period_s", [0.25, 0.5, 1.0])
def test_dark_spots_of_a_slow_camera_that_move_are_no_dirt(period_s):
    statistician, few = ImageStatistician(), blots(slice(None)) & (np.arange(320) < 80)
    for number in range(20):
        image, t_s = 100 + scene(number) // 8, period_s * number
        moved = np.roll(few, 20 * number, axis=(0, 1))
        image[moved] = image[moved] // 4
        assert statistician.step(Frame(t_s=t_s, image=image), now_s=t_s).spots == 0.0


def test_spots_of_a_slow_camera_are_dirt_after_three_frames():
    few, statistician, seen = blots(slice(None)) & (np.arange(320) < 80), ImageStatistician(), []
    for number in range(6):
        image = 100 + scene(number) // 8
        image[few] = image[few] // 4
        seen.append(statistician.step(Frame(t_s=0.5 * number, image=image), now_s=0.5 * number).spots)
    assert seen[:3] == [0.0] * 3 and min(seen[3:]) > 0.2
