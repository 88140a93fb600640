"""The launcher's monitor of one drive: its beginning, the losses of processes, its end, and its evaluation."""

from collections.abc import Callable, Sequence, Set
from typing import Any

from drive.course import Course
from drive.evaluation import closing_words, evaluate
from drive.log import DriveLog
from drive.losses import LossReport, Silence
from drive.overview import Overview
from trepid.bus import Bus
from trepid.car.vehicle import Vehicle
from trepid.clock import Clock
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Health
from trepid.processes.drive_settings import DriveSettings
from trepid.processes.launch import Fleet, UnexpectedExit
from trepid.processes.settings import LAUNCHER, Loss, Restart

Show = Callable[[DriveLog, Fleet, float], None]
"""Displays the drive so far: log, processes, elapsed time [s]."""
LISTEN_S = 0.02


def missing_processes(log: DriveLog, fleet: Fleet) -> list[str]:
    """The processes whose loss matters and which have not reported yet."""
    specs = {name: child.spec for name, child in fleet.children.items()}
    matters = [name for name, spec in specs.items() if spec.heartbeat and spec.loss is not Loss.NOTHING]
    return [name for name in matters if name not in log.diagnostics]


def why_over(course: Course, log: DriveLog, elapsed_s: float, signals: Sequence[str]) -> str:
    """Why a drive is over after ``elapsed_s`` [s] and the ``signals``; "" while it is not."""
    if signals:
        return signals[0]
    if course.duration_s is not None and elapsed_s >= course.duration_s:
        return f"its {course.duration_s:g} s are over"
    return "the end of the route is reached" if log.truth is not None and log.truth.finished else ""


class Monitor:
    """Monitors one drive and evaluates it."""

    def __init__(
        self,
        bus: Bus,
        clock: Clock,
        fleet: Fleet,
        course: Course,
        estimators: tuple[str, ...],
        settings: DriveSettings,
        show: Show,
    ) -> None:
        self._clock = clock
        self._fleet = fleet
        self._course = course
        self._settings = settings
        self._standstill_mps = load(CONFIG_DIR / "vehicle.yaml", Vehicle).standstill_mps
        self._show = show
        self._log = DriveLog(bus, clock, estimators, course.judge)
        self._losses = LossReport(bus, clock, fleet)
        self._overview = Overview(bus, self._log, fleet)
        self._silence = Silence(
            clock, fleet, longest_s=settings.silence_s, longest_start_s=settings.ready_timeout_s
        )
        self._problems: list[str] = []
        self._notes: list[str] = []  # losses that do not end the drive
        self._released = False  # the car may drive
        self._began_s = clock()
        self._shown_s = self._began_s
        self._lost_s: float | None = None  # time of the first loss of a process
        self._end = ""  # why the drive ends
        self._ended_s: float | None = None  # from when on the car stops because the drive ends
        self._paused: Set[str] = frozenset()  # processes that are lost on purpose

    def wait_until_ready(self, signals: list[str]) -> bool:
        """Wait for a heartbeat of every process whose loss matters, a first decision, and the end of any run-up.

        Until all report, the supervisor keeps a standing car from driving and the simulated world stands, so that
        the drive is judged from its first motion. False on a signal. Raises InputError when a process refuses its
        input, ends, or does not report in time; a real car stands before either.
        """
        ready = False
        try:
            ready = self._becomes_ready(signals)
        finally:
            if not ready and self._course.stops_at_end:
                self._stop_before_start(signals)
        return ready

    def _becomes_ready(self, signals: list[str]) -> bool:
        while not signals:
            for exited in self._fleet.collect_exits():
                raise InputError(self._start_fault(exited))
            missing = missing_processes(self._log, self._fleet)
            if not (missing or self._released or self._log.decision is None):
                self._release()
            if self._released and self._course.has_begun(self._log.truth):
                self._begin()
                return True
            if not self._released:
                self._losses.wait_for(missing or [LAUNCHER])
            first = "the first decision" if self._log.decision is None else "the start of the scenario"
            self._log.waiting = f"waiting for {', '.join(missing) or first}"
            self._receive(self._log.waiting)
            if self._elapsed_time_s() > self._settings.ready_timeout_s:
                raise InputError(self._not_ready(missing))
        self._problems += signals
        self._end = signals[0]
        return False

    def _stop_before_start(self, signals: list[str]) -> None:
        """Wait for the standstill of a car that is to stop, at most for its time limit or until a second signal."""
        self._log.waiting = ""
        self._losses.request_stop()
        asked_s = self._clock()
        while len(signals) < 2 and not self._stands():
            self._receive("; ".join(self._problems))
            for exited in self._fleet.collect_exits():
                self._losses.lose(exited.name)
            if self._fails_to_stop(self._clock() - asked_s, "the end"):
                return

    def watch(self, signals: list[str]) -> None:
        """Monitor until the end of the course or the duration, standstill after a loss, or a signal."""
        while not self._is_finished(signals):
            self._receive("; ".join([*self._problems, *self._notes]))
            self._simulate_losses()
            self._end_silent_processes()
            ends = [self._lose(exited) for exited in self._fleet.collect_exits()]
            self._losses.publish(self._log.diagnostics)
            if any(ends):
                return  # it contains the simulated car
        self._overview.stopping()
        self._problems += [text for text in signals if text not in self._course.endings]

    def _release(self) -> None:
        """Let the car drive, and the simulated world move."""
        self._released = True
        self._losses.wait_for(())
        self._log.restart()

    def _begin(self) -> None:
        self._log.waiting = ""
        self._losses.begin()
        self._began_s = self._clock()
        self._overview.begin(self._began_s)

    def _is_finished(self, signals: list[str]) -> bool:
        """True at the end of the drive. A real car is stopped before; a second signal ends at once."""
        self._end = self._end or why_over(self._course, self._log, self._elapsed_time_s(), signals)
        if self._end and self._course.stops_at_end and len(signals) < 2 and not self._stands():
            if self._ended_s is None:
                self._ended_s = self._clock()
                self._losses.request_stop()
            return self._fails_to_stop(self._clock() - self._ended_s, "the end")
        return bool(self._end) or self._has_stopped_after_loss()

    def _stands(self) -> bool:
        """True when the car reports standstill, or reports no speed at all."""
        state = self._log.state
        return state is None or state.speed_mps is None or abs(state.speed_mps) < self._standstill_mps

    def _lose(self, exited: UnexpectedExit) -> bool:
        """Note an unexpected end and its effect; True when the drive cannot go on."""
        said = f"{exited} at {self._elapsed_time_s():.1f} s"
        self._log.diagnostics.pop(exited.name, None)
        self._overview.keep_end(exited.name, str(exited))
        if self._losses.lose(exited.name) is not Loss.STOP:
            self._notes.append(said)
            return False
        self._problems.append(said)
        self._lost_s = self._elapsed_time_s() if self._lost_s is None else self._lost_s
        spec = self._fleet.children[exited.name].spec
        return spec.simulates and spec.restart is Restart.NEVER

    def _start_fault(self, exited: UnexpectedExit) -> str:
        spec = self._fleet.children[exited.name].spec
        where = f"{spec.place}: " if spec.place and not exited.from_bad_input else ""
        return f"{where}{exited}"

    def _not_ready(self, missing: list[str]) -> str:
        waited = f"after {self._settings.ready_timeout_s:.0f} s"
        if not missing:
            return f"no decision {waited}: read the warnings of the supervisor above"
        spec = self._fleet.children[missing[0]].spec
        where = f"{spec.place}: " if spec.place else ""
        words = self._fleet.children[missing[0]].stderr_tail()
        remedy = "a program that never reports needs heartbeat: false; ready_timeout_s is in drive.yaml"
        said = f" (its last output: {words})" if words else ""
        return f"{where}no heartbeat of {', '.join(missing)} {waited}{said}; {remedy}"

    def row(self, seed: int, *, remark: str = "") -> dict[str, Any]:
        """The result as a row of ``drive --json``, also reported to the page. ``remark``: on the car, or ""."""
        row = evaluate(
            self._log,
            self._fleet,
            self._course,
            seed=seed,
            elapsed_s=self._elapsed_time_s(),
            problems=self._problems,
            notes=[*self._notes, *filter(None, [remark])],
            end=self._end or next(iter(self._problems), ""),
        )
        self._overview.close(closing_words(row), failed=bool(self._problems))
        return row

    def _simulate_losses(self) -> None:
        """Pause the processes that the course loses now, and resume the others."""
        lost = self._course.lost(self._elapsed_time_s())
        for name in lost - self._paused:
            self._fleet.pause(name)
        for name in self._paused - lost:
            self._fleet.resume(name)
        self._paused = lost

    def _receive(self, message: str) -> None:
        self._log.receive(timeout_s=LISTEN_S)
        self._fleet.weigh(self._log.diagnostics)
        self._losses.publish(self._log.diagnostics)
        health = Health.ERROR if self._problems else Health.OK
        self._overview.publish(
            health, message, self._log.waits_for if self._log.waiting else self._log.reason
        )
        now_s = self._clock()
        if now_s - self._shown_s >= self._settings.status_period_s:
            self._shown_s = now_s
            self._show(self._log, self._fleet, self._elapsed_time_s())

    def _elapsed_time_s(self) -> float:
        return self._clock() - self._began_s

    def _end_silent_processes(self) -> None:
        """End processes that run without heartbeats, so that they are started again."""
        for name, silent_s in self._silence.silent(self._log.diagnostics, paused=self._paused):
            loss = self._fleet.children[name].spec.loss
            said = f"process {name} was silent for {silent_s:.1f} s"
            (self._problems if loss is Loss.STOP else self._notes).append(said)
            self._fleet.kill(name)

    def _has_stopped_after_loss(self) -> bool:
        """True at standstill after the loss of a process, or after the time limit for it."""
        if self._lost_s is None:
            return False
        speed_mps = self._log.state.speed_mps if self._log.state else None
        if speed_mps is not None and abs(speed_mps) < self._standstill_mps:
            self._problems.append(f"the car stopped {self._elapsed_time_s() - self._lost_s:.1f} s after that")
            return True
        return self._fails_to_stop(self._elapsed_time_s() - self._lost_s, "that")

    def _fails_to_stop(self, since_s: float, what: str) -> bool:
        """True, and a problem, when the car has moved on for longer than the time limit since ``what``."""
        if since_s <= self._settings.stop_timeout_s:
            return False
        self._problems.append(
            f"the car did not stop within {self._settings.stop_timeout_s:.0f} s after {what}"
        )
        return True
