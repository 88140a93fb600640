"""The world of a trained lane network: how far an image lies from the images of its training.

The features of an image are the means of all channels after each convolution, together of unit length. Its distance
from the world is 1 - cos to the k-th nearest of the features of some training images (Sun et al.,
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
from learning.lane.scores import Labelled, outputs
from learning.rendered import SHIPPED, WeightsFolder, origin, say, ship
from perception.net.session import load_record, open_session
from perception.net.steer_net import Network, Record, World
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.types import Floats, Image

if TYPE_CHECKING:
    import onnx

NEIGHBOUR = 10
REFERENCES = 1000
FRAMES = {"train": 1600, "validation": 1200}
FRAMES_PER_ROAD = 5  # neighbouring frames of a road are alike
NEAR_QUANTILE = 0.995  # of the distances of images of other roads: in the world up to here ...
FAR_SHARE = 1.15  # ... and outside from this multiple on
BATCH = 64
OUTPUT = "unlike"


def add_world(path: Path, shot: Shot, *, seed: int, folder: Path, reuse: bool) -> World:
    """Give the network ``path`` the output ``unlike`` (n,), and return the limits of its world."""
    varied = replace(shot, frames_per_road=FRAMES_PER_ROAD)
    seen = {
        split: _with_road(
            random_frames(varied, split, count, seed=seed, folder=folder / "world", reuse=reuse, report=say)
        )
        for split, count in FRAMES.items()
    }
    attach(path, seen["train"])
    distances = outputs(Network(path), seen["validation"])[-1]
    near = float(np.quantile(distances, NEAR_QUANTILE))
    return World(near=round(near, 5), far=round(FAR_SHARE * near, 5))


def _with_road(frames: Labelled) -> Image:
    return frames.images[frames.visible]


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
    means = [f"{OUTPUT}_mean_{number}" for number in range(len(activations))]
    for activation, mean in zip(activations, means, strict=True):
        _add_node(model, "ReduceMean", [activation], mean, axes=[2, 3], keepdims=0)
    _add_node(model, "Concat", means, f"{OUTPUT}_means", axis=1)
    _add_node(model, "LpNormalization", [f"{OUTPUT}_means"], f"{OUTPUT}_features", axis=1, p=2)
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

    world = constant("world", np.ascontiguousarray(references.T).astype(np.float16))
    count = constant("count", np.array([NEIGHBOUR], np.int64))
    last = constant("last", np.array(NEIGHBOUR - 1, np.int64))
    one = constant("one", np.array(1.0, np.float32))
    _add_node(model, "Cast", [world], f"{OUTPUT}_references", to=onnx.TensorProto.FLOAT)
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
        world = add_world(fresh, shot, seed=int(str(record.recipe["seed"])), folder=out, reuse=resume)
        changed = dict(world=world, sha256=origin(fresh, record.command)["sha256"])
        ship(fresh, record.model_copy(update=changed), weights)
    print(f"{shipped}: in its world up to {world.near}, outside from {world.far}")


if __name__ == "__main__":
    typer.run(renew)
