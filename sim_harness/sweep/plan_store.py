"""The stored results of a sweep: JSON Lines, from which an interrupted sweep continues, and Parquet at the end.

Parquet files are complete only when they are closed, so they are made from the lines when the store is closed.
"""

import json
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from sim_harness.sweep.outcome import is_complete
from sim_harness.sweep.plan import Plan
from sim_harness.sweep.store import CODE, Row, Store, content
from trepid.config import InputError
from trepid.files.whole import replacing

RUNS = "runs"  # name of the files in a folder


class PlanStore:
    """The rows of a plan that ``code`` computed; complete ones by key in ``done``. Use as a context manager.

    ``out`` is a folder, a .jsonl file, or a .parquet file with the .jsonl file in the same folder.
    """

    def __init__(self, out: Path, plan: Plan, *, code: str, resume: bool) -> None:
        """Raises InputError when ``out`` cannot be written, is not to be resumed, or belongs to another plan."""
        self.lines, self.parquet = _files(out)
        self._code = code
        if self.lines.exists() and self.lines.stat().st_size and not resume:
            raise InputError(f"{self.lines}: holds results; --resume continues with them")
        self._store = Store(self.lines, fields={"trace_sha256"})
        stored = self._store.newest
        foreign = stored.keys() - plan.keys()
        if foreign:
            self._store.close()
            raise InputError(
                f"{self.lines}: of another plan: {len(foreign)} of its cases are not in this one"
            )
        current = {key: row for key, row in stored.items() if row[CODE] == self._code}
        self.done = {key: content(row) for key, row in current.items() if is_complete(row)}
        self.crashed, self.outdated = len(current) - len(self.done), len(stored) - len(current)

    def add(self, key: str, row: Row) -> None:
        """Append a row; after the return only a failure of the machine can lose it."""
        self._store.add(key, self._code, row)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Write the Parquet file, if there is to be one, and release the lines for other processes."""
        try:
            if self.parquet is not None:
                write_parquet(self._store.newest.values(), self.parquet)
        finally:
            self._store.close()


def _files(out: Path) -> tuple[Path, Path | None]:
    """The .jsonl file of ``out``, and the .parquet file if there is to be one. Raises InputError."""
    has_arrow = find_spec("pyarrow") is not None
    if out.suffix == ".jsonl":
        return out, None
    if out.suffix == ".parquet":
        if not has_arrow:
            raise InputError(f"{out}: Parquet needs pyarrow: pip install 'trepid[report]'")
        return out.with_suffix(".jsonl"), out
    if out.suffix and not out.is_dir():
        raise InputError(f"{out}: expected a folder, a .jsonl file or a .parquet file")
    return out / f"{RUNS}.jsonl", out / f"{RUNS}.parquet" if has_arrow else None


def write_parquet(rows: Iterable[Row], path: Path) -> None:
    """Write ``rows`` to ``path`` atomically, for pandas, Polars, DuckDB and the like. Needs pyarrow.

    A column for every field; one ``parameters.<name>`` for every parameter that was sampled; ``modes`` and
    ``causes`` are maps.
    """
    import pyarrow as pa
    import pyarrow.parquet

    flat = []
    for row in rows:
        parameters = {f"parameters.{name}": value for name, value in row.get("parameters", {}).items()}
        flat.append({name: value for name, value in row.items() if name != "parameters"} | parameters)
    names = dict.fromkeys(name for row in flat for name in row)
    columns = {name: _column(name, [row.get(name) for row in flat]) for name in names}
    with replacing(path) as fresh:
        pa.parquet.write_table(pa.table(columns), fresh)


def _column(name: str, values: list[Any]) -> Any:
    import pyarrow as pa

    if name in ("modes", "causes"):
        pairs = [None if value is None else list(value.items()) for value in values]
        return pa.array(pairs, pa.map_(pa.string(), pa.float64()))
    if name == "reasons":
        return pa.array(values, pa.list_(pa.string()))
    try:
        return pa.array(values)
    except (pa.ArrowInvalid, pa.ArrowTypeError):  # values of several types, e.g. numbers and words
        return pa.array([None if value is None else json.dumps(value) for value in values])
