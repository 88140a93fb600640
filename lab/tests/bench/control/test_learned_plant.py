"""The plant of a network in a file, with a network of known lag and gain in place of a learned one."""

import math
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from plant_step_rig import step_response_mps2

from lab.bench.control.contestants import nominal
from lab.bench.control.learned_plant import CONTEXT, STEP_S, VALUES_MPS2, LearnedPlant
from lab.bench.control.robustness import errors_of_the_file
from sim_harness.world.plants.settings import PlantSettings
from trepid.config import InputError

KEPT, PER_COMMAND_MPS2, SIGMA_MPS2 = 0.6, 3.0, 0.01
SPEED_MPS = 20.0


@pytest.fixture(scope="module")
def network(tmp_path_factory) -> Path:
    """Next lateral acceleration = 0.6 of the last one + 0.4 · 3 m/s² · command, with σ = 0.01 m/s²."""
    numbers = {
        "first": np.array([0], np.int64),
        "axis": np.array([2], np.int64),
        "step": np.array(10 / 1023 * KEPT, np.float32),
        "zero": np.array(-5 * KEPT, np.float32),
        "gain": np.array((1 - KEPT) * PER_COMMAND_MPS2, np.float32),
        "values": VALUES_MPS2.astype(np.float32),
        "sharpness": np.array(-0.5 / SIGMA_MPS2**2, np.float32),
    }
    steps = [
        ("Gather", ["states", "first"], "command", dict(axis=2)),
        ("Mul", ["command", "gain"], "driven", {}),
        ("Cast", ["tokens"], "token", dict(to=TensorProto.FLOAT)),
        ("Mul", ["token", "step"], "scaled", {}),
        ("Add", ["scaled", "zero"], "last", {}),
        ("Unsqueeze", ["last", "axis"], "kept", {}),
        ("Add", ["kept", "driven"], "mean", {}),
        ("Sub", ["values", "mean"], "off", {}),
        ("Mul", ["off", "off"], "squared", {}),
        ("Mul", ["squared", "sharpness"], "logits", {}),
    ]
    graph = helper.make_graph(
        [helper.make_node(kind, inputs, [output], **more) for kind, inputs, output, more in steps],
        "car",
        [
            helper.make_tensor_value_info("states", TensorProto.FLOAT, [1, CONTEXT, 4]),
            helper.make_tensor_value_info("tokens", TensorProto.INT64, [1, CONTEXT]),
        ],
        [helper.make_tensor_value_info("logits", TensorProto.FLOAT, [1, CONTEXT, 1024])],
        [numpy_helper.from_array(value, name) for name, value in numbers.items()],
    )
    path = tmp_path_factory.mktemp("learned") / "car.onnx"
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save(model, str(path))
    return path


def lateral_mps2(network: Path, angle_rad: float, *, steps: int = 200, seed: int = 3) -> list[float]:
    """Lateral acceleration by tick of 10 ms after a step of the wheel angle at once."""
    known = nominal().model_copy(update=dict(steering_delay_s=0.0, steering_lag_s=0.0))
    known = known.model_copy(update=dict(max_road_wheel_rate_radps=100.0))
    plant = LearnedPlant(known, PlantSettings(), path=network, seed=seed)
    return step_response_mps2(plant, angle_rad, speed_mps=SPEED_MPS, steps=steps)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_learned_car_settles_at_the_curve_of_its_wheel_angle_whatever_its_command_means(
    network: Path, sign: float
) -> None:
    found = lateral_mps2(network, sign * 0.005)
    steady_mps2 = SPEED_MPS**2 * 0.005 / (1.75 + 0.00356 * SPEED_MPS**2)
    assert np.mean(found[-100:]) == pytest.approx(sign * steady_mps2, abs=0.02)
    sample = round(STEP_S / 0.01)
    late = steady_mps2 - abs(np.array(found[sample // 2 :: sample][:3]))
    assert late[1:] / late[:-1] == pytest.approx([KEPT] * 2, abs=0.1)


def test_the_same_seed_draws_the_same_drive_and_another_seed_another_one(network: Path) -> None:
    first, again, other = (lateral_mps2(network, 0.01, steps=60, seed=seed) for seed in (3, 3, 4))
    assert first == again and first != other and all(map(math.isfinite, first))


def test_a_learned_car_is_driven_with_each_declared_dead_time(network: Path) -> None:
    names = {error.name for error in errors_of_the_file(1, network)} - {e.name for e in errors_of_the_file(1)}
    assert {"learned, dead time 0.1 s declared + 0.2 s", "learned, dead time 0.3 s declared + 0 s"} <= names
    assert len(names) == 6


def test_a_file_that_is_no_model_of_a_car_is_refused_by_its_name(tmp_path: Path) -> None:
    broken = tmp_path / "tinyphysics.onnx"
    broken.write_bytes(b"version https://git-lfs.github.com/spec/v1")
    with pytest.raises(InputError, match=r"tinyphysics\.onnx: no ONNX model"):
        LearnedPlant(nominal(), PlantSettings(), path=broken, seed=1)
