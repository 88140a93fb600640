"""The strips for the training of the lead detector, and the scores of detections."""

import numpy as np
import pytest

from learning.lead.frames import MAX_VEHICLES, labels, lead_samples, near_end
from learning.lead.scores import calibrate, match, scores
from sim_harness.scenarios.traffic import BODIES
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CAR = next(iter(BODIES.values()))
TRUTH = np.array([[10, 0, 1.8, 1], [20, 3, 2, 1], [30, -2, 2, 0.2], [np.nan] * 4], np.float32)


def test_the_same_seed_gives_the_same_strips():
    one, two = lead_samples(3, CAMERA, frames=3), lead_samples(3, CAMERA, frames=3)
    for a, b in zip(one, two, strict=True):
        assert np.array_equal(a.strips, b.strips) and np.array_equal(a.vehicles, b.vehicles, equal_nan=True)


def test_the_label_is_the_nearer_end_in_the_frame_of_the_camera():
    pose = (15.0, 0.4, 0.0)
    ahead, left, width, visible = labels(CAMERA, [(pose, CAR)])[0]
    x_m, y_m = near_end(pose, CAR)
    assert (ahead, left) == pytest.approx((x_m - CAMERA.x_m, y_m - CAMERA.y_m), abs=1e-5)
    assert x_m < pose[0] and width == pytest.approx(CAR.width_m) and visible == pytest.approx(1.0)


def test_a_vehicle_behind_another_is_hidden():
    rows = labels(CAMERA, [((25.0, 0.0, 0.0), CAR), ((12.0, 0.0, 0.0), CAR)])
    assert rows.shape == (MAX_VEHICLES, 4) and rows[0, 3] > 0.9 and rows[1, 3] < 0.3


def test_matches_pair_a_vehicle_once_and_ask_only_for_visible_ones():
    found = [(10.2, 0.1, 1.8, 0.9), (10.4, 0.1, 1.8, 0.5), (35.0, 5.0, 2.0, 0.4)]
    pairs = match(TRUTH, found, reach_m=40.0)
    assert [(pair.true is not None, pair.found is not None, pair.asked) for pair in pairs] == [
        (True, True, True),
        (False, True, True),
        (False, True, True),
        (True, False, True),
        (True, False, False),
    ]
    result = scores(pairs, min_probability=0.45)
    assert result["vehicles"] == 2 and result["recall"] == 0.5 and result["precision"] == 0.5
    assert result["distance_bias_percent"] == pytest.approx(100 * np.log(1.02), abs=1e-3)


def test_calibration_lowers_a_boastful_probability():
    rng = np.random.default_rng(0)
    pairs = []
    for right in rng.random(600) < 0.5:
        place = (10.0, 0.0, 1.8, 0.9) if right else (18.0, 0.0, 1.8, 0.9)
        pairs += match(TRUTH[:1], [place], reach_m=40.0)
    assert calibrate(pairs)(0.9) == pytest.approx(0.5, abs=0.06)
