"""Steps of the nodes of a recorded drive, in their order, each with the messages that it used in the drive.

A :class:`Schedule` says of one node when each step began, which messages it used, and which output it gave. A live
drive records this (:mod:`trepid.processes.journal`). In a lock-step run it follows from the times, because every
step uses what was published up to its instant. A live recording without reports, of an older version, is treated
like a lock-step run; its steps then only resemble the recorded ones.
"""

import heapq
from bisect import bisect_left
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from cockpit.replay.difference import Comparison
from cockpit.replay.nodes import SUPERVISOR, Inputs, Node
from cockpit.replay.nodes import Step as Call
from cockpit.replay.tape import Frames, Tape
from trepid.messages import Mode, SteeringEstimate, VehicleState
from trepid.topics import CAMERA_IMAGE, DECISION, VEHICLE_STATE


@dataclass(frozen=True, slots=True)
class Step:
    """One step of a node."""

    began_s: float  # time of the nodes
    reads: dict[str, int | None]  # key of each input but the image -> place of the message; None: none so far
    output: int | None  # place of its output; None: not recorded
    broken: tuple[str, ...] = ()  # keys of inputs whose newest message was broken
    sent_s: dict[str, float] = field(default_factory=dict)  # publication of the messages, by its report
    starts: bool = False  # the first one of a new node


@dataclass(frozen=True, slots=True)
class Schedule:
    """The steps of one node in order."""

    steps: Sequence[Step]
    doubt: str  # why they may differ from the recorded ones; "" where they are the same

    @property
    def whole(self) -> bool:
        """Whether the recording begins with the first step of the node."""
        return bool(self.steps) and self.steps[0].starts


def schedule(node: Node, tape: Tape) -> Schedule:
    """The steps of ``node``."""
    if tape.reports(node.output.key):
        return _schedule_by_reports(node, tape)
    doubt = "" if tape.is_lockstep else "the recording does not state the inputs of the steps"
    return Schedule(list(_by_times(node, tape)), doubt)


def _schedule_by_reports(node: Node, tape: Tape) -> Schedule:
    """The steps by the reports of a live drive."""
    outputs = tape.track(node.output.key).published_s
    begun = [s for report in tape.reports(node.output.key) for s in report.began_s]
    steps: list[Step] = []
    missing, expected, gaps = 0, None, 0
    for report in tape.reports(node.output.key):
        gaps += report.first not in (0, expected) and expected is not None
        expected = report.first + len(report.began_s)
        broken = set(report.broken)
        for row, began_s in enumerate(report.began_s):
            reads: dict[str, int | None] = {}
            sent_s: dict[str, float] = {}
            first = row * len(report.inputs)
            for place, key in enumerate(report.inputs, first):
                read_s = report.read_s[place]
                if key == CAMERA_IMAGE.key:
                    continue
                reads[key] = None if read_s is None else tape.track(key).index_published_at(read_s)
                if read_s is None:
                    continue
                sent_s[key] = read_s
                if reads[key] is None:
                    missing += 1
                    reads[key] = tape.track(key).newest(read_s)
            own = (topic.key for topic in node.inputs if topic.key not in report.inputs)
            for key in own:  # of the process itself, which no report names: its output of the turn before
                if key in node.earlier:
                    reads[key] = tape.track(key).newest(began_s, before=True)
            after = len(steps) + 1
            until_s = begun[after] if after < len(begun) else float("inf")
            found = bisect_left(outputs, began_s)
            output = found if found < len(outputs) and outputs[found] < until_s else None
            torn = tuple(key for place, key in enumerate(report.inputs, first) if place in broken)
            steps.append(Step(began_s, reads, output, torn, sent_s, starts=report.first == 0 and row == 0))
    doubts = [
        f"{missing} of its inputs were not recorded" if missing else "",
        f"{gaps} of its reports were not recorded" if gaps else "",
        "" if steps and steps[0].starts else "the recording begins after its first step",
    ]
    return Schedule(steps, "; ".join(filter(None, doubts)))


def _by_times(node: Node, tape: Tape) -> Iterator[Step]:
    """One step for each output, with the newest inputs up to it."""
    track = tape.track(node.output.key)
    for place, message in enumerate(track.messages):
        began_s = track.published_s[place]
        if node.output is DECISION:
            began_s = message.decided_s
        elif node.sees and tape.is_lockstep:
            began_s = message.t_s  # the image is processed at its capture, unless a fault makes it late
        reads = {
            topic.key: tape.track(topic.key).newest(began_s, before=topic.key in node.earlier)
            for topic in node.inputs
            if topic is not CAMERA_IMAGE
        }
        yield Step(began_s, reads, place, starts=place == 0)


WARM_UP_S = 2.2  # the supervisor asks for 2 s of healthy inputs (reengage_after_s)


class Player:
    """Runs nodes in the order of their steps."""

    def __init__(self, tape: Tape, nodes: Collection[Node]) -> None:
        self._tape, self._nodes = tape, nodes
        self._schedules = {node.name: schedule(node, tape) for node in nodes}
        self._frames = Frames(tape)
        self._call_of: dict[str, Call] = {}  # name of a node -> its step, once it is built
        self._new: dict[str, dict[int, Any]] = {node.output.key: {} for node in nodes}
        self.compared = {node.output.key: Comparison(node.output.key) for node in nodes}
        self.doubts = {node.output.key: self._doubt(node) for node in nodes}
        self.frames_s: set[float] = set()
        self._warm_s = self._warm_until_s()

    def run(self, ahead: Iterator[Any], names: Collection[str]) -> None:
        """Run every step of every node, and compare; the outputs of the nodes ``names`` are those of ``ahead``."""
        for node, step in self._in_order():
            now = next(ahead) if node.name in names else self._output(node, step)
            if now is not None:
                self._keep(node, step, now)

    def outputs_of(self, names: Collection[str]) -> Iterator[Any]:
        """The output of each step of the nodes ``names``, whose inputs are all recorded; None: no image."""
        for node, step in self._in_order():
            if node.name in names:
                yield self._output(node, step)

    def replaced_messages(self) -> dict[str, dict[float, Any]]:
        """Key of a topic -> recorded time of each message that is replaced -> the new one, as it is recorded."""
        recorded, track = self._tape.times.in_recorded_time, self._tape.track
        return {
            key: {track(key).recorded_s[place]: recorded(one) for place, one in new.items()}
            for key, new in self._new.items()
        }

    def _doubt(self, node: Node) -> str:
        doubts = [self._schedules[node.name].doubt]
        if self._tape.recorded.lost:
            doubts.append(f"{sum(self._tape.recorded.lost.values())} messages are lost in corrupted parts")
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

    def _output(self, node: Node, step: Step) -> Any:
        """The output of a step; None where its image was not recorded."""
        if step.starts or node.name not in self._call_of:
            self._call_of[node.name] = node.build()
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
        return self._call_of[node.name](Inputs(read, step.began_s, step.broken, step.sent_s))

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
        at_s = self._tape.times.recorded_time_s(step.began_s) - self._tape.zero_s
        self.compared[node.output.key].add(at_s, recorded, self._tape.times.in_recorded_time(now))
        if recorded.t_s is not None:
            self.frames_s.add(recorded.t_s)

    def _message(self, key: str, place: int | None) -> Any:
        """The message at ``place`` of a topic, the new one where its node runs again too."""
        if place is None:
            return None
        return self._new.get(key, {}).get(place, self._tape.track(key).messages[place])
