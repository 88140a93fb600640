"""The nodes of a recorded drive, built again: each as a function of its inputs at one step."""

import math
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from types import MappingProxyType
from typing import Any, NamedTuple

import controller.controller
import supervisor.supervisor
from cockpit.logbook.recall import RULES_NAME, recorded_rules, rule_changes
from cockpit.replay.tape import Tape
from supervisor.inputs.watchdog import LEAD, STATE, STATISTICS, USERS
from supervisor.rules.inference import FearRules
from trepid.config import InputError, default_file
from trepid.recording.images import recorded_car
from trepid.recording.notes import CRUISE, ESTIMATORS, hash_of, networks_of, number
from trepid.spelling import did_you_mean
from trepid.topics import (
    CAMERA_IMAGE,
    COMMAND,
    DECISION,
    DIAGNOSTICS,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    LOSSES,
    ROAD_USERS,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)

SUPERVISOR, CONTROLLER, ALL = "supervisor", "controller", "all"
NO_ESTIMATORS = frozenset({STATISTICS, LEAD, USERS, SUPERVISOR, CONTROLLER})
"""Names of the other nodes."""


class Inputs(NamedTuple):
    """What a step uses, by the keys of topics."""

    read: Mapping[str, Any]  # the messages; None: none so far
    now_s: float
    broken: Collection[str] = ()  # inputs whose newest message is malformed, or of a clock that stepped back
    sent_s: Mapping[str, float] = MappingProxyType({})  # publication of the messages, where the node had it


Step = Callable[[Inputs], Any]
"""The output of a node for the inputs of one step."""


@dataclass(frozen=True, slots=True)
class Node:
    """One node of the drive."""

    name: str
    output: Topic[Any]
    inputs: tuple[Topic[Any], ...]
    build: Callable[[], Step]  # a new node
    rank: int  # order of the steps at one instant of a lock-step run
    earlier: frozenset[str] = field(default_factory=frozenset)  # inputs that are of an earlier instant there

    @property
    def sees(self) -> bool:
        """Whether the node steps on camera images."""
        return CAMERA_IMAGE in self.inputs


@dataclass(frozen=True, slots=True)
class Setup:
    """What the supervisor is built with."""

    rules: Path
    changes: Sequence[
        tuple[float, FearRules]
    ]  # rules adopted during the drive, and the time after which they apply
    cruise_speed_mps: float | None
    networks: Mapping[str, Path]  # files of driving networks by name
    missing: Mapping[str, str]  # driving networks that cannot be built, and why


def nodes_of(tape: Tape, setup: Setup) -> dict[str, Node]:
    """Every node that can be run again, by name, in the order of the data flow."""
    names = estimators_of(tape)
    lanes = tuple(estimate_topic(name) for name in names)
    seeing = (CAMERA_IMAGE, VEHICLE_STATE)
    found = [
        Node(name, estimate_topic(name), seeing, partial(_estimator, name, setup.networks.get(name)), 0)
        for name in names
    ]
    found += [
        Node(
            STATISTICS,
            IMAGE_STATISTICS,
            (*seeing, *lanes[:1]),
            partial(_judge, names[:1]),
            0,
            frozenset(topic.key for topic in lanes[:1]),
        ),
        *(
            Node(
                name,
                output,
                (*seeing, *lanes),
                partial(_finder, names, output),
                1,
                frozenset(topic.key for topic in lanes),
            )
            for name, output in ((LEAD, LEAD_VEHICLE), (USERS, ROAD_USERS))
        ),
        Node(
            SUPERVISOR,
            DECISION,
            (*lanes, IMAGE_STATISTICS, LEAD_VEHICLE, ROAD_USERS, VEHICLE_STATE, LOSSES),
            partial(_supervisor, setup, names),
            2,
        ),
        Node(CONTROLLER, COMMAND, (DECISION, VEHICLE_STATE, LOSSES), _controller, 3),
    ]
    return {node.name: node for node in found if tape.recorded.of(node.output)}


def estimators_of(tape: Tape) -> tuple[str, ...]:
    """Names of the estimators of the drive, in its order."""
    noted = tape.notes.get(ESTIMATORS, "")
    recorded = sorted(key.split("/")[1] for key in tape.recorded.messages if key.endswith("/estimate"))
    return tuple(noted.split(",")) if noted else tuple(recorded)


def choose_nodes(
    nodes: Mapping[str, Node], through: Collection[str], tape: Tape, missing: Mapping[str, str]
) -> tuple[list[Node], dict[str, str]]:
    """The nodes to run again, and the others of ``all`` with the reason.

    ``missing``: nodes that cannot be built, and why. Raises InputError for those and for unknown names.
    """
    for name in through:
        if name in missing:
            raise InputError(f"--through {name}: {missing[name]}")
        if name not in nodes and name != ALL:
            raise InputError(f"--through {name}: {did_you_mean(name, [*nodes, ALL])}")
    left_out = dict(missing) if ALL in through else {}
    if ALL in through and not tape.has_raw_images:
        why = "the recording holds no raw images: record with --raw-images"
        left_out |= {name: why for name, node in nodes.items() if node.sees and name not in through}
    picked = [n for name, n in nodes.items() if name in through or (ALL in through and name not in left_out)]
    return picked, left_out


@contextmanager
def settings_of(tape: Tape, rules: Path | None, networks: Sequence[str] = ()) -> Iterator[Setup]:
    """Use the settings of the drive: those of its car, unless another car is in use already.

    ``rules`` replaces the recorded rules; ``networks`` are files in place of driving networks of the same name.
    Raises InputError.
    """
    files, missing = _networks(tape, networks)
    with recorded_car(tape.recorded), TemporaryDirectory() as folder:
        cruise_mps, recorded = number(tape.notes, CRUISE), recorded_rules(tape.recorded)
        if rules is not None or recorded is None:
            yield Setup(rules or default_file(RULES_NAME), (), cruise_mps, files, missing)
        else:
            file = Path(folder) / RULES_NAME
            file.write_bytes(recorded[1])
            beats = (beat for _, beat in tape.recorded.of(DIAGNOSTICS))
            changes = tuple(rule_changes(beats, tape.path))
            yield Setup(file, changes, cruise_mps, files, missing)


def _networks(tape: Tape, given: Sequence[str]) -> tuple[dict[str, Path], dict[str, str]]:
    """The file of each driving network of the drive, and why there is none for the others."""
    from perception.estimators import NETWORK_SUFFIX, name_of

    noted = networks_of(tape.notes)
    files = {name_of(file): Path(file).resolve() for file in given}
    for name, file in files.items():
        if file.suffix != NETWORK_SUFFIX or name not in noted:
            known = did_you_mean(name, noted) if noted else "it has none"
            raise InputError(f"--estimator {file}: no driving network {name!r} in the recording; {known}")
    missing = {}
    for name, (file, sha256) in noted.items():
        if name in files:
            continue
        if file.is_file() and hash_of(file) == sha256:
            files[name] = file
        else:
            state = "has changed since" if file.is_file() else "is not there any more"
            missing[name] = (
                f"the driving network {file} {state}; give a file: --estimator {name}{NETWORK_SUFFIX}"
            )
    return files, missing


def _supervisor(setup: Setup, names: tuple[str, ...]) -> Step:
    node = supervisor.supervisor.build(rules=setup.rules, cruise_speed_mps=setup.cruise_speed_mps)
    changes = list(setup.changes)
    called = {estimate_topic(name).key: name for name in names}
    called |= {IMAGE_STATISTICS.key: STATISTICS, LEAD_VEHICLE.key: LEAD}
    called |= {ROAD_USERS.key: USERS, VEHICLE_STATE.key: STATE}

    def step(inputs: Inputs) -> Any:
        read, now_s, broken, sent_s = inputs
        while changes and changes[0][0] < now_s:
            node.adopt(changes.pop(0)[1])
        return node.step(
            {name: read[estimate_topic(name).key] for name in names},
            read[IMAGE_STATISTICS.key],
            read[LEAD_VEHICLE.key],
            read[VEHICLE_STATE.key],
            now_s=now_s,
            malformed=[called[key] for key in broken if key in called],  # as in a drive, not those of losses
            losses=read[LOSSES.key],
            lead_sent_s=sent_s.get(LEAD_VEHICLE.key, math.nan),
            road_users=read[ROAD_USERS.key],
        )

    return step


def _controller() -> Step:
    node = controller.controller.build()
    return lambda inputs: node.step(
        inputs.read[DECISION.key],
        inputs.read[VEHICLE_STATE.key],
        now_s=inputs.now_s,
        malformed=not {DECISION.key, VEHICLE_STATE.key}.isdisjoint(inputs.broken),
        losses=inputs.read[LOSSES.key],
    )


def _estimator(name: str, network: Path | None) -> Step:
    from perception.estimators import build

    node = build(name, network=None if network is None else str(network))
    return lambda inputs: node.step(
        inputs.read[CAMERA_IMAGE.key], inputs.read[VEHICLE_STATE.key], now_s=inputs.now_s
    )


def _judge(names: tuple[str, ...]) -> Step:
    """``names``: of the estimator whose process judges the image; empty where no estimator was recorded."""
    from perception.sight.judge import build

    node = build()
    keys = [estimate_topic(name).key for name in names]

    def step(inputs: Inputs) -> Any:
        lane = next((inputs.read[key] for key in keys), None)
        frame, state = inputs.read[CAMERA_IMAGE.key], inputs.read[VEHICLE_STATE.key]
        return node.step(frame, lane, state, now_s=inputs.now_s)

    return step


def _finder(names: tuple[str, ...], output: Topic[Any]) -> Step:
    """The finder of vehicles and people, with the one ``output`` of its two."""
    from perception.lead.finder import build

    node = build()
    lanes = [estimate_topic(name).key for name in names]

    def step(inputs: Inputs) -> Any:
        read = inputs.read
        seen = [read[key] for key in lanes]
        lead = node.step(read[CAMERA_IMAGE.key], read[VEHICLE_STATE.key], seen, now_s=inputs.now_s)
        return lead if output is LEAD_VEHICLE else node.road_users

    return step
