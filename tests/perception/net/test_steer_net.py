"""The CNN estimator with the shipped weights: images without a road, weights and their record."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from net_rig import CAMERA, SETTINGS, VEHICLE, measurements, step

from perception.lane.settings import LaneCvSettings
from perception.net.session import load_record
from perception.net.steer_net import Record, SteerNet, World, ahead_sigma_m
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from trepid.messages import SIGMA_AHEAD_M

WEIGHTS = ROOT / SETTINGS.weights


@pytest.fixture(scope="module")
def net() -> SteerNet:
    return SteerNet(SETTINGS, CAMERA, VEHICLE)


def nonsense() -> dict[str, np.ndarray]:
    rng = np.random.default_rng(3)
    rows = np.linspace(0, 255, 240)[:, None, None] * np.ones((1, 320, 3))
    return {
        "black": np.zeros((240, 320, 3), np.uint8),
        "white": np.full((240, 320, 3), 255, np.uint8),
        "grey": np.full((240, 320, 3), 120, np.uint8),
        "noise": rng.integers(0, 256, (240, 320, 3), dtype=np.uint8),
        "faint noise": rng.integers(0, 8, (240, 320, 3), dtype=np.uint8),
        "gradient": rows.astype(np.uint8),
        "checkers": np.kron(np.indices((12, 16)).sum(axis=0) % 2, np.full((20, 20), 255))[..., None]
        .repeat(3, axis=2)
        .astype(np.uint8),
    }


@pytest.mark.parametrize("kind", nonsense())
def test_an_image_without_a_road_gives_no_estimate_and_a_reason(net, kind):
    estimate = step(net, nonsense()[kind])
    assert estimate.confidence == 0
    assert set(measurements(estimate)) == {None}
    assert estimate.reason


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((120, 160, 3), np.uint8),
        np.zeros((240, 320), np.uint8),
        np.zeros((240, 320, 3), np.float32),
        np.zeros((0, 0, 3), np.uint8),
    ],
)
def test_an_image_of_another_kind_is_refused_with_a_reason(net, image):
    estimate = step(net, image)
    assert estimate.confidence == 0 and "not uint8 (240, 320, 3)" in estimate.reason


def test_missing_weights_name_the_file():
    settings = SETTINGS.model_copy(update=dict(weights="perception/weights/nowhere.onnx"))
    with pytest.raises(InputError, match=r"nowhere\.onnx.*trepid train-lane"):
        SteerNet(settings, CAMERA, VEHICLE)


def test_weights_that_are_no_network_are_refused(tmp_path: Path):
    weights = tmp_path / "steer_net.onnx"
    weights.write_bytes(b"no network at all")
    settings = SETTINGS.model_copy(update=dict(weights=str(weights)))
    with pytest.raises(InputError, match=r"steer_net\.onnx: not an ONNX network"):
        SteerNet(settings, CAMERA, VEHICLE)


def test_a_record_of_other_weights_is_refused(tmp_path: Path):
    weights = tmp_path / "steer_net.onnx"
    weights.write_bytes(WEIGHTS.read_bytes() + b"\0")
    record = json.loads(WEIGHTS.with_suffix(".json").read_text(encoding="utf-8"))
    weights.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(InputError, match="other weights"):
        load_record(weights, Record)


def test_the_record_contains_training_and_scores_of_the_shipped_weights():
    record: Record = load_record(WEIGHTS, Record)
    assert record.sha256 == hashlib.sha256(WEIGHTS.read_bytes()).hexdigest()
    assert record.command.startswith("trepid train-lane") and record.date and record.versions["torch"]
    assert record.recipe["seed"] is not None and record.scores["test_roads"]["road_wheel_angle_deg"] > 0
    assert record.parameters <= 300_000 and WEIGHTS.stat().st_size <= 2_000_000


def test_the_deviation_of_the_lane_is_that_of_the_arc_at_the_look_ahead_and_never_smaller_elsewhere():
    sigma_m = ahead_sigma_m(0.01, 10.0)
    by_distance = dict(zip(SIGMA_AHEAD_M, sigma_m, strict=True))
    assert by_distance[10.0] == pytest.approx(0.01 * 10.0**2 / 2)
    assert by_distance[0.0] == by_distance[10.0]
    assert by_distance[20.0] == pytest.approx(4 * by_distance[10.0])


def test_a_road_of_the_simulator_is_in_the_world_of_the_network(net: SteerNet):
    road = load_road("circuit")
    image = Renderer(road, CAMERA, seed=0).render(
        *road.position(30.0, 0.0), road.heading_at(30.0), t_s=0.0, station_m=30.0
    )
    assert step(net, image).confidence > 0.8


def test_outside_its_world_the_network_gives_no_estimate_and_the_reason(tmp_path: Path):
    record = json.loads(WEIGHTS.with_suffix(".json").read_text(encoding="utf-8"))
    record["world"] = {"near": 1e-6, "far": 2e-6}
    weights = tmp_path / "steer_net.onnx"
    weights.write_bytes(WEIGHTS.read_bytes())
    weights.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")
    strict = SteerNet(SETTINGS.model_copy(update=dict(weights=str(weights))), CAMERA, VEHICLE)
    road = load_road("circuit")
    image = Renderer(road, CAMERA, seed=0).render(
        *road.position(30.0, 0.0), road.heading_at(30.0), t_s=0.0, station_m=30.0
    )
    estimate = step(strict, image)
    assert set(measurements(estimate)) == {None} and estimate.confidence == 0
    assert "unlike those of the training" in estimate.reason


def test_the_share_of_the_world_falls_from_near_to_far_and_never_rises():
    world = World(near=0.1, far=0.2)
    assert [world.share(distance) for distance in (0.0, 0.1, 0.15, 0.2, 1.0)] == pytest.approx(
        [1, 1, 0.5, 0, 0]
    )


def test_both_estimators_aim_at_the_same_point_ahead():
    assert load(CONFIG_DIR / "perception.yaml", LaneCvSettings).steering.lookahead_m == SETTINGS.lookahead_m
