"""The CNN estimator with the shipped weights: images without a road, weights and their record."""

import hashlib
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from net_rig import CAMERA, SETTINGS, VEHICLE, measurements, step

from perception.lane.settings import steering_settings
from perception.net.session import load_record
from perception.net.steer_net import (
    Network,
    Outputs,
    SteerNet,
    SteerNetRecord,
    SteerNetSettings,
    World,
    ahead_sigma_m,
)
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.drawn import UNMARKED, MarkingKind, random_section
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.config import ROOT, InputError
from trepid.messages import SIGMA_AHEAD_M

WEIGHTS = ROOT / SETTINGS.weights
NARROW = np.array([[0.0, 0.0, 0.0, 0.0, 2.6]], np.float32)  # a lane: 3.9 m wide from 1.5 times the height


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


def test_weights_of_another_layout_are_refused(tmp_path: Path):
    image = onnx.helper.make_tensor_value_info("image", onnx.TensorProto.UINT8, ["n", 66, 200, 3])
    lane = onnx.helper.make_tensor_value_info("lane", onnx.TensorProto.FLOAT, [4])
    value = onnx.helper.make_tensor("value", onnx.TensorProto.FLOAT, [4], [0.0] * 4)
    graph = onnx.helper.make_graph(
        [onnx.helper.make_node("Constant", [], ["lane"], value=value)], "four", [image], [lane]
    )
    path = tmp_path / "four.onnx"
    model = onnx.helper.make_model(graph, opset_imports=[onnx.helper.make_opsetid("", 17)], ir_version=8)
    path.write_bytes(model.SerializeToString())
    with pytest.raises(InputError, match=r"four\.onnx: its lane has 4 numbers, not 5"):
        Network(path)


def test_a_record_of_other_weights_is_refused(tmp_path: Path):
    weights = tmp_path / "steer_net.onnx"
    weights.write_bytes(WEIGHTS.read_bytes() + b"\0")
    record = json.loads(WEIGHTS.with_suffix(".json").read_text(encoding="utf-8"))
    weights.with_suffix(".json").write_text(json.dumps(record), encoding="utf-8")
    with pytest.raises(InputError, match="other weights"):
        load_record(weights, SteerNetRecord)


def test_the_record_contains_training_and_scores_of_the_shipped_weights():
    record: SteerNetRecord = load_record(WEIGHTS, SteerNetRecord)
    assert record.sha256 == hashlib.sha256(WEIGHTS.read_bytes()).hexdigest()
    assert record.command.startswith("trepid train-lane") and record.date and record.versions["torch"]
    assert record.recipe["seed"] is not None and record.scores["test_roads"]["road_wheel_angle_deg"] > 0
    weights = record.parameters + record.training["carriageway_parameters"]
    assert weights <= 300_000 and WEIGHTS.stat().st_size <= 2_000_000


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


def test_the_width_of_a_lane_is_measured_in_the_world_of_the_camera(net: SteerNet):
    road = load_road("circuit")
    for station_m in (10.0, 30.0, 60.0):
        x_m, y_m = road.position(station_m, 0.2)
        image = Renderer(road, CAMERA, seed=0).render(
            x_m, y_m, road.heading_at(station_m), t_s=0.0, station_m=station_m
        )
        one = step(net, image)
        assert one.lane_width_m == pytest.approx(road.width_at(station_m), abs=0.4)
        higher = CAMERA.model_copy(update=dict(height_m=1.2 * CAMERA.height_m))
        other = step(SteerNet(SETTINGS, higher, VEHICLE), image)
        assert other.lane_width_m == pytest.approx(1.2 * one.lane_width_m)


@pytest.mark.parametrize(
    ("width_m", "share"), [(1.9, 0), (2.25, 0.5), (2.5, 1), (3.5, 1), (4.5, 1), (4.9, 0.5), (5.5, 0)]
)
def test_the_confidence_depends_on_a_width_that_lanes_have(width_m: float, share: float):
    assert SETTINGS.width_share(width_m) == pytest.approx(share)


def road_for_both_ways(kind: MarkingKind, half_m: float, *, seed: int) -> Road:
    """A straight road without lines, of two halves of ``half_m``."""
    section = random_section(kind, np.random.default_rng(seed)).model_copy(update={"paved_left_m": half_m})
    straight = (Segment(length_m=120.0, curvature_1pm=0.0),)
    return Road(
        RoadSettings(name="halves", closed=False, lane_width_m=half_m, segments=straight, sections=(section,))
    )


@pytest.mark.parametrize("kind", sorted(UNMARKED))
@pytest.mark.parametrize("half_m", [2.8, 3.1, 3.4])
def test_in_its_half_of_a_road_for_both_ways_without_a_line_the_network_is_right_and_sure(
    net: SteerNet, half_m: float, kind: MarkingKind
):
    road = road_for_both_ways(kind, half_m, seed=5)
    for offset_m in (-0.2, 0.0, 0.2):
        place = road.position(20.0, offset_m)
        seen = step(net, Renderer(road, CAMERA, seed=3).render(*place, 0.0, t_s=0.0, station_m=20.0))
        assert seen.confidence > 0.5
        assert seen.lateral_offset_m == pytest.approx(offset_m, abs=half_m / 4)
        assert seen.lane_width_m == pytest.approx(half_m, rel=0.25)


def test_a_lane_that_is_too_narrow_for_the_car_is_none_unless_the_camera_is_assumed():
    road = load_road("circuit")
    image = Renderer(road, CAMERA, seed=0).render(
        *road.position(30.0, 0.0), road.heading_at(30.0), t_s=0.0, station_m=30.0
    )
    low = CAMERA.model_copy(update=dict(height_m=CAMERA.height_m / 2))
    assert step(SteerNet(SETTINGS, low, VEHICLE, assumed=True), image).confidence > 0.1
    refused = step(SteerNet(SETTINGS, low, VEHICLE), image)
    assert set(measurements(refused)) == {None} and "m wide" in refused.reason


@pytest.mark.parametrize("wheelbase_m", [VEHICLE.wheelbase_m / 2, 2 * VEHICLE.wheelbase_m])
def test_a_car_of_any_wheelbase_is_as_sure_of_the_same_lane(net: SteerNet, wheelbase_m: float):
    road = load_road("circuit")
    image = Renderer(road, CAMERA, seed=0).render(
        *road.position(30.0, 0.3), road.heading_at(30.0), t_s=0.0, station_m=30.0
    )
    other = SteerNet(SETTINGS, CAMERA, VEHICLE.model_copy(update=dict(wheelbase_m=wheelbase_m)))
    usual, seen = step(net, image), step(other, image)
    assert replace(seen, road_wheel_angle_rad=None) == replace(usual, road_wheel_angle_rad=None)
    assert math.tan(seen.road_wheel_angle_rad) / wheelbase_m == pytest.approx(
        math.tan(usual.road_wheel_angle_rad) / VEHICLE.wheelbase_m
    )


def test_the_confidence_of_the_default_car_is_that_of_two_degrees_of_its_wheels():
    calibration = load_record(WEIGHTS, SteerNetRecord).calibration
    assert calibration.wheelbase_m == VEHICLE.wheelbase_m
    assert calibration.tolerance_rad == pytest.approx(math.radians(2.0))


def test_through_another_camera_it_is_the_network_of_that_camera():
    road = load_road("circuit")
    image = Renderer(road, CAMERA, seed=0).render(
        *road.position(30.0, 0.0), road.heading_at(30.0), t_s=0.0, station_m=30.0
    )
    other = CAMERA.model_copy(update=dict(height_m=1.1 * CAMERA.height_m, fx_px=0.95 * CAMERA.fx_px))
    network = SteerNet(SETTINGS, CAMERA, VEHICLE)
    before = step(network, image)
    assert step(network.through(other), image) == step(SteerNet(SETTINGS, other, VEHICLE), image) != before
    assert step(network, image) == before


@pytest.mark.parametrize(
    "wrong", [{"lane_width_m": [2.0, 3.0, 3.0, 4.0]}, {"both_ways_m": [5.0, 4.0, 7.0, 8.0]}]
)
def test_widths_have_to_increase(wrong: dict[str, list[float]]):
    with pytest.raises(ValueError, match=f"{next(iter(wrong))}: expected increasing widths"):
        SteerNetSettings.model_validate(SETTINGS.model_dump() | wrong)


@pytest.mark.parametrize("kind", sorted(UNMARKED))
@pytest.mark.parametrize("half_m", [2.8, 3.1, 3.4])
def test_in_the_middle_of_a_road_for_both_ways_without_a_line_the_network_is_not_sure(
    net: SteerNet, half_m: float, kind: MarkingKind
):
    road = road_for_both_ways(kind, half_m, seed=8)
    for offset_m in (half_m / 2 - 0.2, half_m / 2, half_m / 2 + 0.2):
        place = road.position(20.0, offset_m)
        seen = step(net, Renderer(road, CAMERA, seed=4).render(*place, 0.0, t_s=0.0, station_m=20.0))
        assert seen.confidence < 0.5


def road_of(width_m: float, offset_m: float, *, bare: float = 1.0) -> Outputs:
    """A sure lane about the car, on a road of ``width_m`` whose middle is ``offset_m`` to its right."""
    ones = np.ones(1, np.float32)
    lane = np.array([[0.0, 0.0, 0.0, 0.0, 3.3]], np.float32)
    return Outputs(lane, 1e-4 * ones, ones, 0 * ones, np.array([[offset_m, width_m, bare]], np.float32))


@pytest.mark.parametrize(
    ("road", "sure"),
    [
        (road_of(6.0, 0.0), False),
        (road_of(6.0, 0.5), False),
        (road_of(6.0, 1.5), True),  # in its half
        (road_of(6.0, -1.5), True),
        (road_of(4.0, 0.0), True),  # one lane
        (road_of(9.0, 0.0), True),  # the mouth of a side road
        (road_of(6.0, 0.0, bare=0.0), True),  # between lines
    ],
)
def test_a_lane_in_the_middle_of_a_road_without_lines_is_none_where_the_road_has_two(
    monkeypatch: pytest.MonkeyPatch, road: Outputs, sure: bool
):
    net = SteerNet(SETTINGS, CAMERA, VEHICLE)
    monkeypatch.setattr(net, "_network", lambda images: road)
    seen = step(net, np.full((240, 320, 3), 90, np.uint8))
    assert (seen.confidence > 0.9) is sure
    if not sure:
        assert seen.confidence == 0 and "middle of a road for both ways" in seen.reason


def test_the_width_of_a_road_is_that_in_the_world_of_the_camera(monkeypatch: pytest.MonkeyPatch):
    high = CAMERA.model_copy(update=dict(height_m=1.5 * CAMERA.height_m))
    image = np.full((240, 320, 3), 90, np.uint8)
    found = []
    for camera, assumed in ((CAMERA, False), (high, False), (high, True)):
        net = SteerNet(SETTINGS, camera, VEHICLE, assumed=assumed)
        monkeypatch.setattr(net, "_network", lambda images: road_of(4.0, 0.0)._replace(lanes=NARROW))
        found.append(step(net, image).confidence > 0.5)
    assert found == [True, False, True]  # 4 m, 6 m, of a height that is not known


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
    record = json.loads(WEIGHTS.with_suffix(".json").read_text())
    assert record["recipe"]["command_lookahead_m"] == steering_settings().lookahead_m
