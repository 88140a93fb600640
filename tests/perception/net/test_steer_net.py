"""Claims about the CNN estimator with the shipped weights, on frames of the shipped circuit."""

import dataclasses
import hashlib
import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from perception.lane.settings import LaneCvSettings
from perception.net.steer_net import Record, SteerNet, SteerNetSettings, load_record
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from trepid.messages import Frame, SteeringEstimate
from trepid.vehicle import Vehicle

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SETTINGS = load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings)
WEIGHTS = ROOT / SETTINGS.weights
OFFSETS_M = (0.0, 0.35, -0.35)
HEADINGS_RAD = (0.0, -0.04, 0.04)


@pytest.fixture(scope="module")
def net() -> SteerNet:
    return SteerNet(SETTINGS, CAMERA, VEHICLE)


@pytest.fixture(scope="module")
def drive() -> list[tuple[Frame, float, float, float]]:
    """Frames around the circuit with their true offset, heading error and curvature at the look-ahead."""
    road = load_road("circuit")
    renderer = Renderer(road, CAMERA, seed=5)
    shots = []
    for index, station in enumerate(np.linspace(3, road.length_m - 20, 45)):
        offset, heading = OFFSETS_M[index % 3], HEADINGS_RAD[index // 3 % 3]
        x, y = road.position(station, offset)
        yaw = road.heading_at(station) + heading
        image = renderer.render(x, y, yaw, t_s=0.04 * index, station_m=station)
        ahead = road.curvature_at(station + SETTINGS.lookahead_m)
        shots.append((Frame(t_s=0.04 * index, image=image), offset, heading, ahead))
    return shots


def step(net: SteerNet, image: np.ndarray, t_s: float = 1.0) -> SteeringEstimate:
    return net.step(Frame(t_s=t_s, image=image), None, now_s=t_s)


def measurements(estimate: SteeringEstimate) -> tuple[float | None, ...]:
    return (
        estimate.lateral_offset_m,
        estimate.heading_error_rad,
        estimate.curvature_1pm,
        estimate.curvature_rate_1pm2,
        estimate.road_wheel_angle_rad,
    )


def test_on_the_circuit_the_lane_is_near_the_truth(net, drive):
    found = [net.step(frame, None, now_s=frame.t_s) for frame, *_ in drive]
    assert all(estimate.confidence > 0 for estimate in found)
    offset, heading, ahead = np.array([truth for _, *truth in drive]).T
    assert np.median(np.abs([f.lateral_offset_m for f in found] - offset)) < 0.15
    assert np.median(np.abs([f.heading_error_rad for f in found] - heading)) < math.radians(1.5)
    assert np.corrcoef([f.curvature_1pm for f in found], ahead)[0, 1] > 0.9


def test_on_straights_the_road_wheel_angle_is_that_of_the_true_pose(net, drive):
    reach = SETTINGS.lookahead_m
    for frame, offset, heading, _ in [shot for shot in drive if shot[3] == 0 and shot[0].t_s < 0.16]:
        angle = net.step(frame, None, now_s=0.0).road_wheel_angle_rad
        wanted = math.atan(VEHICLE.wheelbase_m * 2 * (-offset - heading * reach) / reach**2)
        assert angle == pytest.approx(wanted, abs=math.radians(1.0))


def test_a_mirrored_image_shows_the_mirrored_lane(net, drive):
    seen = np.array([measurements(net.step(frame, None, now_s=0.0)) for frame, *_ in drive], float)
    mirrored = np.array([measurements(step(net, frame.image[:, ::-1].copy())) for frame, *_ in drive], float)
    spread = seen.std(axis=0)
    assert np.all(np.median(np.abs(seen + mirrored), axis=0) < 0.5 * spread)
    assert np.all(np.abs(np.mean(seen + mirrored, axis=0)) < 0.25 * spread)


def test_the_result_of_a_frame_does_not_depend_on_earlier_frames(net, drive):
    fresh = SteerNet(SETTINGS, CAMERA, VEHICLE)
    last = drive[-1][0]
    for frame, *_ in drive[:5]:
        net.step(frame, None, now_s=frame.t_s)
    assert net.step(last, None, now_s=9.0) == fresh.step(last, None, now_s=9.0)


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


def faded(image: np.ndarray, kind: str, strength: float) -> np.ndarray:
    """``image`` in the dark, in fog or over-exposed; 0 leaves it, 1 removes it completely."""
    grey = {"dark": 0.0, "fog": 205.0, "glare": 255.0}[kind]
    return cv2.addWeighted(image, 1 - strength, np.full_like(image, grey), strength, 0)


@pytest.mark.parametrize("kind", ["dark", "fog", "glare"])
def test_confidence_falls_to_zero_as_the_road_fades(net, drive, kind):
    confidence = [
        np.mean([step(net, faded(frame.image, kind, strength)).confidence for frame, *_ in drive[::4]])
        for strength in (0.0, 0.97, 1.0)
    ]
    assert confidence[0] > confidence[1] > confidence[2] == 0


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


@pytest.mark.parametrize("output", range(3))
def test_an_output_that_is_not_finite_is_no_estimate(net, drive, monkeypatch, output):
    outputs = [np.zeros((1, 4), np.float32), np.full(1, 0.01, np.float32), np.ones(1, np.float32)]
    outputs[output] = outputs[output] * np.float32("nan")
    monkeypatch.setattr(net, "_network", lambda images: tuple(outputs))
    estimate = net.step(drive[0][0], None, now_s=0.0)
    assert estimate.confidence == 0 and "not finite" in estimate.reason
    assert set(measurements(estimate)) == {None}


def test_another_camera_mounting_gives_the_same_lane(net):
    road = load_road("circuit")
    other = CAMERA.model_copy(
        update=dict(height_m=1.6, pitch_down_rad=0.17, x_m=1.6, y_m=0.2, fx_px=210.0, fy_px=210.0)
    )
    there = SteerNet(SETTINGS, other, VEHICLE)
    eyes = Renderer(road, CAMERA, seed=5), Renderer(road, other, seed=5)
    offsets = []
    for index, station in enumerate(np.linspace(5, 100, 12)):
        x, y = road.position(station, OFFSETS_M[index % 3])
        images = (eye.render(x, y, road.heading_at(station), t_s=0.0, station_m=station) for eye in eyes)
        pair = [step(each, image) for each, image in zip((net, there), images, strict=True)]
        offsets.append([estimate.lateral_offset_m for estimate in pair])
    here_m, there_m = np.array(offsets, float).T
    assert np.median(np.abs(here_m - there_m)) < 0.2


def test_the_estimate_has_the_frame_time_and_no_lines(net, drive):
    frame = drive[3][0]
    estimate = net.step(frame, None, now_s=5.0)
    assert estimate.t_s == frame.t_s and estimate.estimator == "cnn" and estimate.latency_ms is None
    assert estimate.lanes_detected == 0 and estimate.lane_width_m is None
    assert estimate.left_boundary_px == estimate.right_boundary_px == ()


def test_missing_weights_name_the_file():
    settings = SETTINGS.model_copy(update=dict(weights="perception/weights/nowhere.onnx"))
    with pytest.raises(InputError, match=r"nowhere\.onnx.*trepid train"):
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
        load_record(weights)


def test_the_record_contains_training_and_scores_of_the_shipped_weights():
    record: Record = load_record(WEIGHTS)
    assert record.sha256 == hashlib.sha256(WEIGHTS.read_bytes()).hexdigest()
    assert record.command.startswith("trepid train") and record.date and record.versions["torch"]
    assert record.recipe["seed"] is not None and record.scores["test_roads"]["road_wheel_angle_deg"] > 0
    assert record.parameters <= 300_000 and WEIGHTS.stat().st_size <= 2_000_000


def test_both_estimators_aim_at_the_same_point_ahead():
    assert load(CONFIG_DIR / "perception.yaml", LaneCvSettings).steering.lookahead_m == SETTINGS.lookahead_m


def test_every_field_of_an_estimate_is_finite_or_absent(net, drive):
    for frame, *_ in drive:
        for value in dataclasses.asdict(net.step(frame, None, now_s=0.0)).values():
            assert not isinstance(value, float) or math.isfinite(value)
