"""The steps of a recorded node: when each began, which messages it used, and which output it gave.

A live drive records this (:mod:`trepid.processes.journal`). In a lock-step run it follows from the times, because
every step uses what was published up to its instant. A live recording without reports, of an older version, is
treated like a lock-step run; its steps then only resemble the recorded ones.
"""

from bisect import bisect_left
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from cockpit.replay.nodes import Node
from cockpit.replay.tape import Tape
from trepid.topics import CAMERA_IMAGE, DECISION


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
