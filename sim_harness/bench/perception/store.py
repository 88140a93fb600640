"""What was watched, clip by clip on disk, so that a bench that was interrupted goes on where it was.

A folder belongs to a seed and to the code that draws; what an estimator saw is good as long as its own code is.
"""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sim_harness.bench.perception.clips import Case
from sim_harness.bench.perception.watch import Watched
from trepid.types import Image

TRUTH = "the truth"


class Store:
    """Clips of a seed below a folder, as seen by estimators with the code ``codes`` (name -> hash)."""

    def __init__(self, folder: Path, codes: Mapping[str, str]) -> None:
        self._folder, self._codes = folder, codes

    def read(self, case: Case) -> Watched | None:
        """What is known of a clip; None: nothing."""
        arrays = self._arrays(case)
        if not arrays:
            return None
        looks = {name: arrays[key] for name in self._codes if (key := self._key(name)) in arrays}
        return Watched(arrays[TRUTH], looks)

    def write(self, case: Case, watched: Watched) -> None:
        """Add to what is known of a clip. A file is whole or not there."""
        new = {self._key(name): looks for name, looks in watched.looks.items()}
        old = {key: array for key, array in self._arrays(case).items() if key.split()[0] not in watched.looks}
        arrays: dict[str, Any] = {**old, **new, TRUTH: watched.truth}
        self._folder.mkdir(parents=True, exist_ok=True)
        part = self._path(case).with_suffix(f".{os.getpid()}.part")
        with part.open("wb") as file:
            np.savez(file, **arrays)
        part.replace(self._path(case))

    def _arrays(self, case: Case) -> dict[str, NDArray[Any]]:
        """All that is on file of a clip, also what other code saw."""
        if not self._path(case).is_file():
            return {}
        with np.load(self._path(case)) as arrays:
            return dict(arrays)

    def _path(self, case: Case) -> Path:
        return self._folder / f"{case.key}.npz"

    def _key(self, name: str) -> str:
        return f"{name} {self._codes[name]}"


class Pictures:
    """The frames of a clip as one tall PNG: what is drawn once need not be drawn again."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, case: Case, height_px: int) -> list[Image] | None:
        """The frames of a clip; None where they are not kept."""
        path = self._folder / f"{case.key}.png"
        image = cv2.imread(str(path)) if path.is_file() else None
        if image is None:
            return None
        return list(image.astype(np.uint8, copy=False).reshape(-1, height_px, *image.shape[1:]))

    def write(self, case: Case, frames: list[Image]) -> None:
        """Keep the frames of a clip."""
        self._folder.mkdir(parents=True, exist_ok=True)
        part = self._folder / f"{case.key}.{os.getpid()}.part.png"
        cv2.imwrite(str(part), np.concatenate(frames), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        part.replace(self._folder / f"{case.key}.png")
