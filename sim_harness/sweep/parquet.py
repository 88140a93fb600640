"""Rows of a sweep as a Parquet file, for pandas, Polars, DuckDB and the like. Needs pyarrow, extra ``report``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet

from sim_harness.sweep.store import Row

SECONDS = ("modes", "causes")  # name -> seconds
PARAMETERS = "parameters"


def write(rows: Sequence[Row], path: Path) -> None:
    """Write ``rows`` to ``path`` atomically.

    A column for every field; one ``parameters.<name>`` for every parameter that was sampled; ``modes`` and
    ``causes`` are maps.
    """
    flat = [_flat(row) for row in rows]
    names = list(dict.fromkeys(name for row in flat for name in row))
    columns = {name: _column(name, [row.get(name) for row in flat]) for name in names}
    partial = path.with_name(path.name + ".partial")
    pa.parquet.write_table(pa.table(columns), partial)
    partial.replace(path)


def _flat(row: Row) -> Row:
    parameters = {f"{PARAMETERS}.{name}": value for name, value in row.get(PARAMETERS, {}).items()}
    return {**{name: value for name, value in row.items() if name != PARAMETERS}, **parameters}


def _column(name: str, values: list[Any]) -> pa.Array:
    if name in SECONDS:
        pairs = [None if value is None else list(value.items()) for value in values]
        return pa.array(pairs, pa.map_(pa.string(), pa.float64()))
    if name == "reasons":
        return pa.array(values, pa.list_(pa.string()))
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):  # values of several types, e.g. numbers and words
        return pa.array([None if value is None else json.dumps(value) for value in values])
