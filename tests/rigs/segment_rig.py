"""A segmentation network whose masks follow from the colours of a drawn road, and its description."""

from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from perception.segments.network import Segmenter, SegmentNetwork

SHARPNESS = 60.0  # logits per unit of colour
PAINT_RED, GREEN_BEYOND_RED = 0.75, 0.06  # paint is lighter; grass and sky are greener
WIDTH, HEIGHT = 320, 192


def about(**changes: object) -> SegmentNetwork:
    """The description of the network of :func:`write_network`, with the given changes."""
    fields = {
        "description": "colours of drawn roads",
        "source": "tests",
        "licence": "none",
        "input": {"name": "x", "width": WIDTH, "height": HEIGHT},
        "lines": {"output": "lines", "channels": [1]},
        "area": {"output": "area", "channels": [1]},
    }
    return SegmentNetwork.model_validate(fields | changes)


def write_network(path: Path, *, bias: float = 0.0) -> Path:
    """A network for RGB: paint is red enough, drivable is what is not green; ``bias`` is added to all logits."""
    weights = np.zeros((2, 3, 1, 1), np.float32)
    weights[0, 0], weights[1, :2, 0, 0] = SHARPNESS, (SHARPNESS, -SHARPNESS)
    biases = np.float32([-SHARPNESS * PAINT_RED + bias, SHARPNESS * GREEN_BEYOND_RED + bias])
    nodes, constants = [], []
    for number, name in enumerate(("lines", "area")):
        both = np.stack([np.zeros_like(weights[number]), weights[number]])
        constants.append(numpy_helper.from_array(both, f"w_{name}"))
        constants.append(numpy_helper.from_array(np.float32([0.0, biases[number]]), f"b_{name}"))
        nodes.append(helper.make_node("Conv", ["x", f"w_{name}", f"b_{name}"], [name]))
    shape = [1, 3, HEIGHT, WIDTH]
    outputs = [
        helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 2, HEIGHT, WIDTH])
        for name in ("lines", "area")
    ]
    entry = helper.make_tensor_value_info("x", TensorProto.FLOAT, shape)
    graph = helper.make_graph(nodes, "colours", [entry], outputs, constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    onnx.save_model(model, path)
    return path


def segmenter(folder: Path, **changes: object) -> Segmenter:
    """The network in ``folder``, described with the given changes."""
    return Segmenter(write_network(folder / "colours.onnx"), about(**changes))


def write_network_of_car(car: Path) -> None:
    """The network in the folder ``car``, with its description, as the one that the car chooses."""
    (car / "networks").mkdir(parents=True)
    write_network(car / "colours.onnx")
    (car / "networks" / "mine.yaml").write_text(
        "description: mine\nsource: me\nlicence: MIT\ninput: {name: x, width: 320, height: 192}\n"
        "lines: {output: lines, channels: [1]}\narea: {output: area, channels: [1]}\n"
    )
    (car / "segments.yaml").write_text("network: mine\nfile: colours.onnx\n")
