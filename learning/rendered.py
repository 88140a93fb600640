"""Shared by both trainings: frames of random roads kept in a folder, and weights with their record."""

import hashlib
import importlib.util
import json
import os
import time
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from pydantic import BaseModel

from sim_harness.sweep.pool import imap
from trepid.config import WORK_DIR, InputError
from trepid.files.whole import replacing
from trepid.loudness import note

SHIPPED = WORK_DIR / "perception" / "weights"
VERSIONS = ("torch", "onnx", "onnxruntime", "numpy", "opencv-python-headless")
ROADS_PER_SEED = 1_000_000  # every training seed has a million roads of its own, divided below
FIRST_ROAD = {"train": 0, "validation": 800_000, "test": 900_000}
Report = Callable[[str], None]
Part = dict[str, Any]  # arrays of the frames of one road, by name
WeightsFolder = Annotated[
    Path, typer.Option(help="Folder for the weights.", show_default="perception/weights")
]


def need_torch(verb: str) -> None:
    """Raises InputError unless torch is installed."""
    if importlib.util.find_spec("torch") is None:
        raise InputError(f"trepid {verb} needs the extra: pip install -e '.[train]'")


def say(text: str) -> None:
    """Progress, beside the output of the verb."""
    note(text)


def render_roads(
    render: Callable[[int], Part],
    split: str,
    roads: int,
    *,
    seed: int,
    folder: Path,
    reuse: bool,
    key: str = "",
    report: Report = say,
    jobs: int | None = None,
) -> Iterator[Path]:
    """Files with the parts that ``render`` returns for the roads of ``split``, rendered by ``jobs`` processes.

    Without ``jobs`` every core renders.
    Splits and seeds share no road. With ``reuse``, roads that an earlier call with the same ``key`` rendered are
    not rendered again.
    """
    folder = folder / f"{split}-seed{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    stored = folder / "key.txt"
    if not (reuse and stored.is_file() and stored.read_text(encoding="utf-8") == key):
        for old in folder.glob("*.npz"):
            old.unlink()
        stored.write_text(key, encoding="utf-8")
    first, started_s = seed * ROADS_PER_SEED + FIRST_ROAD[split], time.monotonic()
    paths = imap(partial(_road, render, folder), range(first, first + roads), jobs or cores())
    for number, path in enumerate(paths, start=1):
        yield path
        if number % 10 == 0 or number == roads:
            left_s = (time.monotonic() - started_s) * (roads - number) / number
            report(f"{split}: {number}/{roads} roads rendered, {left_s / 60:.1f} min left")


def cores() -> int:
    """The cores of this machine."""
    return os.cpu_count() or 1


def _road(render: Callable[[int], Part], folder: Path, seed: int) -> Path:
    """File with the part of the road ``seed``, rendered unless it exists."""
    path = folder / f"{seed}.npz"
    if not path.is_file():
        cv2.setNumThreads(1)
        with replacing(path) as fresh, fresh.open("wb") as file:
            np.savez(file, **render(seed))
    return path


def run_alone(command: Callable[..., None]) -> None:
    """Run ``command`` as a program of its own: bad input is one line and exit code 2."""
    try:
        typer.run(command)
    except InputError as error:
        typer.echo(error, err=True)
        raise SystemExit(2) from error


def origin(network: Path, command: str) -> dict[str, Any]:
    """The fields of a record that every network has: its hash, and how and when it was made."""
    return dict(
        sha256=hashlib.sha256(network.read_bytes()).hexdigest(),
        command=command,
        date=datetime.now(UTC).date().isoformat(),
        versions={name: version(name) for name in VERSIONS},
    )


def ship(network: Path, record: BaseModel, folder: Path) -> None:
    """Copy ``network`` into ``folder`` and write ``record`` beside it."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / network.name).write_bytes(network.read_bytes())
    text = json.dumps(record.model_dump(), indent=1, ensure_ascii=False)
    (folder / network.name).with_suffix(".json").write_text(text + "\n", encoding="utf-8")
