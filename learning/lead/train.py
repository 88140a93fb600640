"""`trepid train-lead`: renders labelled strips, fits the lead network, calibrates it and writes it as ONNX."""

import json
import time
from collections.abc import Iterable
from functools import partial
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from learning.lead.frames import lead_samples
from learning.lead.scores import Match, calibrate, match, scores
from learning.rendered import SHIPPED, Part, WeightsFolder, need_torch, origin, rendered, say, ship
from perception.lead.detection import Platt, Record, peaks
from perception.net.session import open_session
from trepid.car.camera import Camera
from trepid.commands.car_option import Car
from trepid.config import CONFIG_DIR, load

FRAMES_PER_ROAD = 60
HELD_BACK_SHARE = 10  # every tenth road for validation, another tenth for the test
MIN_PROBABILITY = 0.3  # least output of a cell that counts
SURE = 0.5
REACH_M = 40.0


def train_lead(
    roads: Annotated[int, typer.Option(min=10, help="Random roads rendered for training.")] = 150,
    epochs: Annotated[int, typer.Option(min=1, help="Passes over the frames.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of roads, augmentation and initial weights.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for frames.")] = Path("out/train_lead"),
    weights: WeightsFolder = SHIPPED,
    car: Car = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from existing frames.")] = False,
) -> None:
    """Train the lead detector on rendered vehicles and write its weights; needs the extra 'train'."""
    need_torch("train-lead")
    from learning.lead.fit import fit
    from learning.lead.network import export

    started_s = time.monotonic()
    counts = dict(train=roads, validation=roads // HELD_BACK_SHARE, test=roads // HELD_BACK_SHARE)
    part = partial(_part, load(CONFIG_DIR / "camera.yaml", Camera))
    paths = {
        split: list(rendered(part, split, count, seed=seed, folder=out, reuse=resume))
        for split, count in counts.items()
    }
    strips, vehicles = _loaded(paths["train"])
    network = fit(strips, vehicles, epochs=epochs, seed=seed, report=say)
    fresh = out / "lead_net.onnx"
    export(network, fresh)
    calibration = calibrate(_matches(fresh, paths["validation"]))
    record = Record(
        **origin(fresh, f"trepid train-lead --roads {roads} --epochs {epochs} --seed {seed}"),
        parameters=sum(p.numel() for p in network.parameters()),
        calibration=calibration,
        min_probability=MIN_PROBABILITY,
        frames=len(strips),
        scores=_scores(_matches(fresh, paths["test"]), calibration),
    )
    ship(fresh, record, weights)
    say(f"{(time.monotonic() - started_s) / 60:.1f} min")
    typer.echo(json.dumps(record.scores, indent=1))


def _part(camera: Camera, seed: int) -> Part:
    """The frames of the random road ``seed``."""
    frames = lead_samples(seed, camera, frames=FRAMES_PER_ROAD)
    return dict(
        strips=np.stack([frame.strips for frame in frames]),
        vehicles=np.stack([frame.vehicles for frame in frames]),
    )


def _loaded(paths: Iterable[Path]) -> tuple[np.ndarray, np.ndarray]:
    parts = [np.load(path) for path in paths]
    return tuple(np.concatenate([part[name] for part in parts]) for name in ("strips", "vehicles"))  # type: ignore[return-value]


def _matches(network: Path, paths: Iterable[Path]) -> list[Match]:
    runner = open_session(network)
    found: list[Match] = []
    for path in paths:
        for strips, vehicles in zip(*_loaded([path]), strict=True):
            cells = runner.run(None, {"strips": strips})[0]
            found += match(vehicles, peaks(cells, MIN_PROBABILITY), reach_m=REACH_M)
    return found


def _scores(matches: list[Match], calibration: Platt) -> dict[str, float]:
    """Scores of the detections whose calibrated probability is at least SURE."""
    calibrated = [
        m._replace(found=(*m.found[:3], calibration(m.found[3]))) if m.found else m for m in matches
    ]
    return {name: round(value, 4) for name, value in scores(calibrated, min_probability=SURE).items()}
