"""Small recorded drives in the formats of others: a bright line that leans into the bend, and its steering."""

import csv
import json
import math
import sys
from functools import cache
from pathlib import Path
from typing import Any
from unittest.mock import patch

import cv2
import numpy as np

from learning.dataset.dataset import Dataset
from trepid.cli import main
from trepid.types import Column, Image

PERIOD_S = 0.05
START_S = 1_600_000_000.0


def steering_of(frames: int) -> Column:
    """Steering as a share of full lock, + = right: slow bends to both sides."""
    return 0.6 * np.sin(2 * math.pi * np.arange(frames) / 40.0) + 0.2 * np.sin(np.arange(frames) / 7.0)


def picture(steering: float, number: int, *, width: int = 64, height: int = 48) -> Image:
    """A floor of random spots, different in every frame, with a line that leans to the side of the steering."""
    random = np.random.default_rng(number)
    image = np.asarray(random.integers(40, 120, (height, width, 3)), np.uint8)
    image = cv2.blur(image, (5, 5))
    top = (int(width * (0.5 + 0.45 * steering)), height // 4)
    cv2.line(image, (width // 2, height - 1), top, (255, 255, 255), 3)
    return np.asarray(image, np.uint8)


def write_pictures(folder: Path, names: list[str], steering: Column) -> None:
    """One JPEG a name."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(names):
        (folder / name).write_bytes(jpeg_of(float(steering[number]), number))


@cache
def jpeg_of(steering: float, number: int) -> bytes:
    """The picture as a JPEG, encoded once: most drives of the tests steer alike."""
    done, data = cv2.imencode(".jpg", picture(steering, number))
    assert done
    return data.tobytes()


def write_tub(
    folder: Path,
    frames: int = 400,
    *,
    deleted: tuple[int, ...] = (),
    pause_after: int = -1,
    gain: float = 1.0,
    speeds_mps: Column | None = None,
) -> Path:
    """A donkeycar tub of version 2 at 20 Hz, with a pause of 5 s after frame ``pause_after``.

    ``gain``: of its steering; 0 is straight ahead. ``speeds_mps``: by an encoder, NaN where it gives none.
    """
    steering = gain * steering_of(frames)
    names = [f"{n}_cam_image_array_.jpg" for n in range(frames)]
    write_pictures(folder / "images", names, steering)
    records: list[dict[str, Any]] = []
    for number, name in enumerate(names):
        at_s = START_S + number * PERIOD_S + (5.0 if number > pause_after >= 0 else 0.0)
        records.append(
            {
                "_index": number,
                "_session_id": "20-09-13_0",
                "_timestamp_ms": round(at_s * 1e3),
                "cam/image_array": name,
                "user/angle": float(steering[number]),
                "user/mode": "user",
                "user/throttle": 0.3,
            }
        )
        if speeds_mps is not None and np.isfinite(speeds_mps[number]):
            records[-1]["enc/speed"] = float(speeds_mps[number])
    (folder / "catalog_0.catalog").write_text("".join(json.dumps(record) + "\r\n" for record in records))
    manifest: list[Any] = [
        ["cam/image_array", "user/angle", "user/throttle", "user/mode"],
        ["image_array", "float", "float", "str"],
        {},
        {"created_at": START_S, "sessions": {"all_full_ids": ["20-09-13_0"]}},
        {
            "paths": ["catalog_0.catalog"],
            "current_index": frames,
            "max_len": 1000,
            "deleted_indexes": list(deleted),
        },
    ]
    (folder / "manifest.json").write_text("".join(json.dumps(part) + "\r\n" for part in manifest))
    return folder


def write_tub_1(folder: Path, frames: int = 60) -> Path:
    """A donkeycar tub of version 1."""
    steering = steering_of(frames)
    names = [f"{n}_cam-image_array_.jpg" for n in range(1, frames + 1)]
    write_pictures(folder, names, steering)
    inputs = {"inputs": ["cam/image_array", "user/angle"], "types": ["image_array", "float"]}
    (folder / "meta.json").write_text(json.dumps({**inputs, "start": START_S}))
    for number, name in enumerate(names):
        record = {
            "cam/image_array": name,
            "user/angle": float(steering[number]),
            "user/mode": "user",
            "milliseconds": round(1e3 * number * PERIOD_S),
        }
        (folder / f"record_{number + 1}.json").write_text(json.dumps(record))
    return folder


def write_udacity(folder: Path, frames: int = 400, *, header: bool = False, sides: bool = False) -> Path:
    """A log of the Udacity simulator: ``driving_log.csv`` and the images in ``IMG``.

    ``sides``: with images of the left and right cameras, which see the line further right and left.
    """
    steering = steering_of(frames)
    names = [
        f"center_2018_07_16_17_{11 + ms // 60000:02}_{ms // 1000 % 60:02}_{ms % 1000:03}.jpg"
        for ms in (50 * np.arange(frames)).tolist()
    ]
    write_pictures(folder / "IMG", names, steering)
    beside = {"left": 0.2, "right": -0.2} if sides else {}
    for side, shift in beside.items():
        write_pictures(folder / "IMG", [name.replace("center", side) for name in names], steering + shift)
    with (folder / "driving_log.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        if header:
            writer.writerow(["center", "left", "right", "steering", "throttle", "brake", "speed"])
        writer.writerows(
            [
                f"IMG/{name}",
                *(
                    f"IMG/{name.replace('center', side)}" if side in beside else ""
                    for side in ("left", "right")
                ),
                value,
                0.3,
                0,
                15.0,
            ]
            for name, value in zip(names, steering, strict=True)
        )
    return folder


def write_table(folder: Path, columns: dict[str, Any], name: str = "log.csv") -> Path:
    """A table with a header."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / name
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*columns.values(), strict=True))
    return path


def made_dataset(folder: Path, *sources: Path, options: tuple[str, ...] = (), code: int = 0) -> Dataset:
    """The data set that ``trepid dataset build`` makes of ``sources``; asserts its exit code."""
    assert run("dataset", "build", str(folder), *map(str, sources), *options) == code
    return Dataset.open(folder)


def run(*words: str) -> int:
    """The exit code of the command line ``trepid WORDS``."""
    with patch.object(sys, "argv", ["trepid", *words]):
        return main()
