"""The world of a trained lane network: how far an image lies from the images of its training.

The features of an image are the means of the channels after each convolution, of unit length for each convolution.
Its distance from the world is 1 - cos to the k-th nearest of the features of some training images (Sun et al.,
Out-of-Distribution Detection with Deep Nearest Neighbors, ICML 2022). The exported network holds these features and
gives the distance as its last output; the limits come from images of other roads.
`python -m learning.lane.world` renews both in the shipped weights. Needs onnx (extra ``[train]``).
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from learning.lane.frames import Shot, random_frames
from learning.lane.scores import outputs
from learning.rendered import SHIPPED, WeightsFolder, origin, say, ship
from perception.net.session import load_record, open_session
from perception.net.steer_net import Calibration, Network, Record, World
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.types import Floats, Image

if TYPE_CHECKING:
    import onnx

NEIGHBOUR = 3
REFERENCES = 3000
FRAMES = {"train": 3200, "validation": 1200}
FRAMES_PER_ROAD = 5  # neighbouring frames of a road are alike
SURE = 0.5
NEAR_QUANTILE = 0.995  # of the distances of images of other roads: in the world up to here ...
FAR_SHARE = 1.15  # ... and outside from this multiple on
BATCH = 64
LEVELS = 255
OUTPUT = "unlike"


def add_world(path: Path, shot: Shot, *, seed: int, folder: Path, reuse: bool) -> Image:
    """Give the network ``path`` the output ``unlike`` (n,); images of other roads for :func:`limits`."""
    varied = replace(shot, frames_per_road=FRAMES_PER_ROAD)
    train, validation = (
        random_frames(varied, split, count, seed=seed, folder=folder / "world", reuse=reuse, report=say)
        for split, count in FRAMES.items()
    )
    attach(path, train.images[train.visible])
    return validation.images[validation.visible]


def limits(network: Network, images: Image, calibration: Calibration, *, wheelbase_m: float) -> World:
    """The limits of the world of a network, from those of ``images`` in which it is confident of its lane."""
    _, sigmas_1pm, visible, unlike = outputs(network, images)
    confidence = visible * np.array([calibration.probability(wheelbase_m * sigma) for sigma in sigmas_1pm])
    near = float(np.quantile(unlike[confidence > SURE], NEAR_QUANTILE))
    return World(near=round(near, 5), far=round(FAR_SHARE * near, 5))


def attach(path: Path, images: Image) -> None:
    """Add the output ``unlike`` to the network ``path``, with REFERENCES of the ``images`` as its world."""
    import onnx

    model = onnx.load(path)
    _without_world(model)
    features = _add_features(model)
    onnx.checker.check_model(model)
    chosen = images[np.linspace(0, len(images) - 1, min(REFERENCES, len(images))).astype(int)]
    _add_distance(model, features, _features_of(model, features, chosen))
    onnx.checker.check_model(model)
    onnx.save(model, path)


def _without_world(model: "onnx.ModelProto") -> None:
    """Remove the output ``unlike`` of an earlier call and all that only it needs."""
    graph = model.graph
    for kept in (graph.node, graph.initializer):
        for one in [one for one in kept if one.name.startswith(OUTPUT)]:
            kept.remove(one)
    for one in [one for one in graph.output if one.name == OUTPUT]:
        graph.output.remove(one)


def _add_features(model: "onnx.ModelProto") -> str:
    """Add the features to the graph; the name of their tensor (n, channels)."""
    made_by = {name: node.op_type for node in model.graph.node for name in node.output}
    activations = [
        node.output[0]
        for node in model.graph.node
        if node.op_type == "Relu" and made_by.get(node.input[0]) == "Conv"
    ]
    layers = [f"{OUTPUT}_layer_{number}" for number in range(len(activations))]
    for activation, layer in zip(activations, layers, strict=True):
        _add_node(model, "ReduceMean", [activation], f"{layer}_mean", axes=[2, 3], keepdims=0)
        _add_node(model, "LpNormalization", [f"{layer}_mean"], layer, axis=1, p=2)
    _add_node(model, "Concat", layers, f"{OUTPUT}_layers", axis=1)
    _add_node(model, "LpNormalization", [f"{OUTPUT}_layers"], f"{OUTPUT}_features", axis=1, p=2)
    return f"{OUTPUT}_features"


def _features_of(model: "onnx.ModelProto", features: str, images: Image) -> Floats:
    """Features (n, channels) of ``images``."""
    import onnx

    shown = onnx.ModelProto()
    shown.CopyFrom(model)
    shown.graph.output.append(onnx.helper.make_tensor_value_info(features, onnx.TensorProto.FLOAT, None))
    session = open_session(shown.SerializeToString(), Path(features))
    batches = range(0, len(images), BATCH)
    return np.concatenate([session.run([features], {"image": images[i : i + BATCH]})[0] for i in batches])


def _add_distance(model: "onnx.ModelProto", features: str, references: Floats) -> None:
    import onnx

    def constant(name: str, value: np.ndarray) -> str:
        name = f"{OUTPUT}_{name}"
        model.graph.initializer.append(onnx.numpy_helper.from_array(value, name))
        return name

    world = constant("world", np.round(references.T * LEVELS).astype(np.uint8))  # features are 0 to 1
    level = constant("level", np.array(1 / LEVELS, np.float32))
    count = constant("count", np.array([NEIGHBOUR], np.int64))
    last = constant("last", np.array(NEIGHBOUR - 1, np.int64))
    one = constant("one", np.array(1.0, np.float32))
    _add_node(model, "DequantizeLinear", [world, level], f"{OUTPUT}_references")
    _add_node(model, "MatMul", [features, f"{OUTPUT}_references"], f"{OUTPUT}_cosines")
    _add_node(model, "TopK", [f"{OUTPUT}_cosines", count], f"{OUTPUT}_nearest", f"{OUTPUT}_places", axis=1)
    _add_node(model, "Gather", [f"{OUTPUT}_nearest", last], f"{OUTPUT}_cosine", axis=1)
    _add_node(model, "Sub", [one, f"{OUTPUT}_cosine"], OUTPUT)
    model.graph.output.append(onnx.helper.make_tensor_value_info(OUTPUT, onnx.TensorProto.FLOAT, ["n"]))


def _add_node(model: "onnx.ModelProto", kind: str, inputs: list[str], *named: str, **attributes: Any) -> None:
    """A node that gives the tensors ``named``."""
    import onnx

    model.graph.node.append(
        onnx.helper.make_node(kind, inputs, list(named), name=f"{named[0]}_node", **attributes)
    )


def renew(
    out: Annotated[Path, typer.Option(help="Folder for frames.")] = Path("out/train"),
    weights: WeightsFolder = SHIPPED,
    resume: Annotated[bool, typer.Option("--resume", help="Use the frames of an earlier call.")] = False,
) -> None:
    """Renew the world of the weights of the CNN estimator."""
    shipped = weights / "steer_net.onnx"
    if not shipped.is_file():
        raise InputError(f"{shipped}: no weights; `trepid train` makes them")
    record = load_record(shipped, Record)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    shot = Shot(camera, record.camera, record.lane_lookahead_m, FRAMES_PER_ROAD)
    with tempfile.TemporaryDirectory() as folder:
        fresh = Path(folder) / shipped.name
        fresh.write_bytes(shipped.read_bytes())
        others = add_world(fresh, shot, seed=int(str(record.recipe["seed"])), folder=out, reuse=resume)
        wheelbase_m = load(CONFIG_DIR / "vehicle.yaml", Vehicle).wheelbase_m
        world = limits(Network(fresh), others, record.calibration, wheelbase_m=wheelbase_m)
        changed = dict(world=world, sha256=origin(fresh, record.command)["sha256"])
        ship(fresh, record.model_copy(update=changed), weights)
    print(f"{shipped}: in its world up to {world.near}, outside from {world.far}")


if __name__ == "__main__":
    typer.run(renew)
