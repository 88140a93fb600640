"""Results and frames of the clips on disk, from which an interrupted benchmark continues.

The results of a clip are rows of :class:`sim_harness.sweep.store.Store`: the truth, and one row an estimator, keyed
by the code of that estimator.
"""

import os
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from lab.bench.perception.clips import ClipCase
from lab.bench.perception.watch import LOOK, TRUTH, WatchedClip
from sim_harness.sweep.store import Store
from trepid.types import Image

SHOWN = "truth"  # name of the row that is not of an estimator


class ClipStore:
    """Results on clips by estimators with the code ``codes`` (name -> hash), drawn by the code ``drawing``."""

    def __init__(self, store: Store, drawing: str, codes: Mapping[str, str]) -> None:
        self._store = store
        self._codes = {SHOWN: drawing} | {name: f"{drawing} {code}" for name, code in codes.items()}

    def read(self, case: ClipCase) -> WatchedClip | None:
        """The stored results on a clip; None when there are none."""
        rows = {name: self._store.get(f"{case.key} {name}", code) for name, code in self._codes.items()}
        arrays = {
            name: np.array([tuple(frame) for frame in row["frames"]], TRUTH if name == SHOWN else LOOK)
            for name, row in rows.items()
            if row is not None
        }
        return WatchedClip(arrays.pop(SHOWN), arrays) if SHOWN in arrays else None

    def write(self, case: ClipCase, watched: WatchedClip) -> None:
        """Append the results on a clip."""
        for name, looks in {**watched.looks, SHOWN: watched.truth}.items():
            self._store.add(f"{case.key} {name}", self._codes[name], {"frames": looks.tolist()})


class StoredFrames:
    """The frames of a clip as one tall PNG, rendered once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, case: ClipCase, height_px: int) -> list[Image] | None:
        """The frames of a clip; None where they are not stored."""
        path = self._folder / f"{case.key}.png"
        image = cv2.imread(str(path)) if path.is_file() else None
        if image is None:
            return None
        return list(image.astype(np.uint8, copy=False).reshape(-1, height_px, *image.shape[1:]))

    def write(self, case: ClipCase, frames: list[Image]) -> None:
        """Store the frames of a clip."""
        self._folder.mkdir(parents=True, exist_ok=True)
        part = self._folder / f"{case.key}.{os.getpid()}.part.png"
        cv2.imwrite(str(part), np.concatenate(frames), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        part.replace(self._folder / f"{case.key}.png")
