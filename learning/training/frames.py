"""Frames of a data set at the size of a network, in files that are read as memory, and their labels."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import Dataset, pieces_of
from trepid.types import Floats, Image

REPORT_EVERY = 1000


class Frames(NamedTuple):
    """The frames of a split, in the order of routes and time."""

    images: Image  # (n, H, W, 3) BGR, on the disk
    labels_rad: Floats  # (n,), + = left
    stretches: NDArray[np.int32]  # (n,): numbers of stretches of the drives without a pause ...
    pieces: NDArray[np.int64]  # ... and of parts of them of which no frame is left out
    routes: tuple[str, ...]  # their names, each once
    speeds_mps: Floats | None = None  # (n,) of the driver, NaN: not recorded; None: not read

    def __len__(self) -> int:
        return len(self.labels_rad)

    def windows(self, length: int, stride: int) -> NDArray[np.int64]:
        """Places (m, length) of the frames of all sequences: every ``stride``-th frame, within one piece."""
        reach = (length - 1) * stride
        last = np.arange(reach, len(self))
        last = last[self.pieces[last] == self.pieces[last - reach]] if len(last) else last
        return last[:, None] - np.arange(reach, -1, -stride)[None]


def share_of(count: int, share: float) -> NDArray[np.int64]:
    """Places of ``share`` of ``count`` sequences, evenly in time."""
    return np.unique(np.linspace(0, count - 1, max(1, round(share * count))).astype(np.int64))


def read_frames(
    data: Dataset, split: str, *, height: int, width: int, folder: Path, report: Callable[[str], None]
) -> Frames:
    """The frames of a split, scaled by area to ``height`` x ``width``.

    They are kept in ``folder``; those of an earlier call for the same data and size are used again. Raises
    InputError when the split has none.
    """
    rows = data.labelled_rows(split)
    path, stored = folder / f"{split}.npy", folder / f"{split}.json"
    key = json.dumps({"data": data.sha256, "height": height, "width": width})
    if not (path.is_file() and stored.is_file() and stored.read_text(encoding="utf-8") == key):
        folder.mkdir(parents=True, exist_ok=True)
        stored.unlink(missing_ok=True)
        images = np.lib.format.open_memmap(path, "w+", np.uint8, (len(rows), height, width, 3))
        for number, image in enumerate(data.images(rows), start=1):
            images[number - 1] = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            if number % REPORT_EVERY == 0:
                report(f"{split}: {number}/{len(rows)} frames read")
        images.flush()
        stored.write_text(key, encoding="utf-8")
    return Frames(
        np.load(path, mmap_mode="r"),
        rows["road_wheel_rad"].astype(np.float32),
        rows["stretch"].astype(np.int32),
        pieces_of(rows),
        tuple(dict.fromkeys(rows["route"].tolist())),
        rows["speed_mps"].astype(np.float32),
    )


def forget_frames(split: str, folder: Path) -> None:
    """Remove the frames of ``split`` that :func:`read_frames` keeps in ``folder``."""
    for suffix in (".npy", ".json"):
        (folder / f"{split}{suffix}").unlink()
