"""Small box detectors with one output: a constant table, and nothing of the picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

SIDE_PX = 96
SHAPE = (1, 3, SIDE_PX, SIDE_PX)
CAR = (48.0, 62.0, 18.0, 14.0)  # centre, width, height [px]
CAR_CORNERS = (39.0, 55.0, 57.0, 69.0)
CAR_CLASS, SCORE = 2, 0.75


def write_table(
    path: Path,
    *tables: NDArray[np.floating],
    shape: Sequence[int | str] = SHAPE,
    kind: int = TensorProto.FLOAT,
    names: Sequence[str] | None = None,
    opset: int = 17,
    ir_version: int = 8,
    data: str = "",
    inputs: int = 1,
    domain: str = "",
) -> Path:
    """A network whose outputs are ``tables``, whatever picture it gets.

    ``names`` of classes stand in its metadata as Ultralytics writes them; ``data`` is the file of its weights.
    """
    entries = [helper.make_tensor_value_info(f"images{k or ''}", kind, list(shape)) for k in range(inputs)]
    nodes = [
        helper.make_node("Cast", ["images"], ["numbers"], to=TensorProto.FLOAT),
        helper.make_node("ReduceMean", ["numbers"], ["mean"], keepdims=0),
        helper.make_node("Mul", ["mean", "zero"], ["nothing"]),
    ]
    constants, outputs = [numpy_helper.from_array(np.float32(0.0), "zero")], []
    for k, table in enumerate(tables):
        constants.append(numpy_helper.from_array(table.astype(np.float32), f"table{k}"))
        operator = helper.make_node("Add", [f"table{k}", "nothing"], [f"output{k}"], domain=domain)
        nodes.append(operator)
        outputs.append(helper.make_tensor_value_info(f"output{k}", TensorProto.FLOAT, list(table.shape)))
    graph = helper.make_graph(nodes, "table", entries, outputs, constants)
    opsets = [helper.make_opsetid("", opset), *([helper.make_opsetid(domain, 1)] if domain else [])]
    model = helper.make_model(graph, opset_imports=opsets, ir_version=ir_version)
    if names is not None:
        metadata: Mapping[str, str] = {"names": str(dict(enumerate(names)))}
        helper.set_model_props(model, dict(metadata))
    if data:
        onnx.save_model(model, path, save_as_external_data=True, location=data, size_threshold=0)
    else:
        onnx.save_model(model, path)
    return path


def plain(boxes: int, classes: int = 80) -> NDArray[np.float32]:
    """A table (4 + classes, boxes) with one car."""
    table = np.zeros((4 + classes, boxes), np.float32)
    table[:4, 1] = CAR
    table[4 + min(CAR_CLASS, classes - 1), 1] = SCORE
    return table


def with_objectness(boxes: int, classes: int = 80) -> NDArray[np.float32]:
    """A table (boxes, 5 + classes) with one car: the product of its two probabilities is SCORE."""
    table = np.zeros((boxes, 5 + classes), np.float32)
    table[1, :4] = CAR
    table[1, [4, 5 + CAR_CLASS]] = 0.9, SCORE / 0.9
    return table


def end_to_end(boxes: int) -> NDArray[np.float32]:
    """A table (boxes, 6) with one car."""
    table = np.zeros((boxes, 6), np.float32)
    table[1] = *CAR_CORNERS, SCORE, CAR_CLASS
    return table
