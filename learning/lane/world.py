"""The world of a trained lane network: how far an image lies from the images of its training.

The exported network gives the distance as its output ``unlike`` (:mod:`learning.unlike`); the limits come from
images of other roads. `python -m learning.lane.world` renews both in the shipped weights. Needs onnx (extra
``[train]``).
"""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from learning.lane.frames import Mounts, TrainingShot, random_frames
from learning.lane.scores import outputs
from learning.rendered import SHIPPED, WeightsFolder, origin, run_alone, say, ship
from learning.roadside import Scenery
from learning.unlike import attach
from perception.net.session import load_record
from perception.net.steer_net import Calibration, Network, SteerNetRecord, World
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.types import Image

FRAMES = {"train": 3200, "validation": 1200}
FRAMES_PER_ROAD = 5  # neighbouring frames of a road are alike
SURE = 0.5
NEAR_QUANTILE = 0.995  # of the distances of images of other roads: in the world up to here ...
FAR_SHARE = 1.15  # ... and outside from this multiple on


def add_world(path: Path, shot: TrainingShot, *, seed: int, folder: Path, reuse: bool) -> Image:
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
    _, sigmas_1pm, visible, unlike, _ = outputs(network, images)
    confidence = visible * np.array([calibration.probability(wheelbase_m * sigma) for sigma in sigmas_1pm])
    near = float(np.quantile(unlike[confidence > SURE], NEAR_QUANTILE))
    return World(near=round(near, 5), far=round(FAR_SHARE * near, 5))


def shipped_network(weights: Path) -> tuple[Path, SteerNetRecord]:
    """The lane network of the folder ``weights`` and its record. Raises InputError where there is none."""
    shipped = weights / "steer_net.onnx"
    if not shipped.is_file():
        raise InputError(f"{shipped}: no weights; `trepid train-lane` makes them")
    return shipped, load_record(shipped, SteerNetRecord)


def renew(
    out: Annotated[Path, typer.Option(help="Folder for frames.")] = Path("out/train"),
    weights: WeightsFolder = SHIPPED,
    resume: Annotated[bool, typer.Option("--resume", help="Use the frames of an earlier call.")] = False,
) -> None:
    """Renew the world of the weights of the CNN estimator."""
    shipped, record = shipped_network(weights)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    scenery = Scenery.model_validate(record.recipe["scenery"])
    mounts = Mounts.model_validate(record.recipe["mounts"])
    shot = TrainingShot(camera, record.camera, record.lane_lookahead_m, FRAMES_PER_ROAD, scenery, mounts)
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
    run_alone(renew)
