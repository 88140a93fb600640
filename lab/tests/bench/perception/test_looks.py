import numpy as np
import pytest

from lab.bench.perception.fit_which_lane import Samples, is_right, margin
from lab.bench.perception.looks import looks, with_lamps
from perception.camera.self_calibration import calibrate_by_images
from perception.estimators import lane_cv_settings
from perception.lane.which_lane import WhichLane
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame

pytestmark = pytest.mark.long

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


def test_the_same_seed_draws_the_same_looks_and_every_second_one_is_mirrored():
    first, again = list(looks(5, 2)), list(looks(5, 2))
    assert all(np.array_equal(a.image, b.image) for a, b in zip(first, again, strict=True))
    for look in first:
        assert look.left_px[0, 0] < look.right_px[0, 0]


def test_lamps_are_white_spots_of_the_road_in_some_of_the_looks():
    rng, dark = np.random.default_rng(1), np.full((360, 480, 3), 60, np.uint8)
    camera = CAMERA.resize(480, 360)
    brightest = [int(with_lamps(dark, camera, rng).max()) for _ in range(60)]
    lit = [level for level in brightest if level > 60]
    assert 3 < len(lit) < 25 and max(lit) > 200
    assert all(with_lamps(dark, camera, rng)[:100].max() == 60 for _ in range(20))  # above the horizon


def test_most_lanes_of_drawn_streets_are_right_on_both_sides_of_the_traffic():
    settings, vehicle = lane_cv_settings(), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    right = []
    for look in looks(1, 12):
        finder = WhichLane(settings, calibrate_by_images([look.image], settings.self_calibration), vehicle)
        seen = finder.step(Frame(t_s=0.0, image=look.image), None, now_s=0.0)
        right.append((look.number % 2, is_right(seen, look)))
    assert all(sum(good for side, good in right if side == one) >= 4 for one in (0, 1))


def test_the_margin_grows_until_a_family_that_is_left_out_keeps_the_bound():
    rng = np.random.default_rng(2)
    x = rng.normal(size=200)
    inputs, family = np.column_stack([np.ones(200), x]), np.repeat(["a", "b"], 100)
    easy = Samples(inputs, x > 0, family)
    hard = Samples(inputs, (x > 0) & ~((family == "b") & (rng.random(200) < 0.6)), family)
    assert margin(easy) < 0.5 < margin(hard)
