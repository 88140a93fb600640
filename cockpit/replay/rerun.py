"""Nodes of a recorded drive on its recorded inputs, step by step, compared with what they did in the drive.

Each node gets the messages that it used in the drive, at the times of its steps. Where the node that gave a message
is run again too, it gets the new message. No bus and no clock take part, so that the same code gives the same
outputs, bit for bit. The vehicle does not react: its recorded states are inputs, and a replay says what a node
would have decided, not where the car would have gone.

A recording that begins in the middle of a drive lacks the state of the nodes. Its supervisor would stay in the STOP
in which it starts; :mod:`cockpit.replay.player` assumes a driver for the first WARM_UP_S, whose outputs are not
compared.
"""

import time
from collections.abc import Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from cockpit.replay.ahead import estimate_ahead, estimators_among
from cockpit.replay.difference import Comparison, Difference
from cockpit.replay.nodes import Node, choose_nodes, nodes_of, settings_of
from cockpit.replay.player import Player
from cockpit.replay.tape import Tape
from trepid.clock import seconds
from trepid.config import InputError
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import CAR_FILES, Recording
from trepid.wire import to_cdr

RULES_NAME = "fear.yaml"


def copy_recording(
    source: Path,
    out: Path,
    replaced: Mapping[str, Mapping[float, Any]],
    *,
    notes: Mapping[str, str],
    rules: bytes,
) -> None:
    """Write ``source`` to ``out`` with other messages, the further ``notes`` and the rule file ``rules``.

    ``replaced``: key of a topic -> time of a message on it -> the message in its place; the other messages of
    these topics are left out. Raises InputError.
    """
    held = read_recording(source)
    own = {name: data for name, data in held.files.items() if name.startswith(CAR_FILES)}
    with Recording(out, {RULES_NAME: rules, **own}, {**held.notes, **notes}) as recording:
        for log_ns, key, data in in_order(source):
            at_s = seconds(log_ns)
            if key not in replaced:
                recording.add(key, data, at_s=at_s)
            elif at_s in replaced[key]:
                recording.add(key, to_cdr(replaced[key][at_s]), at_s=at_s)


@dataclass(frozen=True, slots=True)
class Rerun:
    """The result of a replay."""

    topics: Mapping[str, Comparison]  # by key
    doubts: Mapping[
        str, str
    ]  # key -> why its steps may differ from the recorded ones; "" where they are the same
    left_out: Mapping[str, str]  # name of a node -> why it was not run again
    frames: int  # camera frames with an output that was compared
    lost: int  # messages in corrupted parts of the recording
    drive_s: float  # length of the recording
    wall_s: float

    @property
    def differences(self) -> int:
        """Number of outputs that differ."""
        return sum(topic.different for topic in self.topics.values())

    @property
    def first(self) -> Difference | None:
        """The first difference of all."""
        found = [topic.first for topic in self.topics.values() if topic.first is not None]
        return min(found, key=lambda one: one.t_s, default=None)


def rerun(
    path: Path,
    through: Collection[str],
    *,
    rules: Path | None = None,
    networks: Sequence[str] = (),
    out: Path | None = None,
) -> Rerun:
    """Run the nodes named ``through`` ("all": every one) on the recording at ``path``.

    ``rules`` replaces the recorded rules, ``networks`` the driving networks of the same name. ``out``: a new
    recording with the new outputs in place of the recorded ones. Raises InputError.
    """
    cv2.setNumThreads(1)
    started_s = time.perf_counter()
    with ExitStack() as used:
        tape = Tape(path)
        setup = used.enter_context(settings_of(tape, rules, networks))
        picked, left_out = choose_nodes(nodes_of(tape, setup), through, tape, setup.missing)
        if not picked:
            raise InputError(f"{path}: {'; '.join(f'{name}: {why}' for name, why in left_out.items())}")
        estimators = estimators_among(picked)
        ahead = used.enter_context(estimate_ahead(path, estimators, networks))
        player = Player(tape, picked)
        player.run(ahead, estimators)
        if out is not None:
            copy_recording(
                path,
                out,
                player.replaced_messages(),
                notes=_notes(picked, path),
                rules=setup.rules.read_bytes(),
            )
    return Rerun(
        topics=player.compared,
        doubts=player.doubts,
        left_out=left_out,
        frames=len(player.frames_s),
        lost=sum(tape.recorded.lost.values()),
        drive_s=tape.recorded.last_s - tape.recorded.first_s,
        wall_s=time.perf_counter() - started_s,
    )


def _notes(picked: Collection[Node], path: Path) -> dict[str, str]:
    return {"replayed": ",".join(node.name for node in picked), "replay_of": str(path)}
