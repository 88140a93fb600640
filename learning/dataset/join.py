"""Several data sets as one: the rows one after the other, and the sources of all."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import (
    DATA,
    MEASURED,
    NONE,
    Dataset,
    Rows,
    Source,
    as_rows,
    pieces_of,
    sha256_of,
    write,
)

NOTHING_S = 1e-6  # rounding of times
VALIDATION_EVERY = 6  # groups of pieces of added data sets


def joined(out: Path, first: Dataset, added: Sequence[Dataset], command: str) -> Dataset:
    """Write ``first`` and the labelled frames of ``added`` into the folder ``out``.

    Steering and splits are described as in ``first``. The frames of an added data set that follow each other
    without a gap are a piece, a stretch of its own. Pieces of a route with less than ``gap_s`` of the split of
    ``first`` between them are a group; every sixth group is for validation, the others for training. Raises
    InputError.
    """
    parts, sources = [first.rows()], list(_sources(first))
    stretch, groups = int(first.rows()["stretch"].max(initial=-1)) + 1, 0
    for dataset in added:
        every = dataset.rows()
        rows = every[every["split"] != NONE]
        piece = pieces_of(rows)
        group = _groups(rows, piece, first.file.split.gap_s)
        columns = {name: rows[name] for name in rows.dtype.names or ()}
        split = np.where((groups + group) % VALIDATION_EVERY == VALIDATION_EVERY - 1, "validation", "train")
        columns |= {"source": rows["source"] + len(sources), "stretch": stretch + piece, "split": split}
        parts.append(as_rows(columns))
        sources += _sources(dataset)
        stretch += int(piece.max(initial=-1)) + 1
        groups += int(group.max(initial=-1)) + 1
    index = as_rows({name: np.concatenate([part[name] for part in parts]) for name in (*DATA, *MEASURED)})
    about = {"sources": tuple(sources), "data_sha256": sha256_of(index), "command": command}
    write(out, first.file.model_copy(update=about), index)
    return Dataset.open(out)


def _groups(rows: Rows, piece: NDArray[np.int64], gap_s: float) -> NDArray[np.int64]:
    """Number of the group of each row, from 0 on."""
    later = np.diff(rows["t_s"]) > gap_s - NOTHING_S
    apart = (np.diff(piece) != 0) & (later | (rows["route"][1:] != rows["route"][:-1]))
    return np.cumsum(np.concatenate([[False], apart]))[: len(rows)]


def _sources(dataset: Dataset) -> Iterator[Source]:
    """The sources, with absolute paths."""
    for source in dataset.file.sources:
        places = {name: (dataset.folder / getattr(source, name)).resolve() for name in ("path", "root")}
        yield source.model_copy(update=places)
