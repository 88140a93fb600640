"""What a reader finds in the log of a drive, before it is labelled."""

import hashlib
import math
import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trepid.config import InputError
from trepid.loudness import warn
from trepid.types import Column

LICENCE = re.compile(r"(?i)\blicen[cs]e\b[^\n]*")
MOST_NAMED = 20  # faults that are printed one by one
MOST_BEYOND = 0.01  # share of rows beyond ±1 in a share of full steering


class SteeringUnit(StrEnum):
    """The unit of recorded steering."""

    LOCK = "lock"  # share of full steering, -1 to 1
    ROAD = "road wheel"  # angle of the road wheels [rad]
    KINEMATIC = "kinematic"  # that a car without understeer would need [rad]
    WHEEL = "steering wheel"  # angle of the steering wheel [rad]


@dataclass(kw_only=True)
class Log:
    """n frames in the order of the log. Missing numbers are NaN."""

    kind: str
    path: Path
    root: Path  # of the images
    files: tuple[Path, ...]  # that hold the log
    image: list[str]  # below root
    item: NDArray[np.int64]  # in a video or recording; -1: an image file
    t_s: Column
    route: list[str]
    steering: Column
    speed_mps: Column
    yaw_rate_radps: Column
    why: list[str]  # the reason to leave the frame out; empty: none
    where: list[str] = field(default_factory=list)  # file and line of each row; empty: the log has no lines
    unit: SteeringUnit
    left_positive: bool  # as the format has it
    lock_rad: float | None = None  # that the format prescribes, or that is usual for it
    lock_source: str = ""  # why so
    unread: int = 0  # rows that cannot be read
    topic: str | None = None
    left: list[str] = field(default_factory=list)  # images of the left camera, as ``image``; "": none
    right: list[str] = field(default_factory=list)
    camera_left_m: float = 0.0  # place of the camera to the left of the middle one
    notes: list[str] = field(default_factory=list)

    def __len__(self) -> int:
        return len(self.image)

    def place(self, row: int) -> str:
        """Where row number ``row`` stands."""
        return self.where[row] if self.where else f"{self.path}: frame {row} ({self.image[row]})"


class Faults:
    """Rows and images that cannot be used: each is named on standard error and left out."""

    def __init__(self, *, strict: bool) -> None:
        """``strict``: the first one ends the run with its error."""
        self._strict = strict
        self.count = 0
        self.rows = 0  # that the faults cost

    def __call__(self, text: str, *, rows: int = 1, remedy: str = "left out") -> None:
        """Report a fault that costs ``rows``, and what is done about it. Raises InputError when strict."""
        if self._strict:
            raise InputError(text)
        self.count += 1
        self.rows += rows
        if self.count <= MOST_NAMED:
            warn(f"trepid: {text}; {remedy}")

    def close(self) -> None:
        """Report the number of faults that were not named."""
        if self.count > MOST_NAMED:
            warn(f"trepid: {self.count - MOST_NAMED} more of these, left out as well")


def sha256_of_files(paths: Iterable[Path]) -> str:
    """SHA-256 of the contents of files, one after the other. Raises InputError."""
    digest = hashlib.sha256()
    for path in paths:
        try:
            with path.open("rb") as file:
                while data := file.read(1 << 20):
                    digest.update(data)
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    return digest.hexdigest()


def licence_beside(folder: Path) -> str | None:
    """What a MANIFEST in ``folder`` says about the licence; None without one. Raises InputError."""
    for path in sorted(path for path in folder.glob("MANIFEST*") if path.is_file()):
        try:
            text = path.read_text(encoding="utf-8", errors="replace")
        except OSError as error:
            raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
        found = LICENCE.search(text)
        if found:
            return found.group().strip()
    return None


def number(value: object) -> float:
    """``value`` as a number; NaN for None, empty text and null. Raises ValueError for others and infinite ones."""
    if value is None or value == "":
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise ValueError(f"expected a number, got {value!r}")
    try:
        found = float(value)
    except (ValueError, OverflowError):
        raise ValueError(f"expected a number, got {value!r}") from None
    if math.isinf(found):
        raise ValueError(f"expected a finite number, got {value!r}")
    return found


def refuse_beyond_lock(what: str, values: Column, remedy: str) -> None:
    """Raise InputError for steering without unit, ``what`` by its place, that is no share of full steering."""
    if np.nanmax(np.abs(values), initial=0.0) > 1.0 and np.mean(np.abs(values) > 1.0) > MOST_BEYOND:
        raise InputError(f"{what} exceeds ±1, so it is no share of full steering; {remedy}")
