"""The plan of a sweep: cases in order, each with a key that depends only on the case; its file beside the results.

Parquet files are complete only when they are closed, so they are made from the lines when the store is closed.
"""

import hashlib
import json
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Self

from sim_harness.scenarios.sampling import Case, Method, cases
from sim_harness.scenarios.scenario import Scenario, list_scenarios, load_scenarios
from sim_harness.sweep.outcome import is_complete
from sim_harness.sweep.store import CODE, Row, Store, content
from trepid.config import InputError
from trepid.files.whole import replacing
from trepid.spelling import did_you_mean

ALL = "all"
"""The source that stands for every scenario of ``config/scenarios/``."""
KEY_DIGITS = 24
_NOT_IN_KEY = {"description", "tags", "vary"}  # fields without influence on a run

Plan = dict[str, Case]
"""Key -> case, in the order of the sweep."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Scenarios and their sources on the command line."""

    scenarios: tuple[Scenario, ...]
    sources: Mapping[str, str]  # name of a scenario -> its name or file on the command line
    settings: Mapping[str, str]  # of --set

    def command(self, case: Case) -> str:
        """The command that repeats ``case``."""
        settings = [f"{name}={value}" for name, value in self.settings.items()] + case.settings
        options = " ".join(f"--set {shlex.quote(setting)}" for setting in settings)
        source = shlex.quote(self.sources[case.scenario.name])
        return f"trepid sim run {source} --seed {case.seed} {options}".rstrip()


def select(sources: Sequence[str], tags: Sequence[str], overrides: Mapping[str, str]) -> Selection:
    """The scenarios of ``sources`` that have one of ``tags``, where tags are given; checked.

    ``tags`` without sources choose among all scenarios. Raises InputError, also when none is left.
    """
    if not sources and not tags:
        raise InputError(f"no scenario given: name some, or `{ALL}`, or a --tag")

    names: list[str] = []
    for source in sources or [ALL]:
        names += (
            [scenario.name for scenario in with_tags(list_scenarios(), tags)] if source == ALL else [source]
        )
    chosen = [
        (scenario, name) for name in names for scenario in with_tags(load_scenarios(name, overrides), tags)
    ]
    if not chosen:
        raise InputError(no_tagged(tags))
    for scenario, name in chosen:
        if name.endswith(".py"):  # YAML files are checked when they are loaded
            scenario.check()
    return Selection(tuple(s for s, _ in chosen), {s.name: name for s, name in chosen}, overrides)


def with_tags(scenarios: Iterable[Scenario], tags: Sequence[str]) -> list[Scenario]:
    """The ``scenarios`` with one of ``tags``; all of them without tags."""
    return [scenario for scenario in scenarios if not tags or not set(tags).isdisjoint(scenario.tags)]


def no_tagged(tags: Sequence[str]) -> str:
    """The error text for ``tags`` that no scenario has."""
    known = {tag for scenario in list_scenarios() for tag in scenario.tags}
    return f"no scenario has the tag {' or '.join(map(repr, tags))}; {did_you_mean(tags[0], known)}"


def by_seeds(scenarios: Iterable[Scenario], seeds: Sequence[int]) -> Iterator[Case]:
    """Every scenario, unchanged, with every seed."""
    for scenario in scenarios:
        for index, seed in enumerate(seeds):
            yield Case(scenario=scenario, index=index, seed=seed, parameters={})


def by_sampling(
    scenarios: Iterable[Scenario], method: Method, count: int | None, *, seed: int
) -> Iterator[Case]:
    """``count`` cases of each scenario, sampled by ``method`` from its ranges. Raises InputError."""
    for scenario in scenarios:
        yield from cases(scenario, method, count, seed=seed)


def plan(cases: Iterable[Case]) -> Plan:
    """The cases by key. Equal cases are run once."""
    planned: Plan = {}
    for case in cases:
        planned.setdefault(case_key(case), case)
    return planned


def case_key(case: Case) -> str:
    """Hash of the scenario, its road, rule and network files, and the seed; without code and configuration."""
    digest = hashlib.sha256(case.scenario.model_dump_json(exclude=_NOT_IN_KEY).encode())
    digest.update(f"\0{case.seed}\0".encode())
    if case.scenario.road.endswith(".yaml"):
        digest.update(Path(case.scenario.road).read_bytes())
    if case.scenario.rules is not None:
        digest.update(Path(case.scenario.rules).read_bytes())
    for name in sorted(case.scenario.networks):
        digest.update(Path(case.scenario.networks[name]).read_bytes())
    return digest.hexdigest()[:KEY_DIGITS]


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
