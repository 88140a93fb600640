"""Small trainings: networks that differ in one thing, on the same frames of passages along random roads.

A passage is a clip of :mod:`lab.bench.perception.clips` in clear weather: a car that weaves along a road of one
kind of marking and one shape of bend. The label is the road-wheel angle of an arc to the lane centre ahead, from
the geometry of the road. The passages of the validation and of the test are of other roads. Nothing is
augmented. The frames of a seed are kept in ``out/study`` under a hash of the code that draws them.
"""

import io
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.bench.imitation.training_code import one_stage
from lab.bench.perception.clips import CLEAR, PERIOD_S, ClipCase, moments
from learning.training.frames import Frames
from learning.training.recipe import load_recipe
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.world.roads.drawn import BendShape, MarkingKind
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, WORK_DIR, load
from trepid.files.whole import write_whole

if TYPE_CHECKING:
    from learning.models.parts.network import SteeringNetwork
    from learning.training.loop import Progress

Row = dict[str, Any]
HEIGHT_PX, WIDTH_PX = 40, 80
PASSAGES = {"train": 2, "validation": 1, "test": 1}  # of every kind of marking and shape of bend
NOTHING_CHANGED = dict.fromkeys(
    ("flip", "brightness", "colour", "shadow", "blur", "noise", "erase", "flicker"), "0"
)
RESAMPLES, INTERVAL_PERCENT = 2000, (2.5, 97.5)


class Passages(NamedTuple):
    """The frames of a seed."""

    train: Frames
    validation: Frames
    test: Frames


def passages(seed: int) -> Passages:
    """The frames of ``seed``, drawn where they are missing."""
    code = fingerprint(
        *import_closure(["lab.bench.perception.clips"]), "config", "lab/bench/study/passages.py"
    )
    folder = WORK_DIR / "out" / "study" / f"passages-{short_hash(code, str(seed))}"
    return Passages(*(_frames(folder / f"{split}.npz", split, seed) for split in PASSAGES))


def _frames(path: Path, split: str, seed: int) -> Frames:
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        first = sum(count for name, count in PASSAGES.items() if name < split)  # no road is in two splits
        cases = [
            ClipCase(seed, first + number, CLEAR, 0, kind, shape)
            for number in range(PASSAGES[split])
            for kind in MarkingKind
            for shape in BendShape
        ]
        camera = load(CONFIG_DIR / "camera.yaml", Camera)
        vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        images, labels, stretches = [], [], []
        for number, case in enumerate(cases):
            for moment in moments(case, camera, vehicle):
                images.append(
                    cv2.resize(moment.frame.image, (WIDTH_PX, HEIGHT_PX), interpolation=cv2.INTER_AREA)
                )
                labels.append(moment.truth.road_wheel_angle_rad)
                stretches.append(number)
        stream = io.BytesIO()
        columns = np.array(labels, np.float32), np.array(stretches, np.int32)
        np.savez(stream, images=np.array(images), labels=columns[0], stretches=columns[1])
        write_whole(path, stream.getvalue())
    stored = np.load(path)
    stretches = stored["stretches"]
    return Frames(stored["images"], stored["labels"], stretches, stretches.astype(np.int64), ("passages",))


def every_nth(frames: Frames, every: int) -> Frames:
    """Every n-th frame."""
    images, labels, stretches, pieces, routes, speeds_mps = frames
    if speeds_mps is not None:
        speeds_mps = speeds_mps[::every]
    return Frames(images[::every], labels[::every], stretches[::every], pieces[::every], routes, speeds_mps)


def resize(frames: Frames, height_px: int, width_px: int) -> Frames:
    """Smaller frames, by areas."""
    small = [cv2.resize(one, (width_px, height_px), interpolation=cv2.INTER_AREA) for one in frames.images]
    return Frames(np.array(small), *frames[1:])  # not _replace, which asks for the length of the tuple


def train_passages(
    frames: Passages, model: str, changes: Mapping[str, str], network: "SteeringNetwork | None" = None
) -> tuple["SteeringNetwork", "Progress"]:
    """The network ``model``, or another with its recipe, trained on one thread; the weights of its best epoch.

    ``changes`` of the recipe, as by ``--set``. Raises Divergence where the loss leaves the finite numbers.
    """
    import torch

    from learning.models.catalogue import build
    from learning.training.checkpoint import Checkpoints
    from learning.training.loop import Trainer
    from learning.training.run import batches_of, prepare

    overrides = {f"augmentation.{name}": text for name, text in NOTHING_CHANGED.items()} | dict(changes)
    recipe = load_recipe(model, None, overrides=overrides)
    torch.manual_seed(recipe.seed)
    height_px, width_px = frames.train.images.shape[1:3]
    if network is None:
        network = build(model, height=height_px, width=width_px, head=recipe.head)
    prepare(network, recipe, frames.train, lock_rad=None)
    with TemporaryDirectory() as place:
        trainer = Trainer(
            recipe=recipe,
            network=network,
            batches=batches_of(recipe, network, frames.train, lambda text: None),
            validation=frames.validation,
            checkpoints=Checkpoints(Path(place) / "checkpoint"),
            identity="",
            report=lambda text: None,
            on_epoch=lambda progress: None,
        )
        return network, trainer.run(resume=False)


def stages(epochs: int, rate: float) -> dict[str, str]:
    """The change of a recipe to one stage."""
    return {"stages": one_stage(epochs, rate)}


def errors_deg(network: "SteeringNetwork", frames: Frames) -> NDArray[np.float64]:
    """Errors of the road wheel [deg] of all frames."""
    from learning.training.loop import predict

    return np.degrees(predict(network, frames)[0].astype(float) - frames.labels_rad)


def rate_rms_degps(angles_rad: NDArray[np.floating], frames: Frames) -> float:
    """Root mean square of the rate of the angles within passages [deg/s]."""
    steps = np.diff(np.degrees(angles_rad.astype(float)))[np.diff(frames.stretches) == 0]
    return float(np.sqrt(np.mean((steps / PERIOD_S) ** 2)))


def mean_and_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """The mean of some trainings, and the interval of a bootstrap over them."""
    drawn = np.random.default_rng(0).choice(np.asarray(values), (RESAMPLES, len(values)))
    low, high = np.percentile(drawn.mean(axis=1), INTERVAL_PERCENT)
    return float(np.mean(values)), float(low), float(high)


def mean_row(rows: Sequence[Row], scored: str = "mae_deg") -> Row:
    """The means of the numbers of some trainings, with the interval of ``scored``."""
    mean, low, high = mean_and_interval([row[scored] for row in rows])
    others = {
        name: round(float(np.mean([row[name] for row in rows])), 3) for name in rows[0] if name != scored
    }
    return {scored: round(mean, 3), "from": round(low, 3), "to": round(high, 3), **others}


def straight_deg(frames: Frames) -> float:
    """The mean error of a wheel that is held straight [deg]."""
    return math.degrees(float(np.abs(frames.labels_rad).mean()))
