"""Results and frames of the clips on disk, from which an interrupted benchmark continues.

The results of a clip are rows of :class:`sim_harness.sweep.store.Store`: the truth, and one row an estimator, keyed
by the code of that estimator.
"""

import os
from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np

from sim_harness.bench.perception.clips import Case
from sim_harness.bench.perception.watch import LOOK, TRUTH, Looks, Watched
from sim_harness.sweep.store import Row, Store
from trepid.types import Image

SHOWN = "truth"  # name of the row that is not of an estimator


class ClipStore:
    """Results on clips by estimators with the code ``codes`` (name -> hash), drawn by the code ``drawing``."""

    def __init__(self, store: Store, drawing: str, codes: Mapping[str, str]) -> None:
        self._store, self._drawing = store, drawing
        self._codes = {name: f"{drawing} {code}" for name, code in codes.items()}

    def read(self, case: Case) -> Watched | None:
        """The stored results on a clip; None when there are none."""
        truth = self._store.get(_key(case, SHOWN), self._drawing)
        if truth is None:
            return None
        rows = {name: self._store.get(_key(case, name), code) for name, code in self._codes.items()}
        return Watched(
            _array(truth, TRUTH), {n: _array(row, LOOK) for n, row in rows.items() if row is not None}
        )

    def write(self, case: Case, watched: Watched) -> None:
        """Append the results on a clip."""
        for name, looks in watched.looks.items():
            self._store.add(_key(case, name), self._codes[name], _row(looks))
        self._store.add(_key(case, SHOWN), self._drawing, _row(watched.truth))


def _key(case: Case, name: str) -> str:
    return f"{case.key} {name}"


def _row(looks: Looks) -> Row:
    return {"frames": looks.tolist()}


def _array(row: Row, dtype: np.dtype[np.void]) -> Looks:
    return np.array([tuple(frame) for frame in row["frames"]], dtype)


class Pictures:
    """The frames of a clip as one tall PNG, rendered once."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, case: Case, height_px: int) -> list[Image] | None:
        """The frames of a clip; None where they are not stored."""
        path = self._folder / f"{case.key}.png"
        image = cv2.imread(str(path)) if path.is_file() else None
        if image is None:
            return None
        return list(image.astype(np.uint8, copy=False).reshape(-1, height_px, *image.shape[1:]))

    def write(self, case: Case, frames: list[Image]) -> None:
        """Store the frames of a clip."""
        self._folder.mkdir(parents=True, exist_ok=True)
        part = self._folder / f"{case.key}.{os.getpid()}.part.png"
        cv2.imwrite(str(part), np.concatenate(frames), [cv2.IMWRITE_PNG_COMPRESSION, 1])
        part.replace(self._folder / f"{case.key}.png")
