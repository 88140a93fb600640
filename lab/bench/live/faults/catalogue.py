"""The table of faults of ``trepid bench faults``.

A fault becomes *observable* at a moment that depends on its kind (:class:`Onset`). The time from there to the first
braking command that acts on the car is the reaction.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from trepid.topics import (
    CAMERA_IMAGE,
    COMMAND,
    DECISION,
    LEAD_VEHICLE,
    VEHICLE_STATE,
    Topic,
    estimate_topic,
)

SIM, CAN = "sim", "can"
WIRES = (SIM, CAN)
"""The simulated car behind the limiter of one process; the simulated ECU behind limiter, CAN actuator and bus."""
CLOCK_STEP_S = 1.0


class Act(StrEnum):
    """What happens to a process."""

    KILL = "kill"  # SIGKILL
    FREEZE = "freeze"  # SIGSTOP until the car stands
    STARVE = "starve"  # one core for all processes of the frame, shared with busy programs
    FILL = "fill"  # the disk of the recording has no free byte
    SILENT = "silent"  # publishes nothing on the topic
    CORRUPT = "corrupt"  # publishes random bytes and messages that are cut short
    REPLAY = "replay"  # publishes its messages of a second ago, bytes and stamps unchanged
    DISORDER = "disorder"  # publishes every second message before the one that precedes it
    REPEAT = "repeat"  # publishes one image again and again with fresh stamps
    CLOCK = "clock"  # its clock steps by CLOCK_STEP_S, forwards and backwards in turns


class Onset(StrEnum):
    """When a fault becomes observable."""

    INJECTION = "injection"  # at the injection: a killed process is gone
    LATE = "late"  # when the first message that should have come is one period late
    FIRST = "first"  # when the first wrong message is published
    SECOND = "second"  # ... the second one: a camera repeats a single frame now and then


ONSETS = {
    Act.KILL: Onset.INJECTION,
    Act.FREEZE: Onset.LATE,
    Act.STARVE: Onset.LATE,
    Act.FILL: Onset.INJECTION,
    Act.SILENT: Onset.LATE,
    Act.CORRUPT: Onset.FIRST,
    Act.REPLAY: Onset.LATE,
    Act.DISORDER: Onset.FIRST,
    Act.REPEAT: Onset.SECOND,
    Act.CLOCK: Onset.FIRST,
}
OUTSIDE = frozenset({Act.KILL, Act.FREEZE, Act.STARVE, Act.FILL})
"""Acts of the system; all others are of a process on its own messages, see :mod:`.inside`."""

LAUNCHER, RECORDER, FRAME, DISK = "launcher", "recorder", "frame", "disk"
CV = estimate_topic("cv")
OUTPUTS: dict[str, Topic[Any]] = {
    "camera": CAMERA_IMAGE,
    "cv": CV,
    "cnn": estimate_topic("cnn"),
    "lead": LEAD_VEHICLE,
    "supervisor": DECISION,
    "controller": COMMAND,
    "vehicle": VEHICLE_STATE,
}
"""Topic of each process by which its absence is observable."""
STARVED = ("cv", "cnn", "supervisor", "controller")
PERIODS_S = {topic.key: 1 / topic.rate_hz for topic in OUTPUTS.values()}


@dataclass(frozen=True, slots=True)
class Fault:
    """One row of the table."""

    name: str
    act: Act
    process: str
    summary: str
    key: str = ""  # of the topic that makes it observable, and that a fault inside the process falsifies
    stops: bool = True  # the car has to stop or to slow down; else it has to drive on
    wires: tuple[str, ...] = WIRES

    @property
    def onset(self) -> Onset:
        """When it becomes observable."""
        return ONSETS[self.act]

    @property
    def period_s(self) -> float:
        """Time between two messages of the topic [s]; 0 without one."""
        return PERIODS_S.get(self.key, 0.0)

    @property
    def ends_drive(self) -> bool:
        """The launcher ends the drive after it."""
        return self.act is Act.KILL and self.stops


def _of_each(act: Act, summary: str, *names: str, stops: bool = True) -> tuple[Fault, ...]:
    """A fault of each of these processes; the simulated car itself can neither be killed nor frozen."""
    return tuple(
        Fault(
            f"{act}-{name}",
            act,
            name,
            summary,
            OUTPUTS[name].key,
            stops,
            (CAN,) if name == "vehicle" and act in OUTSIDE else WIRES,
        )
        for name in names
    )


MESSAGES = ("camera", "cv", "supervisor", "controller", "vehicle")
FAULTS: dict[str, Fault] = {
    fault.name: fault
    for fault in (
        *_of_each(Act.KILL, "kill -9", *OUTPUTS),
        Fault("kill-launcher", Act.KILL, LAUNCHER, "kill -9; its Zenoh endpoint is gone", wires=(CAN,)),
        Fault("kill-recorder", Act.KILL, RECORDER, "kill -9", stops=False),
        *_of_each(Act.FREEZE, "SIGSTOP until the car stands", *OUTPUTS),
        Fault("freeze-launcher", Act.FREEZE, LAUNCHER, "SIGSTOP; its Zenoh endpoint is silent", stops=False),
        Fault(
            "starve",
            Act.STARVE,
            FRAME,
            "the processes of the frame share one core with 24 busy programs",
        ),
        *_of_each(Act.CLOCK, "its clock steps by ±1 s", "camera", "supervisor", "controller", "vehicle"),
        Fault("unplug-camera", Act.SILENT, "camera", "the camera gives no frame", CAMERA_IMAGE.key),
        Fault("repeat-camera", Act.REPEAT, "camera", "the camera repeats one image", CAMERA_IMAGE.key),
        Fault("silent-actuator", Act.SILENT, "actuator", "the car reports nothing", VEHICLE_STATE.key),
        *_of_each(Act.CORRUPT, "random bytes, messages cut short", *MESSAGES),
        *_of_each(Act.REPLAY, "messages of a second ago", *MESSAGES),
        *_of_each(Act.DISORDER, "every second message comes too late", *MESSAGES, stops=False),
        Fault("disk-full", Act.FILL, DISK, "the recorder finds no free byte", stops=False),
    )
}
