"""Several data sets as one: the rows one after the other, and the sources of all."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

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
from learning.dataset.likeness import SMALL, ImageMeasurements, small_grey
from learning.dataset.sides import NOT_JUDGED
from learning.dataset.split import clear_duplicates, clear_gaps

PART_S = 10.0  # of a drive of an added data set
VALIDATION, EVERY = 2, 6  # the third of every six parts is for validation


def join_datasets(out: Path, first: Dataset, added: Sequence[Dataset], command: str) -> Dataset:
    """Write ``first`` and the labelled frames of ``added`` into the folder ``out``.

    Steering and splits are described as in ``first``. The frames of an added data set that follow each other
    without a gap are a stretch of their own. Its drives are divided by the time since their first frame, so that
    the same part of a drive that is repeated has the same split. Rows that look like a row of a later split are
    left out. Raises InputError.
    """
    parts, sources = [first.rows()], list(_sources(first))
    stretch = int(first.rows()["stretch"].max(initial=-1)) + 1
    for dataset in added:
        every = dataset.rows()
        rows = _divide_rows(every, first.file.split.gap_s)[every["split"] != NONE]
        rows["source"] += len(sources)
        rows["stretch"] = stretch + pieces_of(rows)
        parts.append(rows)
        sources += _sources(dataset)
        stretch = int(rows["stretch"].max(initial=stretch - 1)) + 1
    columns = {name: np.concatenate([part[name] for part in parts]) for name in (*DATA, *MEASURED)}
    file = first.file.model_copy(update={"sources": tuple(sources), "command": command})
    split, why = columns["split"].astype("<U10"), columns["why"].astype("<U64")
    clear_duplicates(split, why, _look(Dataset(out, file, as_rows(columns))))
    split[why != ""] = NONE
    index = as_rows(columns | {"split": split, "why": why})
    write(out, file.model_copy(update={"data_sha256": sha256_of(index)}), index)
    return Dataset.open(out)


def _divide_rows(rows: Rows, gap_s: float) -> Rows:
    """The rows of an added data set for training and validation, with ``gap_s`` left out between the two."""
    _, drive = np.unique(rows["route"], return_inverse=True)
    first_s = np.full(len(rows), np.inf)  # of each drive
    np.minimum.at(first_s, drive, rows["t_s"])
    part = (rows["t_s"] - first_s[drive]) // PART_S
    split = np.where(part % EVERY == VALIDATION, "validation", "train").astype("<U10")
    why = rows["why"].astype("<U64")
    why[(split == "validation") & (rows["camera_left_m"] != 0.0) & (why == "")] = NOT_JUDGED
    clear_gaps(split, why, rows["t_s"], rows["route"], gap_s)
    columns = {name: rows[name] for name in rows.dtype.names or ()}
    return as_rows(columns | {"split": split, "why": why})


def _look(dataset: Dataset) -> ImageMeasurements:
    """The likeness of the rows of all splits; their images are read again."""
    rows = dataset.rows()
    small = np.zeros((len(rows), SMALL[1], SMALL[0]), np.uint8)
    (used,) = np.nonzero(rows["split"] != NONE)
    for number, image in zip(used, dataset.images(rows[used]), strict=True):
        small[number] = small_grey(image)
    return ImageMeasurements(rows["light"], rows["hash"], small, rows["change"], rows["shift"])


def _sources(dataset: Dataset) -> Iterator[Source]:
    """The sources, with absolute paths."""
    for source in dataset.file.sources:
        places = {name: (dataset.folder / getattr(source, name)).resolve() for name in ("path", "root")}
        yield source.model_copy(update=places)
