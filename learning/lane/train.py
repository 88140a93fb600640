"""`trepid train`: renders labelled frames, fits the lane network to them, scores it and writes it as ONNX."""

import hashlib
import importlib.util
import json
import sys
import time
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from learning.lane.frames import FIRST_ROAD, Shot, circuit_frames, random_frames
from learning.lane.scores import Labelled, Task, calibrate, nonsense_seen, predict, scores
from perception.net.canonical import cropped
from perception.net.steer_net import Calibration, Network, Record
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from trepid.vehicle import Vehicle

if TYPE_CHECKING:
    from learning.lane.fit import Progress, Recipe

SHIPPED = ROOT / "perception" / "weights"
CIRCUIT = "circuit"
MAX_EXPORT_DIFFERENCE = 1e-4
VERSIONS = ("torch", "onnx", "onnxruntime", "numpy", "opencv-python-headless")


def train(
    frames: Annotated[int | None, typer.Option(min=1, help="Frames rendered for training.")] = None,
    epochs: Annotated[int | None, typer.Option(min=1, help="Passes over the frames.")] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of roads, augmentation and initial weights.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for frames and checkpoint.")] = Path("out/train"),
    weights: Annotated[
        Path, typer.Option(help="Folder for the weights.", show_default="perception/weights")
    ] = SHIPPED,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from existing frames and checkpoint.")
    ] = False,
) -> None:
    """Train the CNN estimator on rendered roads and write its weights; needs the extra 'train'."""
    if importlib.util.find_spec("torch") is None:
        raise InputError("trepid train needs the extra: pip install -e '.[train]'")
    from learning.lane.fit import Recipe

    given = dict(frames=frames, epochs=epochs, seed=seed)
    overrides = {name: str(value) for name, value in given.items() if value is not None}
    recipe = load(CONFIG_DIR / "train.yaml", Recipe, overrides=overrides)
    record = run(recipe, out, weights, resume=resume)
    typer.echo(json.dumps(record.scores, indent=1))


def run(recipe: "Recipe", out: Path, folder: Path, *, resume: bool) -> Record:
    """Render, fit, export and score; writes ``folder``/steer_net.onnx and steer_net.json. Raises InputError."""
    from learning.lane.fit import largest_difference
    from learning.lane.fit import train as fit

    started_s = time.monotonic()
    shot = photography(recipe)
    data = _frames(recipe, shot, out, reuse=resume)
    network, progress = fit(
        recipe,
        data["train"],
        data["validation"],
        canonical=shot.canonical,
        checkpoint=out / "checkpoint.pt",
        resume=resume,
        report=_say,
    )
    fresh = out / "steer_net.onnx"
    exported, parameters = _export(network, fresh), sum(p.numel() for p in network.parameters())
    difference = largest_difference(network, exported, np.array(data["test"].images[:256]))
    if difference > MAX_EXPORT_DIFFERENCE:
        raise InputError(
            f"{fresh}: the export differs from the trained network by {difference:.2g}; not shipped"
        )
    task, calibration = _calibrated(recipe, exported, data["validation"])
    sets = {"test_roads": data["test"], **circuit_frames(shot, CIRCUIT, seed=recipe.seed)}
    measured = {name: scores(exported, frames, task, calibration) for name, frames in sets.items()}
    measured["nonsense"] = nonsense_seen(exported, data["test"], seed=recipe.seed)
    record = Record(
        sha256=hashlib.sha256(fresh.read_bytes()).hexdigest(),
        parameters=parameters,
        camera=shot.canonical,
        lane_lookahead_m=recipe.lane_lookahead_m,
        calibration=calibration,
        command=f"trepid train --frames {recipe.frames} --epochs {recipe.epochs} --seed {recipe.seed}",
        date=datetime.now(UTC).date().isoformat(),
        versions={name: version(name) for name in VERSIONS},
        recipe=recipe.model_dump(),
        training=_summary(progress, difference, minutes=(time.monotonic() - started_s) / 60),
        scores=measured,
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "steer_net.onnx").write_bytes(fresh.read_bytes())
    text = json.dumps(record.model_dump(), indent=1, ensure_ascii=False)
    (folder / "steer_net.json").write_text(text + "\n", encoding="utf-8")
    return record


def photography(recipe: "Recipe") -> Shot:
    """The default camera, and the canonical one cut out of it."""
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    canonical = cropped(camera, **recipe.crop.model_dump())
    return Shot(camera, canonical, recipe.lane_lookahead_m, recipe.frames_per_road)


def _frames(recipe: "Recipe", shot: Shot, out: Path, *, reuse: bool) -> dict[str, Labelled]:
    counts = dict(train=recipe.frames, validation=recipe.validation_frames, test=recipe.test_frames)
    return {
        split: random_frames(
            shot, split, counts[split], seed=recipe.seed, folder=out, reuse=reuse, report=_say
        )
        for split in FIRST_ROAD
    }


def _export(network: object, path: Path) -> Network:
    from learning.lane.network import SteerNetwork, export

    assert isinstance(network, SteerNetwork)
    export(network, path)
    return Network(path)


def _calibrated(recipe: "Recipe", network: Network, validation: Labelled) -> tuple[Task, Calibration]:
    """The task of the network, and the calibration of its confidence."""
    from learning.lane.network import command_row

    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    row = command_row(recipe.lane_lookahead_m, recipe.command_lookahead_m).double().numpy()
    task = Task(vehicle.wheelbase_m, row)
    seen = validation.part(validation.visible)
    found = predict(network, seen.images, task)
    error_rad = task.road_wheel_angle(found.lanes) - task.road_wheel_angle(seen.lanes)
    tolerance_rad = float(np.deg2rad(recipe.tolerance_deg))
    return task, calibrate(found.sigma_rad, error_rad, tolerance_rad=tolerance_rad)


def _summary(progress: "Progress", difference: float, *, minutes: float) -> dict[str, float]:
    return dict(
        epochs=progress.epoch,
        best_epoch=progress.best_epoch,
        best_validation_loss=round(progress.best_loss, 5),
        fit_minutes=round(progress.elapsed_s / 60, 1),
        minutes=round(minutes, 1),
        largest_export_difference=difference,
    )


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
