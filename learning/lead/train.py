"""`trepid train-lead`: renders labelled strips, fits the lead network, calibrates it and writes it as ONNX."""

import hashlib
import importlib.util
import json
import os
import sys
import time
from collections.abc import Iterable
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from learning.lane.train import SHIPPED, VERSIONS
from learning.lead.frames import lead_samples
from learning.lead.scores import Match, calibrate, match, scores
from perception.lead.detection import Platt, Record, peaks
from perception.net.session import open_session
from sim_harness.sweep.pool import imap
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

FRAMES_PER_ROAD = 60
FIRST_ROAD = {"train": 0, "validation": 800_000, "test": 900_000}
ROADS_PER_SEED = 1_000_000
HELD_BACK_SHARE = 10  # every tenth road for validation, another tenth for the test
MIN_PROBABILITY = 0.3  # least output of a cell that counts
SURE = 0.5
REACH_M = 40.0


def train_lead(
    roads: Annotated[int, typer.Option(min=10, help="Random roads rendered for training.")] = 150,
    epochs: Annotated[int, typer.Option(min=1, help="Passes over the frames.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of roads, augmentation and initial weights.")] = 0,
    out: Annotated[Path, typer.Option(help="Folder for frames.")] = Path("out/train_lead"),
    weights: Annotated[
        Path, typer.Option(help="Folder for the weights.", show_default="perception/weights")
    ] = SHIPPED,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from existing frames.")] = False,
) -> None:
    """Train the lead detector on rendered vehicles and write its weights; needs the extra 'train'."""
    if importlib.util.find_spec("torch") is None:
        raise InputError("trepid train-lead needs the extra: pip install -e '.[train]'")
    from learning.lead.fit import fit
    from learning.lead.network import export

    started_s = time.monotonic()
    counts = dict(train=roads, validation=roads // HELD_BACK_SHARE, test=roads // HELD_BACK_SHARE)
    paths = {split: _rendered(split, count, seed, out, resume=resume) for split, count in counts.items()}
    strips, vehicles = _loaded(paths["train"])
    network = fit(strips, vehicles, epochs=epochs, seed=seed, report=_say)
    fresh = out / "lead_net.onnx"
    export(network, fresh)
    calibration = calibrate(_matches(fresh, paths["validation"]))
    record = Record(
        sha256=hashlib.sha256(fresh.read_bytes()).hexdigest(),
        parameters=sum(p.numel() for p in network.parameters()),
        calibration=calibration,
        min_probability=MIN_PROBABILITY,
        command=f"trepid train-lead --roads {roads} --epochs {epochs} --seed {seed}",
        date=datetime.now(UTC).date().isoformat(),
        versions={name: version(name) for name in VERSIONS},
        frames=len(strips),
        scores=_scores(_matches(fresh, paths["test"]), calibration),
    )
    weights.mkdir(parents=True, exist_ok=True)
    (weights / "lead_net.onnx").write_bytes(fresh.read_bytes())
    text = json.dumps(record.model_dump(), indent=1, ensure_ascii=False)
    (weights / "lead_net.json").write_text(text + "\n", encoding="utf-8")
    _say(f"{(time.monotonic() - started_s) / 60:.1f} min")
    typer.echo(json.dumps(record.scores, indent=1))


def _rendered(split: str, count: int, seed: int, folder: Path, *, resume: bool) -> list[Path]:
    """Files with the frames of ``count`` roads of ``split``, rendered by all cores; splits share no road."""
    folder.mkdir(parents=True, exist_ok=True)
    first = seed * ROADS_PER_SEED + FIRST_ROAD[split]
    paths, started_s = [], time.monotonic()
    road, roads = partial(_road, folder, resume=resume), range(first, first + count)
    for number, path in enumerate(imap(road, roads, os.cpu_count() or 1), start=1):
        paths.append(path)
        if number % 10 == 0 or number == count:
            left_s = (time.monotonic() - started_s) * (count - number) / number
            _say(f"{split}: {number}/{count} roads rendered, {left_s / 60:.1f} min left")
    return paths


def _road(folder: Path, seed: int, *, resume: bool) -> Path:
    path = folder / f"{seed}.npz"
    if not (resume and path.is_file()):
        cv2.setNumThreads(1)
        camera = load(CONFIG_DIR / "camera.yaml", Camera)
        samples = lead_samples(seed, camera, frames=FRAMES_PER_ROAD)
        fresh = path.with_suffix(".new")
        with fresh.open("wb") as file:
            np.savez(
                file,
                strips=np.stack([sample.strips for sample in samples]),
                vehicles=np.stack([sample.vehicles for sample in samples]),
            )
        fresh.replace(path)
    return path


def _loaded(paths: Iterable[Path]) -> tuple[np.ndarray, np.ndarray]:
    parts = [np.load(path) for path in paths]
    return tuple(np.concatenate([part[name] for part in parts]) for name in ("strips", "vehicles"))  # type: ignore[return-value]


def _matches(network: Path, paths: Iterable[Path]) -> list[Match]:
    runner = open_session(network.read_bytes(), network)
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


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)
