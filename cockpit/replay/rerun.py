"""Nodes of a recorded drive on its recorded inputs, step by step, compared with what they did in the drive.

Each node gets the messages that it used in the drive, at the times of its steps. Where the node that gave a message
is run again too, it gets the new message. No bus and no clock take part, so that the same code gives the same
outputs, bit for bit. The vehicle does not react: its recorded states are inputs, and a replay says what a node
would have decided, not where the car would have gone.

A recording that begins in the middle of a drive lacks the state of the nodes. Its supervisor would stay in the STOP
in which it starts; a driver is assumed for the first WARM_UP_S, whose outputs are not compared.
"""

import heapq
import time
from collections import deque
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2

from cockpit.replay.difference import Comparison, Difference
from cockpit.replay.nodes import SUPERVISOR, Node, chosen, nodes_of, settings_of
from cockpit.replay.schedule import Schedule, Step, schedule
from cockpit.replay.tape import Frames, Tape
from trepid.config import InputError
from trepid.messages import Mode, SteeringEstimate, VehicleState
from trepid.recording.copy import copied
from trepid.topics import CAMERA_IMAGE, DECISION, VEHICLE_STATE

AHEAD = 60  # steps of all nodes by which those with recorded inputs run ahead; fewer than KEPT_FRAMES images
WARM_UP_S = 2.2  # the supervisor asks for 2 s of healthy inputs (reengage_after_s)


@dataclass(frozen=True, slots=True)
class Rerun:
    """The result of a replay."""

    topics: Mapping[str, Comparison]  # by key
    doubts: Mapping[
        str, str
    ]  # key -> why its steps may differ from the recorded ones; "" where they are the same
    left_out: Mapping[str, str]  # name of a node -> why it was not run again
    frames: int  # camera frames with an output that was compared
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
    tape = Tape(path)
    with settings_of(tape, rules, networks) as setup:
        picked, left_out = chosen(nodes_of(tape, setup), through, tape, setup.missing)
        if not picked:
            raise InputError(f"{path}: {'; '.join(f'{name}: {why}' for name, why in left_out.items())}")
        player = Player(tape, picked)
        player.run()
        if out is not None:
            copied(path, out, player.outputs(), notes=_notes(picked, path), rules=setup.rules.read_bytes())
    return Rerun(
        topics=player.compared,
        doubts=player.doubts,
        left_out=left_out,
        frames=len(player.frames_s),
        drive_s=tape.recorded.last_s - tape.recorded.first_s,
        wall_s=time.perf_counter() - started_s,
    )


def _notes(picked: Collection[Node], path: Path) -> dict[str, str]:
    return {"replayed": ",".join(node.name for node in picked), "replay_of": str(path)}


class Player:
    """Runs nodes in the order of their steps."""

    def __init__(self, tape: Tape, nodes: Collection[Node]) -> None:
        self._tape, self._nodes = tape, nodes
        self._schedules = {node.name: schedule(node, tape) for node in nodes}
        self._frames = Frames(tape)
        self._step_of: dict[str, Any] = {}  # name of a node -> its step, once it is built
        self._new: dict[str, dict[int, Any]] = {node.output.key: {} for node in nodes}
        self.compared = {node.output.key: Comparison(node.output.key) for node in nodes}
        self.doubts = {node.output.key: self._doubt(node) for node in nodes}
        self.frames_s: set[float] = set()
        self._warm_s = self._warm_until_s()

    def run(self) -> None:
        """Run every step of every node.

        A node with recorded inputs only, such as an estimator, runs ahead in a thread of its own; its outputs are
        used and compared in their turn. Its steps are the same, one after the other.
        """
        with ExitStack() as threads:
            ahead = {
                node.name: threads.enter_context(ThreadPoolExecutor(1))
                for node in self._nodes
                if node.sees and not any(topic.key in self._new for topic in node.inputs)
            }
            waiting: deque[tuple[Node, Step, Future[Any] | None]] = deque()
            for node, step in self._in_order():
                begun = None
                if node.name in ahead and (call := self._call(node, step)) is not None:
                    begun = ahead[node.name].submit(call)
                waiting.append((node, step, begun))
                if len(waiting) > AHEAD:
                    self._finish(*waiting.popleft(), runs_ahead=ahead)
            while waiting:
                self._finish(*waiting.popleft(), runs_ahead=ahead)

    def _finish(
        self, node: Node, step: Step, begun: "Future[Any] | None", *, runs_ahead: Collection[str]
    ) -> None:
        """Take the output of a step that runs ahead, or run the step now."""
        if begun is not None:
            self._keep(node, step, begun.result())
        elif node.name not in runs_ahead and (call := self._call(node, step)) is not None:
            self._keep(node, step, call())

    def outputs(self) -> dict[str, dict[float, Any]]:
        """Key of a topic -> recorded time of each message that is replaced -> the new one, as it is recorded."""
        recorded, track = self._tape.times.recorded, self._tape.track
        return {
            key: {track(key).recorded_s[place]: recorded(one) for place, one in new.items()}
            for key, new in self._new.items()
        }

    def _doubt(self, node: Node) -> str:
        doubts = [self._schedules[node.name].doubt]
        if node.sees and not self._tape.has_raw_images:
            doubts.append("its images are JPEG, not those of the drive")
        return "; ".join(filter(None, doubts))

    def _warm_until_s(self) -> float:
        """End of the time in which a driver is assumed; -inf where the recording begins with the drive."""
        found: Schedule | None = self._schedules.get(SUPERVISOR)
        decisions = self._tape.recorded.of(DECISION)
        if found is None or not found.steps or not decisions or decisions[0][1].mode is Mode.STOP:
            return float("-inf")
        return found.steps[0].began_s + WARM_UP_S

    def _in_order(self) -> Iterator[tuple[Node, Step]]:
        """The steps of all nodes by time; of one instant in the order of the data flow."""
        rows = [
            ((step.began_s, node.rank, number, node.name), (node, step))
            for node in self._nodes
            for number, step in enumerate(self._schedules[node.name].steps)
        ]
        heapq.heapify(rows)
        while rows:
            yield heapq.heappop(rows)[1]

    def _call(self, node: Node, step: Step) -> Callable[[], Any] | None:
        """The step with its inputs; None where its image was not recorded."""
        if step.starts or node.name not in self._step_of:
            self._step_of[node.name] = node.build()
        read = {key: self._message(key, place) for key, place in step.reads.items()}
        read |= {topic.key: None for topic in node.inputs if topic.key not in read}
        if node.sees:
            if step.output is None:
                return None
            was = self._tape.track(node.output.key).messages[step.output]
            frame = self._frames.of(was.t_s, by_s=step.began_s + 1.0)
            if frame is None:
                return None
            read[CAMERA_IMAGE.key] = frame
        state = read.get(VEHICLE_STATE.key)
        if step.began_s < self._warm_s and isinstance(state, VehicleState):
            read[VEHICLE_STATE.key] = replace(state, driver_override=True)
        return partial(self._step_of[node.name], read, step.began_s, step.broken)

    def _keep(self, node: Node, step: Step, now: Any) -> None:
        """Keep the output of a step and compare it with the recorded one."""
        if step.output is None:
            return
        track = self._tape.track(node.output.key)
        was = track.messages[step.output]
        if isinstance(now, SteeringEstimate) and isinstance(was, SteeringEstimate):
            now = replace(now, latency_ms=was.latency_ms)
        self._new[node.output.key][step.output] = now
        if step.began_s < self._warm_s:
            return
        recorded = track.recorded[step.output]
        at_s = self._tape.times.recorded_s(step.began_s) - self._tape.zero_s
        self.compared[node.output.key].add(at_s, recorded, self._tape.times.recorded(now))
        if recorded.t_s is not None:
            self.frames_s.add(recorded.t_s)

    def _message(self, key: str, place: int | None) -> Any:
        """The message at ``place`` of a topic, the new one where its node runs again too."""
        if place is None:
            return None
        return self._new.get(key, {}).get(place, self._tape.track(key).messages[place])
