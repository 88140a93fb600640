"""The plan of a sweep: cases in order, each with a key that depends only on the case."""

import hashlib
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sim_harness.scenarios.sampling import Case, Method, cases
from sim_harness.scenarios.scenario import Scenario, list_scenarios, load_scenarios
from trepid.config import InputError
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
