"""Small driving networks, written node by node: the angle follows the brightness of the left and right half."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from onnx import TensorProto, helper, numpy_helper, save

HEIGHT, WIDTH = 12, 16
RECORD = {
    "kind": "steering",
    "model": "halves",
    "parameters": 3,
    "height": HEIGHT,
    "width": WIDTH,
    "interval_90": 1.645,
    "lock_rad": 0.5,
}


def write_network(
    path: Path,
    *,
    gain_rad: float = 1.0,
    sigma_rad: float = 0.01,
    unlike: float = 0.5,
    memory: bool = False,
    record: Mapping[str, object] | None = None,
    without: str = "",
    image_type: int = TensorProto.UINT8,
    numbers_out: int = 1,
    speed_mps: float | None = None,
) -> Path:
    """A network with the angle gain·(mean of the left half - mean of the right half)/255, + = bright on the left.

    With ``memory`` the angle is the mean of that and of the state, which is the last angle; the first state is 0.
    ``record`` changes the metadata; ``without`` names an input, an output, or "metadata", to leave out.
    ``numbers_out``: of ``next_state``; ``state`` has one. ``speed_mps``: that it proposes; None: no such output.
    """
    n, f = "N", TensorProto.FLOAT
    weights = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    half = WIDTH // 2
    weights[:, :half], weights[:, half:] = 1.0, -1.0
    weights *= gain_rad / 255 / (HEIGHT * half * 3)
    constants = {
        "weights": weights,
        "axes": np.array([1, 2, 3], np.int64),
        "sigma": np.float32(sigma_rad),
        "far": np.float32(unlike),
        "zero": np.float32(0),
    }
    if memory:
        constants |= {"half": np.float32(0.5), "one": np.array([1], np.int64)}
    nodes = [
        helper.make_node("Cast", ["image"], ["pixels"], to=f),
        helper.make_node("Mul", ["pixels", "weights"], ["weighted"]),
        helper.make_node("ReduceSum", ["weighted", "axes"], ["now"], keepdims=0),
        helper.make_node("Mul", ["now", "zero"], ["none"]),
        helper.make_node("Add", ["none", "sigma"], ["sigma_rad"]),
        helper.make_node("Add", ["none", "far"], ["unlike"]),
    ]
    inputs = [helper.make_tensor_value_info("image", image_type, [n, HEIGHT, WIDTH, 3])]
    outputs = [
        helper.make_tensor_value_info(name, f, [n]) for name in ("road_wheel_rad", "sigma_rad", "unlike")
    ]
    if speed_mps is not None:
        constants["pace"] = np.float32(speed_mps)
        nodes.append(helper.make_node("Add", ["none", "pace"], ["speed_mps"]))
        outputs.append(helper.make_tensor_value_info("speed_mps", f, [n]))
        record = {"speed": True, **(record or {})}
    if memory:
        inputs.append(helper.make_tensor_value_info("state", f, [n, 1]))
        outputs.append(helper.make_tensor_value_info("next_state", f, [n, numbers_out]))
        nodes += [
            helper.make_node("Squeeze", ["state", "one"], ["before"]),
            helper.make_node("Add", ["before", "now"], ["sum"]),
            helper.make_node("Mul", ["sum", "half"], ["road_wheel_rad"]),
            helper.make_node("Unsqueeze", ["road_wheel_rad", "one"], ["last"]),
            helper.make_node("Concat", ["last"] * numbers_out, ["next_state"], axis=1),
        ]
    else:
        nodes.append(helper.make_node("Identity", ["now"], ["road_wheel_rad"]))
    graph = helper.make_graph(
        nodes,
        "halves",
        inputs,
        [output for output in outputs if output.name != without],
        [numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    if without != "metadata":
        helper.set_model_props(model, {"trepid": json.dumps({**RECORD, **(record or {})})})
    save(model, path)
    return path


def halves(left: int, right: int, height: int = 240, width: int = 320) -> np.ndarray:
    """An image with grey levels of its halves."""
    image = np.full((height, width, 3), left, np.uint8)
    image[:, width // 2 :] = right
    return image
