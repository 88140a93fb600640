"""The strips for the training of the lead detector, and the scores of detections."""

import numpy as np
import pytest

from learning.lead.frames import (
    CLEAR,
    FARTHEST_M,
    HIDDEN,
    MAX_VEHICLES,
    MIN_VISIBLE,
    SEEN_GREY,
    WEIGHTS,
    _lane_left_m,
    apparent_label,
    labels,
    lead_road,
    near_end,
)
from learning.lead.scores import (
    FrameMatches,
    by_distance,
    by_weather,
    calibrate,
    false_leaders,
    match,
    scores,
)
from perception.lead.view import COLUMNS, DISTANCES_M, ROWS, STRIPS
from sim_harness.scenarios.traffic import BODIES
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CAR = next(iter(BODIES.values()))
TRUTH = np.array([[10, 0, 1.8, 1], [20, 3, 2, 1], [30, -2, 2, 0.2], [np.nan] * 4], np.float32)


def test_the_same_seed_gives_the_same_strips():
    one, two = lead_road(3, CAMERA, frames=6), lead_road(3, CAMERA, frames=6)
    assert one.weather == two.weather and len(one.samples) == 6
    for a, b in zip(one.samples, two.samples, strict=True):
        assert np.array_equal(a.strips, b.strips) and np.array_equal(a.vehicles, b.vehicles, equal_nan=True)


def test_every_frame_with_vehicles_has_a_twin_that_differs_by_the_vehicles_only():
    road = lead_road(3, CAMERA, frames=6)
    for full, empty in zip(road.samples[::2], road.samples[1::2], strict=True):
        assert np.isfinite(full.vehicles[:, 0]).any() and np.isnan(empty.vehicles).all()
        changed = (full.strips != empty.strips).any(axis=(1, 2, 3))
        seen = full.vehicles[full.vehicles[:, 3] > 0.6]
        for ahead_m, left_m, _, _ in seen[np.abs(seen[:, 1]) < 6.0]:
            assert changed[np.abs(DISTANCES_M - ahead_m).argmin()], (ahead_m, left_m)


def test_vehicles_are_labelled_up_to_the_last_strip_and_every_weather_is_drawn():
    roads = [lead_road(seed, CAMERA, frames=6) for seed in range(14)]
    ahead_m = np.concatenate([one.vehicles[:, 0] for road in roads for one in road.samples])
    ahead_m = ahead_m[np.isfinite(ahead_m)]
    assert DISTANCES_M[-1] == FARTHEST_M and 0.15 < np.mean(ahead_m > 60.0) < 0.4
    drawn = {name for road in roads for name in road.weather}
    assert drawn - {CLEAR} <= {kind.value for kind, weight in WEIGHTS.items() if weight > 0}
    assert len(drawn) > 8 and CLEAR in drawn


@pytest.mark.parametrize("radius_m", [40.0, -90.0])
def test_the_own_lane_is_labelled_on_every_strip(radius_m):
    arc = Segment(length_m=200.0, curvature_1pm=1 / radius_m)
    road = Road(
        RoadSettings.model_validate(
            dict(
                name="arc",
                closed=False,
                lane_width_m=3.3,
                segments=(arc,),
                sections=(dict(name="arc", start_m=0.0),),
            )
        )
    )
    found_m = _lane_left_m(road, 0.0, (0.0, 0.0, 0.0), CAMERA)
    ahead_m = DISTANCES_M + CAMERA.x_m
    near = ahead_m < 0.9 * abs(radius_m)
    circle_m = radius_m - np.sign(radius_m) * np.sqrt(radius_m**2 - ahead_m[near] ** 2)
    assert found_m.shape == (STRIPS,) and found_m[near] == pytest.approx(circle_m - CAMERA.y_m, abs=0.1)


def test_the_label_is_the_nearer_end_in_the_frame_of_the_camera():
    pose = (15.0, 0.4, 0.0)
    ahead, left, width, visible = labels(CAMERA, [(pose, CAR)])[0]
    x_m, y_m = near_end(pose, CAR)
    assert (ahead, left) == pytest.approx((x_m - CAMERA.x_m, y_m - CAMERA.y_m), abs=1e-5)
    assert x_m < pose[0] and width == pytest.approx(CAR.width_m) and visible == pytest.approx(1.0)


def test_a_vehicle_behind_another_is_hidden():
    rows = labels(CAMERA, [((25.0, 0.0, 0.0), CAR), ((12.0, 0.0, 0.0), CAR)])
    assert rows.shape == (MAX_VEHICLES, 4) and rows[0, 3] > 0.9 and rows[1, 3] < 0.3


def test_on_a_hill_the_label_is_where_the_visible_part_would_stand_on_a_plane():
    pose, difference = (40.0, 1.0, 0.0), np.zeros((CAMERA.height_px, CAMERA.width_px), np.float32)
    ((_, foot_px),) = CAMERA.pixel_from_road([(25.0, 0.0)]).tolist()
    difference[int(foot_px) - 6 : int(foot_px) + 1, 150:158] = 60.0
    ahead, left, width, visible = apparent_label(CAMERA, (pose, CAR), difference)[0]
    x_m, y_m = near_end(pose, CAR)
    assert ahead == pytest.approx(25.0 - CAMERA.x_m, abs=1.5) and visible == 1.0
    assert left / ahead == pytest.approx(y_m / (x_m - CAMERA.x_m), rel=1e-4)
    assert width / ahead == pytest.approx(CAR.width_m / (x_m - CAMERA.x_m), rel=1e-4)
    difference[int(foot_px) - 6 : int(foot_px)] = (
        0.0  # one row: too little to tell, so no label and no lack of one
    )
    assert HIDDEN < apparent_label(CAMERA, (pose, CAR), difference)[0, 3] < MIN_VISIBLE
    assert np.isnan(apparent_label(CAMERA, (pose, CAR), np.zeros_like(difference))).all()


def test_an_exported_network_can_be_trained_further(tmp_path):
    torch = pytest.importorskip("torch")
    from learning.lead.network import ExportedLeadNetwork, LeadNetwork, export, load_network

    torch.manual_seed(0)
    strips = torch.randint(0, 255, (STRIPS, ROWS, COLUMNS, 3), dtype=torch.uint8)
    network = LeadNetwork()
    network(strips)  # moves the normalisation from where it starts
    export(network.eval(), tmp_path / "lead_net.onnx")
    again = load_network(tmp_path / "lead_net.onnx")
    with torch.no_grad():
        assert torch.allclose(
            ExportedLeadNetwork(again)(strips), ExportedLeadNetwork(network)(strips), atol=1e-4
        )


@pytest.mark.parametrize(("grey", "share"), [(0.0, 0.0), (SEEN_GREY / 2, 0.5), (3 * SEEN_GREY, 1.0)])
def test_the_visible_share_falls_with_what_a_vehicle_changes_in_the_image(grey, share):
    difference = np.full((CAMERA.height_px, CAMERA.width_px), grey, np.float32)
    visible = labels(CAMERA, [((12.0, 0.0, 0.0), CAR)], difference=difference)[0, 3]
    assert visible == pytest.approx(share, abs=0.02)


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


def frame(truth, found, weather=("clear",), lane_left_m=0.0):
    lane = np.full(STRIPS, lane_left_m, np.float32)
    return FrameMatches(
        match(np.array(truth, np.float32).reshape(-1, 4), found, reach_m=115.0), lane, weather
    )


def test_a_false_leader_lies_in_the_own_lane_of_an_empty_frame():
    phantom = (20.0, 0.5, 1.8, 0.9)
    ahead, beside = frame([], [phantom]), frame([], [phantom], lane_left_m=-2.0)
    unsure, beyond = frame([], [(*phantom[:3], 0.4)]), frame([], [(120.0, *phantom[1:])])
    behind_another = frame([(10, 0, 1.8, 1)], [phantom])
    assert false_leaders([ahead], min_probability=0.5) == 1000
    for other in (beside, unsure, beyond):
        assert false_leaders([ahead, other], min_probability=0.5) == 500
    assert np.isnan(false_leaders([behind_another], min_probability=0.5))


def test_scores_are_split_by_distance_and_by_weather():
    hit, missed = (
        frame([(30, 0, 1.8, 1)], [(31, 0, 1.8, 0.9)]),
        frame([(100, 0, 1.8, 1)], [], ("rain", "fog")),
    )
    bands = by_distance([*hit.matches, *missed.matches], min_probability=0.5)
    assert bands["20 to 40 m"]["recall"] == 1 and bands["90 to 115 m"]["recall"] == 0
    assert sum(row["vehicles"] for row in bands.values()) == 2
    rows = by_weather([hit, missed, frame([], [(9, 0, 1.8, 0.9)], ("rain",))], min_probability=0.5)
    assert {name: row["recall"] for name, row in rows.items()} == {"clear": 1, "fog": 0, "rain": 0}
    assert rows["rain"]["false_leaders_per_1000_frames"] == 1000
    assert rows["rain"]["frames"] == 2
