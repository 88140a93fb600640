"""The CNN estimator with the shipped weights on rendered frames of the shipped circuit."""

import dataclasses
import math

import cv2
import numpy as np
import pytest
from net_rig import CAMERA, SETTINGS, VEHICLE, measurements, step

from perception.lane.settings import steering_settings
from perception.net.steer_net import Outputs, SteerNet
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.messages import Frame

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
        ahead = road.curvature_at(station + steering_settings().lookahead_m)
        shots.append((Frame(t_s=0.04 * index, image=image), offset, heading, ahead))
    return shots


def test_on_the_circuit_the_lane_is_near_the_truth(net, drive):
    found = [net.step(frame, None, now_s=frame.t_s) for frame, *_ in drive]
    assert all(estimate.confidence > 0 for estimate in found)
    offset, heading, ahead = np.array([truth for _, *truth in drive]).T
    assert np.median(np.abs([f.lateral_offset_m for f in found] - offset)) < 0.15
    assert np.median(np.abs([f.heading_error_rad for f in found] - heading)) < math.radians(1.5)
    assert np.corrcoef([f.curvature_1pm for f in found], ahead)[0, 1] > 0.9


def test_on_straights_the_road_wheel_angle_is_that_of_the_true_pose(net, drive):
    reach = steering_settings().lookahead_m
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


def fade(image: np.ndarray, kind: str, strength: float) -> np.ndarray:
    """``image`` in the dark, in fog or over-exposed; 0 leaves it, 1 removes it completely."""
    grey = {"dark": 0.0, "fog": 205.0, "glare": 255.0}[kind]
    return cv2.addWeighted(image, 1 - strength, np.full_like(image, grey), strength, 0)


@pytest.mark.parametrize("kind", ["dark", "fog", "glare"])
def test_confidence_falls_to_zero_as_the_road_fades(net, drive, kind):
    confidence = [
        np.mean([step(net, fade(frame.image, kind, strength)).confidence for frame, *_ in drive[::4]])
        for strength in (0.0, 0.97, 1.0)
    ]
    assert confidence[0] > confidence[1] > confidence[2] == 0


@pytest.mark.parametrize("output", range(5))
def test_an_output_that_is_not_finite_is_no_estimate(net, drive, monkeypatch, output):
    ones = np.ones(1, np.float32)
    outputs = [
        np.array([[0, 0, 0, 0, 3.3]], np.float32),
        0.01 * ones,
        ones,
        0.01 * ones,
        np.ones((1, 3), np.float32),
    ]
    outputs[output] = outputs[output] * np.float32("nan")
    monkeypatch.setattr(net, "_network", lambda images: Outputs(*outputs))
    estimate = net.step(drive[0][0], None, now_s=0.0)
    assert estimate.confidence == 0 and "not finite" in estimate.reason
    assert set(measurements(estimate)) == {None}


def test_another_camera_mounting_gives_the_same_lane(net):
    road = load_road("circuit")
    other = CAMERA.model_copy(
        update=dict(height_m=1.6, pitch_down_rad=0.17, x_m=1.6, y_m=0.2, fx_px=210.0, fy_px=210.0)
    )
    there = SteerNet(SETTINGS, other, VEHICLE)
    renderers = Renderer(road, CAMERA, seed=5), Renderer(road, other, seed=5)
    offsets = []
    for index, station in enumerate(np.linspace(5, 100, 12)):
        x, y = road.position(station, OFFSETS_M[index % 3])
        here = (x, y, road.heading_at(station))
        images = (each.render(*here, t_s=0.0, station_m=station) for each in renderers)
        pair = [step(estimator, image) for estimator, image in zip((net, there), images, strict=True)]
        offsets.append([estimate.lateral_offset_m for estimate in pair])
    here_m, there_m = np.array(offsets, float).T
    assert np.median(np.abs(here_m - there_m)) < 0.2


def test_the_estimate_has_the_frame_time_and_no_lines(net, drive):
    frame = drive[3][0]
    estimate = net.step(frame, None, now_s=5.0)
    assert estimate.t_s == frame.t_s and estimate.estimator == "cnn" and estimate.latency_ms is None
    assert estimate.lanes_detected == 0 and estimate.marked is None
    assert estimate.left_boundary_px == estimate.right_boundary_px == ()


def test_every_field_of_an_estimate_is_finite_or_absent(net, drive):
    for frame, *_ in drive:
        for value in dataclasses.asdict(net.step(frame, None, now_s=0.0)).values():
            assert not isinstance(value, float) or math.isfinite(value)
