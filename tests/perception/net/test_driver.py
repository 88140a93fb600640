"""Driving networks at run time: their contract, the angle, its confidence, and the memory of recurrent networks."""

import math
from pathlib import Path

import numpy as np
import pytest
from driving_network_rig import halves, write_network
from hypothesis import given
from hypothesis import strategies as st
from onnx import TensorProto, helper, save
from scipy.stats import norm

from perception.estimators import build, entry_of, name_of
from perception.net.driver import DriverNetwork, DriverRecord, DrivingEstimator
from supervisor.path.fusion import information
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import EstimateKind, Frame, SteeringEstimate

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


def driver(path: Path) -> DrivingEstimator:
    return DrivingEstimator("turn", DriverNetwork(path), VEHICLE)


def step(one: DrivingEstimator, image: np.ndarray, t_s: float = 0.0) -> SteeringEstimate:
    return one.step(Frame(t_s=t_s, image=image), None, now_s=t_s)


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "turn.onnx"


def test_the_angle_is_that_of_the_graph_and_the_lane_fields_are_absent(path):
    estimate = step(driver(write_network(path)), halves(120, 90))
    assert estimate.road_wheel_angle_rad == pytest.approx(30 / 255, abs=1e-6)
    assert estimate.kind is EstimateKind.ANGLE and estimate.estimator == "turn"
    assert estimate.lateral_offset_m is estimate.heading_error_rad is estimate.curvature_1pm is None


def test_a_frame_of_any_size_is_averaged_down_to_the_size_of_the_network(path):
    network = driver(write_network(path))
    angles = [step(network, halves(120, 90, h, w)).road_wheel_angle_rad for h, w in ((12, 16), (97, 206))]
    assert angles == pytest.approx([30 / 255] * 2, abs=1e-3)


@given(scale_rad=st.floats(1e-3, 0.5), q=st.floats(0.5, 5.0))
def test_confidence_is_the_normal_probability_of_an_error_below_two_degrees(scale_rad, q):
    fields = {"kind": "steering", "model": "m", "parameters": 1, "height": 1, "width": 1}
    sigma_rad = q * scale_rad / norm.ppf(0.95)
    expected = norm.cdf(math.radians(2) / sigma_rad) - norm.cdf(-math.radians(2) / sigma_rad)
    confidence = DriverRecord(**fields, interval_90=q).confidence(scale_rad)
    assert confidence == pytest.approx(expected, abs=1e-9)


def test_the_fusion_recovers_the_variance_behind_the_confidence(path):
    sigma_rad = 0.02
    estimate = step(driver(write_network(path, sigma_rad=sigma_rad)), halves(120, 90))
    assert information(estimate.confidence) == pytest.approx((math.radians(2) / sigma_rad) ** 2, rel=1e-3)


def test_the_deviation_ahead_grows_with_that_of_the_angle(path):
    near, far = (
        step(driver(write_network(path, sigma_rad=sigma)), halves(120, 90)) for sigma in (0.01, 0.02)
    )
    assert np.array(far.ahead_sigma_m) == pytest.approx(2 * np.array(near.ahead_sigma_m))
    ratio = VEHICLE.wheelbase_m * math.cos(30 / 255) ** 2
    assert near.ahead_sigma_m[0] == pytest.approx(0.01 / ratio * 8.0**2 / 2, rel=1e-4)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (dict(unlike=1.01), "unlike those of the training"),
        (dict(sigma_rad=1.0), "low confidence"),
        (dict(gain_rad=40.0), "impossible"),
    ],
)
def test_outside_its_world_or_unsure_a_network_gives_no_angle_and_the_reason(path, changes, reason):
    estimate = step(driver(write_network(path, **changes)), halves(120, 90))
    assert estimate.confidence == 0.0 and estimate.road_wheel_angle_rad is None
    assert reason in estimate.reason


@pytest.mark.parametrize(
    ("given_mps", "proposed_mps"), [(1.5, 1.5), (0.0, 0.0), (-0.2, 0.0), (math.nan, None), (math.inf, None)]
)
def test_a_proposed_speed_is_at_least_zero_and_absent_where_it_is_not_finite(path, given_mps, proposed_mps):
    network = driver(write_network(path, speed_mps=given_mps, memory=True))
    assert step(network, halves(120, 90)).speed_mps == proposed_mps


@pytest.mark.parametrize("changes", [dict(unlike=1.01), dict(sigma_rad=1.0)])
def test_a_network_without_an_angle_proposes_no_speed(path, changes):
    assert step(driver(write_network(path, speed_mps=1.5, **changes)), halves(120, 90)).speed_mps is None


def test_a_network_without_the_output_proposes_no_speed(path):
    assert step(driver(write_network(path)), halves(120, 90)).speed_mps is None


def test_the_speed_is_in_metres_of_the_car_at_every_scale(path):
    small = VEHICLE.model_copy(update={"lane_width_m": 0.5})
    entry = entry_of(str(write_network(path, speed_mps=1.5)))
    assert [step(entry.build(CAMERA, one), halves(120, 90)).speed_mps for one in (VEHICLE, small)] == [
        1.5
    ] * 2


@pytest.mark.parametrize("image", [np.zeros((9, 9), np.uint8), np.zeros((9, 9, 3), np.float32)])
def test_an_image_of_another_kind_is_refused_with_a_reason(path, image):
    assert "not uint8" in step(driver(write_network(path)), image).reason


def test_a_recurrent_network_keeps_its_state_from_frame_to_frame(path):
    network, one = driver(write_network(path, memory=True)), 30 / 255
    angles = [step(network, halves(120, 90), t_s).road_wheel_angle_rad for t_s in (0.0, 0.1, 0.2)]
    assert angles == pytest.approx([one / 2, one * 3 / 4, one * 7 / 8], rel=1e-5)


@pytest.mark.parametrize("then_s", [0.7, 0.1, -1.0], ids=["a gap", "the same stamp", "an earlier stamp"])
def test_a_recurrent_network_starts_anew_after_a_gap_or_a_step_back(path, then_s):
    network = driver(write_network(path, memory=True))
    first = step(network, halves(120, 90), 0.1)
    again = step(network, halves(120, 90), then_s)
    assert again.road_wheel_angle_rad == first.road_wheel_angle_rad


def test_a_broken_image_ends_the_memory(path):
    network = driver(write_network(path, memory=True))
    first = step(network, halves(120, 90), 0.0)
    step(network, np.zeros((9, 9), np.uint8), 0.1)
    assert step(network, halves(120, 90), 0.2).road_wheel_angle_rad == first.road_wheel_angle_rad


def test_two_estimators_of_one_file_have_separate_memories(path):
    entry = entry_of(str(write_network(path, memory=True)))
    one, two = entry.build(CAMERA, VEHICLE), entry.build(CAMERA, VEHICLE)
    step(one, halves(120, 90), 0.0)
    later, fresh = (step(e, halves(120, 90), 0.1).road_wheel_angle_rad for e in (one, two))
    assert later == pytest.approx(1.5 * fresh, rel=1e-5)


@pytest.mark.parametrize(
    ("changes", "fault"),
    [
        (dict(without="metadata"), "has no metadata 'trepid'"),
        (dict(record={"kind": "lane"}), "its kind is 'lane', expected 'steering'"),
        (dict(record={"interval_90": -1.0}), "interval_90"),
        (dict(record={"height": None}), "height"),
        (dict(record={"height": 13}), "its input 'image' is"),
        (dict(without="sigma_rad"), "has no output 'sigma_rad'"),
        (dict(without="unlike"), "has no output 'unlike'"),
        (dict(record={"speed": True}), "has no output 'speed_mps'"),
        (dict(without="next_state", memory=True), "expected both"),
        (dict(numbers_out=2, memory=True), "fails on a grey image"),
        (dict(image_type=TensorProto.FLOAT), "expected tensor(uint8)"),
        (dict(sigma_rad=-0.1), "sigma_rad is not positive"),
        (dict(unlike=math.nan), "not finite"),
    ],
)
def test_a_file_that_breaks_the_contract_is_refused_in_one_line(path, changes, fault):
    write_network(path, **changes)
    with pytest.raises(InputError) as refusal:
        DriverNetwork(path)
    text = str(refusal.value)
    assert text.startswith(f"{path}: no driving network: ") and fault in text and "\n" not in text


def test_a_network_that_onnx_runtime_cannot_compute_is_refused_in_one_line(path):
    images, kernel = (helper.make_tensor_value_info(name, TensorProto.DOUBLE, [1, 1, 4, 4]) for name in "xk")
    out = helper.make_tensor_value_info("y", TensorProto.DOUBLE, [1, 1, 1, 1])
    graph = helper.make_graph(
        [helper.make_node("Conv", ["x", "k"], ["y"])], "double", [images, kernel], [out]
    )
    save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9), path)
    with pytest.raises(InputError, match="ONNX Runtime lacks") as refusal:
        DriverNetwork(path)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
def test_a_file_that_is_cut_off_is_no_network(path, share):
    data = write_network(path).read_bytes()
    path.write_bytes(data[: int(share * len(data))])
    with pytest.raises(InputError, match=r"turn\.onnx: no"):
        DriverNetwork(path)


def test_the_shipped_lane_network_is_no_driving_network():
    with pytest.raises(InputError, match="no driving network: has no metadata"):
        DriverNetwork(Path("perception/weights/steer_net.onnx").resolve())


def test_a_missing_file_is_named_with_the_command_that_makes_one():
    with pytest.raises(InputError, match=r"nowhere\.onnx: no such file; `trepid train`"):
        entry_of("nowhere.onnx")


@pytest.mark.parametrize(
    ("file", "fault"), [("cv.onnx", "another estimator"), ("a b.onnx", "rename the file")]
)
def test_a_file_whose_name_cannot_be_that_of_an_estimator_is_refused(file, fault):
    with pytest.raises(InputError, match=fault):
        name_of(file)


def test_a_process_names_the_file_and_the_estimator(path):
    estimate = step(build("mine", network=str(write_network(path))), halves(120, 90))
    assert estimate.estimator == "mine"
    with pytest.raises(InputError, match="'cnn' is the name of another estimator"):
        build("cnn", network=str(path))


def test_a_memory_of_every_second_frame_reads_every_second_frame(path):
    network = driver(write_network(path, memory=True, record={"stride": 2}))
    one = 30 / 255
    angles = [step(network, halves(120, 90), 0.1 * n).road_wheel_angle_rad for n in range(4)]
    assert angles == pytest.approx([one / 2, one / 2, one * 3 / 4, one * 3 / 4], rel=1e-5)
