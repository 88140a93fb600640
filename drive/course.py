"""What a car drives and how the drive is judged: the road before a real car, or a scenario of the simulator.

The launcher asks a course for all in which the two differ. That of a real car is
:class:`~drive.open_road.OpenRoad`; that of a scenario belongs to the simulator, which a drive of a real car does
not load.
"""

from collections.abc import Collection, Mapping, Sequence, Set
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol

from trepid.messages import SimTruth, VehicleState
from trepid.processes.settings import ProcessSpec

if TYPE_CHECKING:
    from drive.log import DriveLog


PASSED, FAILED, NOT_DRIVEN = "passed", "failed", "not driven"


def why_not_driven(waits_for: str) -> str:
    """The reason of NOT_DRIVEN. ``waits_for``: what the car waits for at the end; "" for nothing."""
    return f"the car did not drive: {waits_for or 'nothing that Trepid knows kept it from driving'}"


class Findings(NamedTuple):
    """What the processes of a drive say before their start, when all their settings are valid."""

    misfits: Mapping[str, str]  # estimator -> why it gives no estimates on this car
    remark: str  # what the car does not see, for the result; "" for nothing


class Verdict(NamedTuple):
    """The judgement of a drive."""

    reasons: list[str]  # of its failure; empty: passed
    scores: dict[str, Any]  # fields of the row of ``drive --json``; empty: nothing was driven
    driven: bool = False  # the car drove, or was not to drive
    notes: tuple[str, ...] = ()  # where a person took over

    @property
    def status(self) -> str:
        """The judgement in words. A car that was to drive and stood proves nothing, and has not passed."""
        return FAILED if self.reasons else PASSED if self.driven else NOT_DRIVEN


class Judge(Protocol):
    """Judges one drive by the messages that the launcher receives."""

    def add(self, message: SimTruth | VehicleState, log: "DriveLog") -> None:
        """Note ``message``, the newest of ``log``."""
        ...

    def verdict(self, problems: Sequence[str], *, elapsed_s: float) -> Verdict:
        """The judgement of a drive of ``elapsed_s`` [s]. Each of ``problems``, such as a loss, fails it."""
        ...


class Course(Protocol):
    """What a car drives, and how the drive is judged."""

    @property
    def name(self) -> str:
        """The course, or the car that drives it, in words."""
        ...

    @property
    def scenario(self) -> str | None:
        """Name of the scenario; None for a real car."""
        ...

    @property
    def duration_s(self) -> float | None:
        """The drive ends after this time [s]; None: at a signal."""
        ...

    @property
    def stops_at_end(self) -> bool:
        """True for a car that is brought to a standstill before the processes end."""
        ...

    @property
    def endings(self) -> Collection[str]:
        """Signals, in the words of the launcher, that do not fail the drive which they end."""
        ...

    def processes(self, specs: tuple[ProcessSpec, ...]) -> tuple[ProcessSpec, ...]:
        """The processes of the car, ``specs``, with those that the course adds, changes and leaves out."""
        ...

    def estimators(self, specs: Sequence[ProcessSpec]) -> tuple[str, ...]:
        """Names of the estimators among ``specs``. Raises InputError without any."""
        ...

    def check(self, specs: Sequence[ProcessSpec]) -> Findings:
        """Load every file of settings, rules and weights that ``specs`` read. Raises InputError with its place."""
        ...

    def options(self) -> Mapping[str, Any]:
        """The options ``scenario``, ``cruise_speed_mps`` and ``rules`` of every process."""
        ...

    def has_begun(self, truth: SimTruth | None) -> bool:
        """True from the start of the drive on, which may follow a run-up. ``truth``: the newest one."""
        ...

    def lost(self, elapsed_s: float) -> Set[str]:
        """Names of the processes that are lost on purpose ``elapsed_s`` after the start."""
        ...

    def judge(self) -> Judge:
        """A judge of a drive that begins now."""
        ...
