"""`trepid train-lane`: renders labelled frames, fits the lane network to them, scores it and writes it as ONNX."""

import json
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import numpy as np
import typer

from learning.drawn_frames import UNMARKED_WIDTH_M, WIDTH_M
from learning.lane.frames import TrainingShot, circuit_frames, mounted_frames, random_frames
from learning.lane.scores import LabelledFrames, PursuitTask, calibrate, nonsense_shares, predict, scores
from learning.lane.world import add_world, limits
from learning.rendered import FIRST_ROAD, SHIPPED, WeightsFolder, need_torch, origin, say
from perception.lane.settings import steering_settings
from perception.net.canonical import crop_camera
from perception.net.steer_net import Calibration, Network, SteerNetRecord
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.options import Car

if TYPE_CHECKING:
    from learning.lane.fit import Recipe

CIRCUIT = "circuit"
MAX_EXPORT_DIFFERENCE = 1e-4


def train(
    frames: Annotated[int | None, typer.Option(min=1, help="Frames rendered for training.")] = None,
    epochs: Annotated[int | None, typer.Option(min=1, help="Passes over the frames.")] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of roads, augmentation and initial weights.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for frames and checkpoint.")] = Path("out/train"),
    weights: WeightsFolder = SHIPPED,
    unlabelled: Annotated[
        list[Path] | None,
        typer.Option(
            help="Video, folder of images or recording of real drives without labels, to learn from as well."
        ),
    ] = None,
    teacher: Annotated[
        str,
        typer.Option(
            help="Estimator that gives the frames of --unlabelled their lanes, such as segments, or cv on plain"
            " roads; default: the network under training."
        ),
    ] = "",
    car: Car = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Continue from existing frames and checkpoint.")
    ] = False,
) -> None:
    """Train the CNN estimator on rendered roads and write its weights; needs the extra 'train'.

    For frames of ``--unlabelled`` the network gives the lanes itself, or ``--teacher`` does, where both are
    consistent.
    """
    if teacher and not unlabelled:
        raise InputError(f"--teacher {teacher}: there is no --unlabelled drive for it")
    need_torch("train-lane")
    from learning.lane.fit import Recipe

    given = dict(frames=frames, epochs=epochs, seed=seed)
    overrides = {name: str(value) for name, value in given.items() if value is not None}
    recipe = load(CONFIG_DIR / "train.yaml", Recipe, overrides=overrides)
    record = run(recipe, out, weights, unlabelled=unlabelled or [], teacher=teacher, resume=resume)
    typer.echo(json.dumps(record.scores, indent=1))


def run(
    recipe: "Recipe",
    out: Path,
    folder: Path,
    *,
    unlabelled: Sequence[Path] = (),
    teacher: str = "",
    resume: bool,
) -> SteerNetRecord:
    """Render, fit, export and score; writes ``folder``/steer_net.onnx and steer_net.json. Raises InputError."""
    from learning.lane.carriageway import PARAMETERS, add_carriageway, ship_scored
    from learning.lane.fit import largest_difference
    from learning.lane.fit import train as fit
    from learning.lane.network import export
    from learning.lane.unlabelled import read_drives

    started_s = time.monotonic()
    if recipe.carriageway is None:
        raise InputError(f"{CONFIG_DIR / 'train.yaml'}: the section carriageway is missing")
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    canonical = crop_camera(camera, **recipe.crop.model_dump())
    drives = read_drives(
        unlabelled,
        canonical,
        most_frames=recipe.self_training.most_frames,
        teacher=teacher,
        lookahead_m=recipe.lane_lookahead_m,
    )
    wheelbase_m = load(CONFIG_DIR / "vehicle.yaml", Vehicle).wheelbase_m
    shot = TrainingShot(camera, canonical, recipe.lane_lookahead_m, recipe.frames_per_road, recipe.scenery)
    mounted = replace(shot, mounts=recipe.mounts)
    counts = dict(train=recipe.frames, validation=recipe.validation_frames, test=recipe.test_frames)
    data = {
        split: random_frames(
            shot if split == "test" else mounted,
            split,
            counts[split],
            seed=recipe.seed,
            folder=out,
            reuse=resume,
            report=say,
        )
        for split in FIRST_ROAD
    }
    network, progress = fit(
        recipe,
        data["train"],
        data["validation"],
        canonical=canonical,
        wheelbase_m=wheelbase_m,
        checkpoint=out / "checkpoint.pt",
        resume=resume,
        report=say,
        unlabelled=drives,
    )
    fresh = out / "steer_net.onnx"
    export(network, fresh)
    others = add_world(fresh, mounted, seed=recipe.seed, folder=out, reuse=resume)
    branch = add_carriageway(fresh, recipe, mounted, folder=out, reuse=resume)
    exported = Network(fresh)
    difference = largest_difference(network, exported, np.array(data["test"].images[:256]))
    if not difference <= MAX_EXPORT_DIFFERENCE:  # NaN is not
        raise InputError(
            f"{fresh}: the export differs from the trained network by {difference:.2g}; not shipped"
        )
    task, calibration = _calibrate(recipe, exported, data["validation"], wheelbase_m)
    elsewhere = mounted_frames(shot, seed=recipe.seed, folder=out / "mounts", reuse=resume, report=say)
    sets = {"test_roads": data["test"], **circuit_frames(shot, CIRCUIT, seed=recipe.seed)}
    measured = {name: scores(exported, frames, task, calibration) for name, frames in sets.items()}
    for name, (frames, scale) in elsewhere.items():
        measured[name] = scores(exported, frames, task, calibration, scale=scale)
    measured["nonsense"] = nonsense_shares(exported, data["test"], seed=recipe.seed)
    command = f"trepid train-lane --frames {recipe.frames} --epochs {recipe.epochs} --seed {recipe.seed}"
    command += "".join(f" --unlabelled {name}" for name in drives.names)
    command += f" --teacher {teacher}" if teacher else ""
    record = SteerNetRecord(
        **origin(fresh, command),
        parameters=sum(p.numel() for p in network.parameters()),
        camera=canonical,
        lane_lookahead_m=recipe.lane_lookahead_m,
        lane_width_m=seen_widths_m(recipe.mounts.height),
        calibration=calibration,
        world=limits(exported, others, calibration, wheelbase_m=task.wheelbase_m),
        recipe=recipe.model_dump()
        | {"command_lookahead_m": steering_settings().lookahead_m}
        | ({"unlabelled_sha256": drives.digest} if len(drives) else {}),
        training=dict(
            epochs=progress.epoch,
            best_epoch=progress.best_epoch,
            best_validation_loss=round(progress.best_loss, 5),
            fit_minutes=round(progress.elapsed_s / 60, 1),
            minutes=round((time.monotonic() - started_s) / 60, 1),
            largest_export_difference=difference,
        )
        | {PARAMETERS: float(branch)},
        scores=measured,
    )
    return ship_scored(fresh, record, folder)


def seen_widths_m(factor: float) -> tuple[float, float]:
    """Widths of the lanes of training, as seen from the canonical height, of cameras up to ``factor`` off it."""
    widths_m = (*WIDTH_M, *UNMARKED_WIDTH_M)
    return round(min(widths_m) / factor, 2), round(max(widths_m) * factor, 2)


def _calibrate(
    recipe: "Recipe", network: Network, validation: LabelledFrames, wheelbase_m: float
) -> tuple[PursuitTask, Calibration]:
    """The task of the network, and the calibration of its confidence."""
    from learning.lane.network import command_row

    row = command_row(recipe.lane_lookahead_m, steering_settings().lookahead_m).double().numpy()
    task = PursuitTask(wheelbase_m, row)
    seen = validation.part(validation.visible)
    found = predict(network, seen.images, task)
    error_rad = task.road_wheel_angle(found.lanes) - task.road_wheel_angle(seen.lanes)
    tolerance_rad = float(np.deg2rad(recipe.tolerance_deg))
    calibration = calibrate(found.sigma_rad, error_rad, tolerance_rad=tolerance_rad)
    return task, calibration.model_copy(update={"wheelbase_m": wheelbase_m})
