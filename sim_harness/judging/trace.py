"""The trace of a run: one sample per vehicle tick, as named columns of float64.

A long run puts its rows away in blocks: in memory, or in an unnamed temporary file. A disk that is full or refuses
to be written changes nothing but the place: later blocks then stay in memory.
"""

import hashlib
import math
import os
import tempfile
import zlib
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import IO
from zipfile import BadZipFile

import numpy as np

from trepid.config import InputError
from trepid.messages import Command, Decision, SimTruth, SteeringEstimate, VehicleState
from trepid.types import Column


class Blocks:
    """Blocks of rows of one width, in order."""

    def __init__(self, width: int, *, on_disk: bool) -> None:
        self._width = width
        self._kept: list[Column] = []  # after those in the file
        self._file: IO[bytes] | None = None
        self._size = 0  # of the blocks in the file [bytes]
        if on_disk:
            with suppress(OSError):
                self._file = tempfile.TemporaryFile()  # noqa: SIM115 - lives as long as this object

    def add(self, block: Column) -> None:
        """Append the rows of ``block``."""
        if self._kept or not self._is_written(block.tobytes()):
            self._kept.append(block)

    def table(self) -> Column:
        """All rows."""
        stored = b"" if self._file is None else os.pread(self._file.fileno(), self._size, 0)
        return np.concatenate([np.frombuffer(stored).reshape(-1, self._width), *self._kept], dtype=np.float64)

    def _is_written(self, data: bytes) -> bool:
        if self._file is None:
            return False
        with suppress(OSError):
            if os.pwrite(self._file.fileno(), data, self._size) == len(data):
                self._size += len(data)
                return True
        return False


TRUTH_COLUMNS = (
    "t_s",
    "x_m",
    "y_m",
    "yaw_rad",
    "station_m",
    "lateral_offset_m",
    "heading_error_rad",
    "curvature_1pm",
    "lane_width_m",
    "lateral_accel_mps2",
    "longitudinal_accel_mps2",
    "departures",
    "interventions",
    "collisions",
    "lead_gap_m",
    "lead_x_m",
    "lead_y_m",
    "finished",
)
STATE_COLUMNS = ("speed_mps", "road_wheel_angle_rad", "yaw_rate_radps")
COMMAND_COLUMNS = ("t_s", "road_wheel_angle_rad", "speed_mps", "accel_mps2")
DECISION_COLUMNS = (
    "t_s",
    "fear",
    "lateral_offset_m",
    "heading_error_rad",
    "curvature_1pm",
    "disagreement_mps2",
    "speed_factor",
    "speed_cap_mps",
)
ESTIMATE_COLUMNS = ("t_s", "lateral_offset_m", "heading_error_rad", "curvature_1pm", "confidence")
BLOCK = 1000  # samples that are put away together
_TRUTH, _STATE = attrgetter(*TRUTH_COLUMNS), attrgetter(*STATE_COLUMNS)
_COMMAND, _NO_COMMAND = attrgetter(*COMMAND_COLUMNS), (None,) * len(COMMAND_COLUMNS)
_DECISION, _NO_DECISION = attrgetter(*DECISION_COLUMNS), (None,) * len(DECISION_COLUMNS)
_ESTIMATE, _NO_ESTIMATE = attrgetter(*ESTIMATE_COLUMNS), (None,) * len(ESTIMATE_COLUMNS)
USER_GAP = "road_user_gap_m"  # column of runs with people, cyclists or animals: to the nearest, 0 in contact
LABELS = ("section", "mode", "stop", "cause", "path_source")  # columns of codes into a table of words


def column_names(estimators: tuple[str, ...] = ()) -> list[str]:
    """Names of the columns of a run with ``estimators``, in order."""
    names = [*TRUTH_COLUMNS, *STATE_COLUMNS]
    names += [f"command.{name}" for name in COMMAND_COLUMNS]
    names += [f"decision.{name}" for name in DECISION_COLUMNS]
    names += LABELS
    names += [f"{estimator}.{name}" for estimator in estimators for name in ESTIMATE_COLUMNS]
    return names


@dataclass(frozen=True, slots=True)
class Trace:
    """Columns of equal length. NaN stands for None; the code -1 for "no decision yet"."""

    columns: Mapping[str, Column]
    words: Mapping[str, tuple[str, ...]]  # label column -> word of each code

    def __getitem__(self, name: str) -> Column:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.columns["t_s"])

    def with_columns(self, columns: Mapping[str, Column]) -> "Trace":
        """This trace with more columns, such as ``fault.frozen_camera``. Raises ValueError for wrong lengths."""
        for name, column in columns.items():
            if len(column) != len(self):
                raise ValueError(f"column {name} has {len(column)} samples, the trace {len(self)}")
        return Trace({**self.columns, **columns}, self.words)

    @property
    def sha256(self) -> str:
        """Hash of every column (name, little-endian float64) and word: equal for bit-identical runs only."""
        digest = hashlib.sha256()
        for name, column in self.columns.items():
            digest.update(name.encode() + b"\0" + column.astype("<f8").tobytes())
        for name, words in self.words.items():
            digest.update("\0".join((name, *words)).encode())
        return digest.hexdigest()

    def save(self, path: Path) -> None:
        """Write a compressed .npz: the columns, and for each label column its words as ``words.<label>``."""
        words = {f"words.{name}": np.array(words, dtype=np.str_) for name, words in self.words.items()}
        with path.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **self.columns, **words)

    @classmethod
    def load(cls, path: Path) -> "Trace":
        """The trace that :meth:`save` wrote. Raises InputError for any other file."""
        try:
            with np.load(path, allow_pickle=False) as saved:
                arrays = {name: saved[name] for name in saved.files}
        except (OSError, ValueError, TypeError, EOFError, BadZipFile, zlib.error) as error:
            raise InputError(f"{path}: is no saved trace: {error}") from error
        columns = {name: array for name, array in arrays.items() if not name.startswith("words.")}
        words = {
            name.removeprefix("words."): tuple(map(str, np.atleast_1d(array)))
            for name, array in arrays.items()
            if name.startswith("words.")
        }
        fault = _fault(columns, words)
        if fault:
            raise InputError(f"{path}: is no saved trace: {fault}")
        return cls(columns, words)


def _fault(columns: Mapping[str, np.ndarray], words: Mapping[str, tuple[str, ...]]) -> str:
    """What is wrong with the arrays of a file; "" for a trace."""
    absent = [name for name in column_names() if name not in columns]
    absent += [f"words.{label}" for label in LABELS if label not in words]
    if absent:
        return f"it has no column {absent[0]}"
    for name, column in columns.items():
        if column.dtype != np.float64 or column.shape != (columns["t_s"].size,):
            return f"{name} is no column of {columns['t_s'].size} numbers"
    for label in LABELS:
        if not np.isin(columns[label], np.arange(-1, len(words[label]))).all():
            return f"{label} has a code without a word"
    return ""


class Recorder:
    """Collects the samples of a run with the given estimators."""

    def __init__(self, estimators: tuple[str, ...] = (), *, on_disk: bool = False) -> None:
        """``on_disk``: samples are put away in a temporary file, so that a long run needs no more memory."""
        self._estimators = estimators
        self._names = column_names(estimators)
        self._blocks = Blocks(len(self._names), on_disk=on_disk)
        self._rows: list[tuple[float | None, ...]] = []  # not put away yet
        self._codes: dict[str, dict[str, int]] = {label: {} for label in LABELS}
        self._decision: Decision | None = None  # the newest one, ...
        self._decided: tuple[float | None, ...] = _NO_DECISION  # ... its numbers, ...
        self._labels: tuple[int, ...] = (-1,) * (len(LABELS) - 1)  # ... and the codes of its words

    def add(
        self,
        truth: SimTruth,
        state: VehicleState,
        command: Command | None,
        decision: Decision | None,
        estimates: Mapping[str, SteeringEstimate | None],
    ) -> None:
        """Append one sample: the truth and the latest of everything else."""
        if decision is not self._decision:  # decisions are immutable: read each of them once
            self._decision = decision
            self._decided = _DECISION(decision) if decision else _NO_DECISION
            self._labels = tuple(
                [self._code(label, getattr(decision, label)) if decision else -1 for label in LABELS[1:]]
            )
        row = [*_TRUTH(truth), *_STATE(state)]
        row += _COMMAND(command) if command else _NO_COMMAND
        row += self._decided
        row.append(self._code("section", truth.section))
        row += self._labels
        for name in self._estimators:
            estimate = estimates.get(name)
            row += _ESTIMATE(estimate) if estimate else _NO_ESTIMATE
        self._rows.append(tuple(row))
        if len(self._rows) == BLOCK:
            self._store_block()

    def _store_block(self) -> None:
        self._blocks.add(np.array(self._rows, dtype=np.float64).reshape(-1, len(self._names)))
        self._rows.clear()

    def trace(self) -> Trace:
        """The trace of all samples so far."""
        self._store_block()
        table = self._blocks.table()
        table[np.isnan(table)] = math.nan  # one bit pattern for every NaN
        columns = {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(self._names)}
        return Trace(columns, {label: tuple(codes) for label, codes in self._codes.items()})

    def _code(self, label: str, word: str) -> int:
        codes = self._codes[label]
        return codes.setdefault(str(word), len(codes))
