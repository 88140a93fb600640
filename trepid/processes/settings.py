"""The processes of a drive as settings: ``config/processes.yaml``, overridden by that of the car.

They give the permitted publishers of the topics of a drive too.
"""

import importlib.util
import os
import re
import shutil
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, field
from enum import StrEnum
from importlib.machinery import ModuleSpec
from pathlib import Path
from typing import Annotated, Any, NoReturn, Self

from pydantic import Field, model_validator
from ruamel.yaml.comments import CommentedMap

from trepid.config import (
    CONFIG_DIR,
    InputError,
    Settings,
    car_folder,
    fault_line,
    parse,
    place,
    read,
    wrong_at,
)
from trepid.packages import offers_of
from trepid.plugins import Group, added_entry_points
from trepid.processes.realtime import OPTION, PRIORITIES
from trepid.security import AUTHORITY, OBSERVER
from trepid.spelling import did_you_mean
from trepid.topics import (
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    ROAD_USERS,
    SIM_TRUTH,
    VEHICLE_STATE,
)
from trepid.types import NonNegative

FILE = CONFIG_DIR / "processes.yaml"
RECORDER = "recorder"
"""Name of the process that runs only in drives that are recorded or can be: with ``--record``, a ring of the last
minutes, or driver input."""
LAUNCHER = "launcher"
"""Name under which the launcher itself reports."""
RESERVED = (LAUNCHER, OBSERVER, AUTHORITY)
"""Names that no process may have: their certificates belong to others."""
PROGRAMS = ("module", "command", "entry_point")
ESTIMATE = re.compile(r"perception/([^/]+)/estimate")

Nice = Annotated[int, Field(ge=-20, le=19)]
Cores = tuple[Annotated[int, Field(ge=0)], ...]
Restarts = Annotated[int, Field(ge=0)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z][\w-]*$")]


class Restart(StrEnum):
    """When a process is started again."""

    NEVER = "never"
    ON_FAILURE = "on_failure"  # after an end with an error, by a signal, or for silence


class Loss(StrEnum):
    """The effect of the loss of a process on the drive."""

    STOP = "stop"  # the car stops, and the drive ends
    SLOW = "slow"  # the car slows down until the process is back
    NOTHING = "nothing"  # the loss is reported


class Handling(Settings):
    """How the launcher treats a process."""

    restart: Restart
    max_restarts: Restarts
    backoff_s: NonNegative
    longest_backoff_s: NonNegative
    loss: Loss
    cores: Cores
    nice: Nice


def _own_topics(module: str) -> tuple[str, ...]:
    """Keys of the topics of a program of Trepid, where an entry does not give them."""
    return offers_of(module.split(".", maxsplit=1)[0]).publishes.get(module, ())


class ProcessSettings(Settings):
    """One process: its program, and how it differs from the defaults."""

    module: str | None = (
        None  # `python -m`; a module of Trepid, of a package, or a file in the folder of the car
    )
    command: Annotated[tuple[str, ...], Field(min_length=1)] | None = None  # any program, with arguments
    entry_point: str | None = None  # a name in the group trepid.processes of an installed package
    options: dict[str, Any] = Field(default_factory=dict)
    publishes: tuple[
        str, ...
    ] = ()  # keys of the topics; default: what its package says, or the estimate of the estimator
    heartbeat: bool | None = None  # it reports to the launcher; default: all but commands
    restart: Restart | None = None
    max_restarts: Restarts | None = None
    backoff_s: NonNegative | None = None
    longest_backoff_s: NonNegative | None = None
    loss: Loss | None = None
    cores: Cores | None = None
    nice: Nice | None = None
    together: Name | None = None  # name of a process that it shares with others; default: one of its own

    @model_validator(mode="after")
    def _one_program(self) -> Self:
        given = [name for name in PROGRAMS if getattr(self, name) is not None]
        if len(given) > 1:
            raise wrong_at((given[1],), f"the process already has a {given[0]}; a process has one program")
        return self

    @property
    def topics(self) -> tuple[str, ...]:
        """Keys of the topics that the process publishes."""
        name = self.options.get("estimator")
        own = (f"perception/{name}/estimate",) if name else _own_topics(self.module or "")
        return self.publishes or own

    @property
    def beats(self) -> bool:
        """True when the process sends heartbeats."""
        return self.command is None if self.heartbeat is None else self.heartbeat


@dataclass(frozen=True, slots=True)
class ProcessSpec:
    """One process of a drive, with all defaults filled in and the place of its entry."""

    name: str
    module: str = ""
    options: Mapping[str, Any] = field(default_factory=dict)
    command: tuple[str, ...] = ()
    entry_point: str = ""
    publishes: tuple[str, ...] = ()
    heartbeat: bool = True
    restart: Restart = Restart.ON_FAILURE
    max_restarts: int = 2
    backoff_s: float = 0.5
    longest_backoff_s: float = 8.0
    loss: Loss = Loss.STOP
    cores: tuple[int, ...] = ()
    nice: int = 0
    together: str = ""  # name of the process that it shares with others; "": a process of its own
    place: str = ""  # file:line:column of the entry; "" where there is no file

    @property
    def program(self) -> str:
        """The program in words."""
        return self.module or " ".join(self.command) or self.entry_point

    @property
    def simulates(self) -> bool:
        """True when the process is a part of the simulator and needs a scenario."""
        return offers_of(self.module.split(".")[0]).simulates or "sim/truth" in self.publishes

    @property
    def is_vehicle(self) -> bool:
        """True for the process next to the actuator, which holds the limiter."""
        return VEHICLE_STATE.key in self.publishes

    @property
    def estimators(self) -> tuple[str, ...]:
        """Names of the estimators whose estimates the process publishes."""
        return tuple(found[1] for key in self.publishes if (found := ESTIMATE.fullmatch(key)))

    def backoff_after_s(self, restarts: int) -> float:
        """Time from the end of the process to its restart after ``restarts`` earlier ones: 0, b, 2b, 4b, … [s]."""
        if restarts == 0:
            return 0.0
        doublings = min(restarts, sys.float_info.max_exp) - 1
        return min(self.longest_backoff_s, self.backoff_s * 2.0**doublings)


class ProcessesFile(Settings):
    """``processes.yaml``."""

    defaults: Handling
    processes: dict[Name, ProcessSettings]


def load_processes() -> tuple[ProcessSpec, ...]:
    """The processes of the car in use, in the order of the file.

    Raises InputError with file:line:column for an invalid field, an entry without a program, a program that does
    not exist on this machine, a core that it does not have, and two processes that publish the same topic.
    """
    data = read(FILE)
    _replace_programs(data)
    return tuple(_specs(parse(data, ProcessesFile, source=FILE), data))


def _replace_programs(data: CommentedMap) -> None:
    """Drop what an entry of the car would inherit from an entry with another program.

    Options, topics and the treatment of one program make no sense for another.
    """
    entries = data.get("processes")
    for entry in entries.values() if isinstance(entries, CommentedMap) else ():
        if not _of_car(entry).isdisjoint(PROGRAMS):
            _keep_own(entry)


def _of_car(fields: object) -> Set[str]:
    """The names of the fields that the car gives, whole or as the only ones of a mapping of its own."""
    return getattr(fields, "sources", {}).keys()


def _keep_own(fields: CommentedMap) -> None:
    """Drop the fields that the car does not give, also of the mappings below."""
    for name in [name for name in fields if name not in _of_car(fields)]:
        if _of_car(fields[name]):
            _keep_own(fields[name])
        else:
            del fields[name]


def _specs(file: ProcessesFile, data: CommentedMap) -> Iterator[ProcessSpec]:
    publishers: dict[str, str] = {}
    for name, entry in file.processes.items():
        where = ("processes", name)
        given = [program for program in PROGRAMS if getattr(entry, program) is not None]
        if not given:
            hint = did_you_mean(name, [*(other for other in file.processes if other != name)], "")
            _refuse(where, f"has no program: give module, command or entry_point; {hint}".rstrip("; "), data)
        if name in RESERVED:
            _refuse(
                where, f"is reserved: the certificate {name}.crt is another one's; use another name", data
            )
        problem = missing_program(entry)
        if problem:
            _refuse((*where, given[0]), problem, data)
        priority = entry.options.get(OPTION)
        whole = isinstance(priority, int) and not isinstance(priority, bool)
        if priority is not None and (not whole or priority not in PRIORITIES):
            span = f"{PRIORITIES[0]} to {PRIORITIES[-1]}"
            _refuse(
                (*where, "options", OPTION),
                f"{priority!r} is no priority; it is a whole number from {span}",
                data,
            )
        for number, key in enumerate(entry.topics):
            other = publishers.setdefault(key, name)
            if other != name:
                at = (*where, "publishes", number) if entry.publishes else where
                _refuse(
                    at, f"process {other} publishes {key} too; leave one of them out: {other}: null", data
                )
        handling = {
            field: default if getattr(entry, field) is None else getattr(entry, field)
            for field, default in file.defaults
        }
        missing = sorted(set(handling["cores"]) - os.sched_getaffinity(0))
        if missing:
            have = ", ".join(map(str, sorted(os.sched_getaffinity(0))))
            owner = where if entry.cores is not None else ("defaults",)
            _refuse((*owner, "cores"), f"this machine has no core {missing[0]}; there are {have}", data)
        yield ProcessSpec(
            name=name,
            module=entry.module or "",
            command=entry.command or (),
            entry_point=entry.entry_point or "",
            options=entry.options,
            publishes=entry.topics,
            heartbeat=entry.beats,
            together=entry.together or "",
            place=place(data, (*where, "together") if entry.together else where, FILE),
            **handling,
        )


def _refuse(path: Sequence[str | int], problem: str, data: CommentedMap) -> NoReturn:
    raise InputError(fault_line(path, problem, data, FILE))


def check_vehicle(specs: Iterable[ProcessSpec]) -> None:
    """Raise InputError without a process next to the actuator, which drives the car and stops it at the end."""
    if not any(spec.is_vehicle for spec in specs):
        raise InputError(
            "processes.yaml: no process publishes vehicle/state, so that nothing drives the car;"
            " `vehicle: {module: vehicle.actuators.node}` does; one of your own needs `publishes: [vehicle/state]`"
        )


def estimators_in(specs: Iterable[ProcessSpec]) -> tuple[str, ...]:
    """Names of the estimators of ``specs``. Raises InputError without any."""
    names = tuple(name for spec in specs for name in spec.estimators)
    if not names:
        raise InputError(
            "processes.yaml: no process publishes an estimate of the lane; add one, such as"
            " `cv: {module: perception.node, options: {estimator: cv}}`"
        )
    return names


def missing_program(entry: ProcessSettings) -> str:
    """What is wrong with the program of ``entry`` on this machine; "" when it can be started."""
    if entry.module is not None and (problem := missing_module(entry.module)):
        return problem
    if entry.command is not None and not _command_exists(entry.command[0]):
        return f"no program {entry.command[0]!r}; install it, or give its whole path"
    if entry.entry_point is not None and entry.entry_point not in added_entry_points(Group.PROCESSES):
        hint = did_you_mean(
            entry.entry_point, added_entry_points(Group.PROCESSES).keys(), "no installed package adds one"
        )
        return f"no entry point {entry.entry_point!r} in the group {Group.PROCESSES}; {hint}"
    return ""


def working_folder() -> Path:
    """Folder in which the commands of processes run: that of the car, else the present one."""
    return car_folder() or Path.cwd()


def _command_exists(name: str) -> bool:
    """True for a program on the PATH, and for a path of one, relative to the working folder of commands."""
    return shutil.which(str(working_folder() / name) if os.sep in name else name) is not None


def missing_module(name: str) -> str:
    """Why ``python -m name`` cannot find the module, also in the folder of the car; "" when it can."""
    missing = f"no module {name!r}; install its package, or put the file into the folder of the car"
    try:
        return missing if module_spec(name) is None else ""
    except Exception as error:  # noqa: BLE001 - of the packages above the module, which are imported
        if isinstance(error, ModuleNotFoundError) and f"{name}.".startswith(f"{error.name}."):
            return missing
        return f"the package of {name!r} cannot be imported: {type(error).__name__}: {error}"


def module_spec(name: str) -> ModuleSpec | None:
    """The module that ``python -m name`` finds, also in the folder of the car; None without one.

    The packages above it are imported: raises what they raise.
    """
    car = car_folder()
    before = list(sys.path)
    sys.path += [str(car)] if car else []
    try:
        return importlib.util.find_spec(name)
    finally:
        sys.path[:] = before


def published_keys(specs: Iterable[ProcessSpec]) -> dict[str, tuple[str, ...]]:
    """Keys of the topics that each process may publish, by its name, for the access control of Zenoh.

    These are the topics in ``processes.yaml``, the image statistics of the estimator that judges the image, and the
    vehicle ahead and the road users where the simulated car gives them.
    """
    return {spec.name: (*spec.publishes, *_implied_keys(spec)) for spec in specs}


def _implied_keys(spec: ProcessSpec) -> tuple[str, ...]:
    judges = (IMAGE_STATISTICS.key,) if spec.options.get("statistics") else ()
    sensed = (LEAD_VEHICLE.key, ROAD_USERS.key) if SIM_TRUTH.key in spec.publishes else ()
    return (*judges, *sensed)
