"""A search: worker processes that evaluate candidates on one shared storage.

A sampler of Optuna, or of :mod:`sim_harness.tuning.populations`, proposes candidates; by default the
tree-structured Parzen estimator. Each worker requests, checks, evaluates and reports its own candidates, so that
several sessions, also on other machines, can share a study. An invalid candidate is not evaluated. A killed worker
loses one candidate. What a candidate is, and its cost, is said by a :class:`Task`: rules that are driven
(:mod:`sim_harness.tuning.rule_study`), recipes that are trained (:mod:`learning.training.search`).

Watanabe, Tree-structured Parzen estimator: understanding its algorithm components and their roles for better
empirical performance (2023).
"""

import os
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from multiprocessing.context import SpawnProcess
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import optuna
from optuna.samplers import BaseSampler, CmaEsSampler, RandomSampler, TPESampler
from optuna.storages import BaseStorage, JournalStorage, RDBStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, TrialState

from sim_harness.sweep.pool import start
from sim_harness.tuning.populations import (
    BatSampler,
    DifferentialSampler,
    GeneticSampler,
    HarmonyBatSampler,
    PopulationSampler,
    SwarmSampler,
)
from sim_harness.tuning.settings import Span
from trepid.config import InputError, refuse
from trepid.spelling import did_you_mean

POLL_S = 0.2
LOCKED_S = 60.0  # a worker waits this long for a database in use
MOST_INVALID = 50  # candidates in a row before a worker gives up
SCORE, INVALID, SESSION, START = "score", "invalid", "session", "start"  # user attributes of a trial
Tell = Callable[[list[FrozenTrial]], None]
"""Called with all trials so far whenever one has finished."""
POPULATIONS: Mapping[str, Callable[[int], PopulationSampler]] = MappingProxyType(
    {
        "bat": lambda seed: BatSampler(seed=seed),
        "bat-harmony": lambda seed: HarmonyBatSampler(seed=seed),
        "pso": lambda seed: SwarmSampler(seed=seed),
        "de": lambda seed: DifferentialSampler(seed=seed),
        "ga": lambda seed: GeneticSampler(seed=seed),
    }
)
"""Name of a population -> its sampler for a seed."""
SAMPLERS: Mapping[str, Callable[[int], BaseSampler]] = MappingProxyType(
    {
        "tpe": lambda seed: TPESampler(seed=seed, multivariate=True, constant_liar=True),
        "random": lambda seed: RandomSampler(seed=seed),
        "cma-es": lambda seed: CmaEsSampler(seed=seed, warn_independent_sampling=False),
        **POPULATIONS,
    }
)
"""Name of a sampler -> the sampler for a seed."""


class Evaluation(NamedTuple):
    """The cost of a candidate, and what its trial keeps beside it."""

    cost: float
    details: dict[str, Any]


@dataclass(frozen=True, kw_only=True)
class Task:
    """What the workers of a study search; picklable. A subclass states candidates and their cost."""

    parameters: Mapping[str, Span]
    storage: str
    trials: int  # complete ones in the study, of all sessions
    seed: int
    sampler: str  # a name of SAMPLERS

    @property
    def name(self) -> str:
        """Name of the study: of all that decides about the cost of a candidate."""
        raise NotImplementedError

    @property
    def place(self) -> Path | None:
        """Where a worker has its folder of temporary files; None: where the system keeps them."""
        return None

    def start(self) -> dict[str, float]:
        """The values that a new study begins with."""
        raise NotImplementedError

    def evaluate(self, values: dict[str, float], folder: Path) -> Evaluation:
        """The cost of a candidate. Raises Invalid for one that fails a check, EvaluationError and InputError for
        one whose evaluation failed.
        """
        raise NotImplementedError


class EvaluationError(Exception):
    """The evaluation of a candidate failed."""


class Invalid(Exception):
    """A candidate that fails a check."""


def check_sampler(name: str, option: str = "--sampler") -> None:
    """Raise InputError unless ``name``, the value of ``option``, is a sampler."""
    refuse(f"{option} {name}: {did_you_mean(name, SAMPLERS)}", name not in SAMPLERS)


def open_storage(url: str) -> BaseStorage:
    """The storage at ``sqlite:///FILE`` or another database, or in a journal file. Raises InputError."""
    try:
        if "://" in url:
            arguments = {"connect_args": {"timeout": LOCKED_S}} if url.startswith("sqlite") else {}
            return RDBStorage(url, engine_kwargs=arguments)
        return JournalStorage(JournalFileBackend(url))
    except Exception as error:  # each database driver has its own exceptions
        what = str(error).splitlines()[0]
        raise InputError(f"--storage {url}: cannot be used: {what}") from error


def search(task: Task, workers: int, tell: Tell) -> list[FrozenTrial]:
    """Search until the study has its trials; returns them. An interrupt leaves finished trials in the storage."""
    study = _open_study(task)
    session = os.urandom(8).hex()
    processes: list[SpawnProcess] = []
    try:
        processes += (start(_work, task, number, session) for number in range(workers))
        finished = -1
        while any(process.is_alive() for process in processes):
            time.sleep(POLL_S)
            trials = study.get_trials(deepcopy=False)
            count = sum(trial.state.is_finished() for trial in trials)
            if count != finished:
                finished = count
                tell(trials)
    finally:
        for process in processes:
            process.kill()
            process.join()
        _give_up(study, session)
    failed = [process.exitcode for process in processes if process.exitcode not in (0, None)]
    trials = study.get_trials()
    if failed and len(complete(trials)) < task.trials:
        raise InputError(f"the workers ended with exit codes {failed}; see their messages above")
    return trials


def complete(trials: list[FrozenTrial]) -> list[FrozenTrial]:
    """The trials that were evaluated."""
    return [trial for trial in trials if trial.state == TrialState.COMPLETE]


def cost(trial: FrozenTrial) -> float:
    """Cost of a complete trial."""
    assert trial.value is not None
    return float(trial.value)


def _open_study(task: Task) -> optuna.Study:
    """The study in its storage; a new study begins with the values of the task."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.create_study(study_name=task.name, storage=open_storage(task.storage), load_if_exists=True)
    waits_or_done = (TrialState.WAITING, TrialState.RUNNING, TrialState.COMPLETE)
    if not any(START in trial.user_attrs for trial in study.get_trials(states=waits_or_done)):
        study.enqueue_trial(task.start(), user_attrs={START: True})
    return study


def _give_up(study: optuna.Study, session: str) -> None:
    """Mark the unfinished trials of this session as failed."""
    for trial in study.get_trials(deepcopy=False, states=(TrialState.RUNNING,)):
        if trial.user_attrs.get(SESSION) == session:
            study.tell(trial.number, state=TrialState.FAIL)


def _work(task: Task, number: int, session: str) -> None:
    """One worker: evaluate candidates until the study is complete."""
    optuna.logging.set_verbosity(optuna.logging.ERROR)
    study = optuna.load_study(study_name=task.name, storage=open_storage(task.storage))
    begun = len(study.get_trials(deepcopy=False))  # a continued study needs other random numbers
    seed = int(np.random.SeedSequence((task.seed, number, begun)).generate_state(1)[0])
    study.sampler = SAMPLERS[task.sampler](seed)
    invalid = 0
    with TemporaryDirectory(dir=task.place) as folder:
        while invalid < MOST_INVALID and _is_trial_wanted(study, task, session):
            trial = study.ask()
            trial.set_user_attr(SESSION, session)
            invalid = 0 if _evaluate(study, trial, task, Path(folder)) else invalid + 1


def _is_trial_wanted(study: optuna.Study, task: Task, session: str) -> bool:
    trials = study.get_trials(deepcopy=False)
    under_way = [t for t in trials if t.state == TrialState.RUNNING and t.user_attrs.get(SESSION) == session]
    return len(complete(trials)) + len(under_way) < task.trials


def _evaluate(study: optuna.Study, trial: optuna.Trial, task: Task, folder: Path) -> bool:
    """Evaluate one candidate; False when it is invalid."""
    for name, span in task.parameters.items():
        trial.suggest_float(name, span.low, span.high, log=span.log)
    try:
        found = task.evaluate(values_of(trial, task.parameters), folder)
    except (Invalid, EvaluationError, InputError) as error:
        trial.set_user_attr(INVALID, str(error))
        study.tell(trial, state=TrialState.PRUNED if isinstance(error, Invalid) else TrialState.FAIL)
        return False
    trial.set_user_attr(SCORE, found.details)
    study.tell(trial, found.cost)
    return True


def values_of(trial: optuna.Trial | FrozenTrial, parameters: Mapping[str, Span]) -> dict[str, float]:
    """The values that a trial tries, rounded to a readable number of digits."""
    return {name: span.round_value(trial.params[name]) for name, span in parameters.items()}


def is_invalid(trial: Any) -> bool:
    """True for a candidate that failed a check and was not evaluated."""
    return bool(trial.state.name == "PRUNED")


class TrialProgress:
    """Says a line for each finished trial, with the time left."""

    def __init__(self, wanted: int, say: Callable[[str], None]) -> None:
        self._wanted, self._say = wanted, say
        self._began_s = time.monotonic()
        self._had: int | None = None  # trials of earlier sessions

    def report(self, trials: list[Any]) -> None:
        """Say the state of the search."""
        complete = [trial for trial in trials if trial.state.name == "COMPLETE"]
        values = [trial.value for trial in complete]
        start = [trial.value for trial in complete if "start" in trial.user_attrs]
        invalid = sum(map(is_invalid, trials))
        self._had = len(values) if self._had is None else self._had
        new, left = len(values) - self._had, self._wanted - len(values)
        spent_s = time.monotonic() - self._began_s
        eta = f", about {spent_s / new * left:.0f} s left" if new and left > 0 else ""
        best = f", best cost {min(values):.4g}" if values else ""
        best += f" (start {start[0]:.4g})" if start else ""
        self._say(f"{len(values)} of {self._wanted} trials, {invalid} invalid{best}{eta}")
