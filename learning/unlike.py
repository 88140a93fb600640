"""How far an image lies from the images of the training of an exported network, as an output of its graph.

The features of an image are the means of the channels after each convolution, of unit length for each convolution.
Their distance is 1 - cos to the k-th nearest of the features of some training images (Sun et al.,
Out-of-Distribution Detection with Deep Nearest Neighbors, ICML 2022). The graph holds these features and gives the
distance as its output ``unlike`` (n,). Needs onnx (extra ``[train]``).
"""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from perception.net.session import session_of
from trepid.types import Floats, Image

if TYPE_CHECKING:
    import onnx

NEIGHBOUR = 3
REFERENCES = 3000
BATCH = 64
LEVELS = 255
MOST_LAYERS = 8  # the last ones of deep networks
ACTIVATIONS = ("Relu", "Clip")
OUTPUT = "unlike"
IMAGE, STATE, NEXT_STATE = "image", "state", "next_state"


def attach(
    path: Path,
    images: Image,
    *,
    others: Image | None = None,
    quantile: float = 0.99,
    before: int = 0,
) -> None:
    """Add the output ``unlike`` to the network ``path``, with REFERENCES of the ``images`` as its world.

    With ``others``, images of the same kind that are not among the references, the distance is divided by its
    ``quantile`` over them: 1 is the border. A network with a memory has the state after the ``before`` images that
    precede each.
    """
    import onnx

    model = onnx.load(path)
    detach(model, OUTPUT)
    features = _add_features(model)
    onnx.checker.check_model(model)
    chosen = np.linspace(0, len(images) - 1, min(REFERENCES, len(images))).astype(int)
    references = _run(model, features, images, chosen, before=before)
    if others is None:
        _add_distance(model, features, references, OUTPUT)
    else:
        _add_distance(model, features, references, f"{OUTPUT}_distance")
        spread = float(
            np.quantile(
                _run(model, f"{OUTPUT}_distance", others, np.arange(len(others)), before=before), quantile
            )
        )
        border = _constant(model, "border", np.array(max(spread, 1e-6), np.float32))
        _add_node(model, "Div", [f"{OUTPUT}_distance", border], OUTPUT)
    add_output(model, OUTPUT, ["n"])
    onnx.checker.check_model(model)
    onnx.save(model, path)


def detach(model: "onnx.ModelProto", output: str) -> None:
    """Remove the ``output`` of an earlier call and all that only it needs, which has names that begin with it."""
    graph = model.graph
    for kept in (graph.node, graph.initializer):
        for one in [one for one in kept if one.name.startswith(output)]:
            kept.remove(one)
    for one in [one for one in graph.output if one.name == output]:
        graph.output.remove(one)


def add_output(model: "onnx.ModelProto", name: str, shape: list[str | int] | None) -> None:
    """Make the tensor ``name`` an output of the network, of a known ``shape`` or of any."""
    import onnx

    model.graph.output.append(onnx.helper.make_tensor_value_info(name, onnx.TensorProto.FLOAT, shape))


def _add_features(model: "onnx.ModelProto") -> str:
    """Add the features to the graph; the name of their tensor (n, channels)."""
    found = activations(model, "Conv")
    after = found or activations(model, "Gemm")  # a network without convolutions
    layers = [f"{OUTPUT}_layer_{number}" for number in range(len(after))]
    for activation, layer in zip(after, layers, strict=True):
        pooled = activation
        if found:
            pooled = f"{layer}_mean"
            _add_node(model, "ReduceMean", [activation], pooled, axes=[2, 3], keepdims=0)
        _add_node(model, "LpNormalization", [pooled], layer, axis=1, p=2)
    _add_node(model, "Concat", layers, f"{OUTPUT}_layers", axis=1)
    _add_node(model, "LpNormalization", [f"{OUTPUT}_layers"], f"{OUTPUT}_features", axis=1, p=2)
    return f"{OUTPUT}_features"


def activations(model: "onnx.ModelProto", kind: str) -> list[str]:
    """Tensors of the activations after the last MOST_LAYERS operations of ``kind``; not those of added outputs."""
    added = tuple(f"{output.name}_" for output in model.graph.output)
    made_by = {name: node.op_type for node in model.graph.node for name in node.output}
    found = [
        node.output[0]
        for node in model.graph.node
        if node.op_type in ACTIVATIONS
        and made_by.get(node.input[0]) == kind
        and not node.name.startswith(added)
    ]
    return [_rounded_tensor(model, name) for name in found[-MOST_LAYERS:]]


def _rounded_tensor(model: "onnx.ModelProto", activation: str) -> str:
    """``activation``, or the tensor rounded to 8 bits that takes its place in a quantised network."""
    for kind in ("QuantizeLinear", "DequantizeLinear"):
        after = (n for n in model.graph.node if n.op_type == kind and n.input[0] == activation)
        activation = next((node.output[0] for node in after), activation)
    return activation


def _run(
    model: "onnx.ModelProto", tensor: str, images: Image, places: NDArray[np.intp], *, before: int
) -> Floats:
    """The ``tensor`` for the images at ``places``, with the state after the ``before`` images that precede each."""
    import onnx

    shown = onnx.ModelProto()
    shown.CopyFrom(model)
    add_output(shown, tensor, None)
    session = session_of(shown.SerializeToString())
    sizes = {one.name: one.shape[1:] for one in session.get_inputs() if one.name != IMAGE}

    def infer(part: NDArray[np.intp]) -> Floats:
        state = {name: np.zeros((len(part), *size), np.float32) for name, size in sizes.items()}
        for back in range(before if state else 0, 0, -1):
            earlier = images[np.maximum(part - back, 0)]
            state = {STATE: session.run([NEXT_STATE], {IMAGE: earlier, **state})[0]}
        values: Floats = session.run([tensor], {IMAGE: images[part], **state})[0]
        return values

    return np.concatenate([infer(places[i : i + BATCH]) for i in range(0, len(places), BATCH)])


def _constant(model: "onnx.ModelProto", name: str, value: np.ndarray) -> str:
    import onnx

    name = f"{OUTPUT}_{name}"
    model.graph.initializer.append(onnx.numpy_helper.from_array(value, name))
    return name


def _add_distance(model: "onnx.ModelProto", features: str, references: Floats, output: str) -> None:
    world = _constant(model, "world", np.round(references.T * LEVELS).astype(np.uint8))  # features are 0 to 1
    level = _constant(model, "level", np.array(1 / LEVELS, np.float32))
    neighbour = min(NEIGHBOUR, len(references))
    count = _constant(model, "count", np.array([neighbour], np.int64))
    last = _constant(model, "last", np.array(neighbour - 1, np.int64))
    one = _constant(model, "one", np.array(1.0, np.float32))
    _add_node(model, "DequantizeLinear", [world, level], f"{OUTPUT}_references")
    _add_node(model, "MatMul", [features, f"{OUTPUT}_references"], f"{OUTPUT}_cosines")
    _add_node(model, "TopK", [f"{OUTPUT}_cosines", count], f"{OUTPUT}_nearest", f"{OUTPUT}_places", axis=1)
    _add_node(model, "Gather", [f"{OUTPUT}_nearest", last], f"{OUTPUT}_cosine", axis=1)
    _add_node(model, "Sub", [one, f"{OUTPUT}_cosine"], output)


def _add_node(model: "onnx.ModelProto", kind: str, inputs: list[str], *named: str, **attributes: Any) -> None:
    """A node that gives the tensors ``named``."""
    import onnx

    model.graph.node.append(
        onnx.helper.make_node(kind, inputs, list(named), name=f"{named[0]}_node", **attributes)
    )
