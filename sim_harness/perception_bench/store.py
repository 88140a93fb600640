"""What was watched, clip by clip on disk, so that a bench that was interrupted goes on where it was.

A folder belongs to a seed and to the code: with other code or configuration nothing is taken from it.
"""

import os
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from sim_harness.perception_bench.clips import Case
from sim_harness.perception_bench.watch import Watched
from trepid.messages import Image


class Store:
    """Clips of a seed below a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, case: Case) -> Watched | None:
        """What is known of a clip; None: nothing."""
        path = self._folder / f"{case.key}.npz"
        if not path.is_file():
            return None
        with np.load(path) as arrays:
            looks = {
                name.removeprefix("looks "): arrays[name] for name in arrays if name.startswith("looks ")
            }
            return Watched(arrays["truth"], looks, arrays["bare_chain_s"])

    def write(self, case: Case, watched: Watched) -> Watched:
        """Add to what is known of a clip, and give all of it. A file is whole or not there."""
        known = self.read(case)
        looks = {**(known.looks if known else {}), **watched.looks}
        self._folder.mkdir(parents=True, exist_ok=True)
        path = self._folder / f"{case.key}.npz"
        part = path.with_suffix(f".{os.getpid()}.part")
        with part.open("wb") as file:
            named: dict[str, Any] = {f"looks {name}": array for name, array in looks.items()}
            np.savez(file, truth=watched.truth, bare_chain_s=watched.bare_chain_s, **named)
        part.replace(path)
        return Watched(watched.truth, looks, watched.bare_chain_s)


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
