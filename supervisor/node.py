"""Supervisor process: one decision per camera frame, and at least one every IDLE_PERIOD_S without frames."""

from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from supervisor.inputs.watchdog import LEAD, STATE, STATISTICS, USERS
from supervisor.rules.reload import RuleWatch
from supervisor.supervisor import Supervisor, build
from trepid.bus import Latest
from trepid.causes import line_words
from trepid.messages import Health
from trepid.processes.journal import Journal, Timekeeper
from trepid.processes.process import Process, Values
from trepid.processes.turns import serve
from trepid.topics import (
    DECISION,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    LOSSES,
    ROAD_USERS,
    VEHICLE_STATE,
    estimate_topic,
)

IDLE_PERIOD_S = 0.05  # decide at least this often
GATHER_S = 0.02  # wait this long for the other estimators of the same frame


class SupervisorNode:
    """Decides when all estimates of a frame are in, GATHER_S after the first, or after IDLE_PERIOD_S.

    It also decides when a message becomes late, and at every report of a lost process. Only estimates and such
    reports wake the process; the other inputs are read when it decides.
    """

    def __init__(self, me: Process, supervisor: Supervisor, changes: RuleWatch) -> None:
        bus = me.bus
        self._me, self._supervisor, self._changes = me, supervisor, changes
        self._estimates = {name: bus.latest(estimate_topic(name)) for name in me.options["estimators"]}
        self._statistics = bus.latest(IMAGE_STATISTICS, wakes=False)
        self._lead = bus.latest(LEAD_VEHICLE, wakes=False)
        self._road_users = bus.latest(ROAD_USERS, wakes=False)
        self._state = bus.latest(VEHICLE_STATE, wakes=False)
        self._losses = bus.latest(LOSSES)
        self._inputs: dict[str, Latest[Any]] = {
            **self._estimates,
            STATISTICS: self._statistics,
            LEAD: self._lead,
            USERS: self._road_users,
            STATE: self._state,
        }
        self._send = bus.publisher(DECISION)
        self._journal = Journal(me, DECISION, reads=(*self._inputs.values(), self._losses))
        self._health = Health.OK, ""
        self._adopted: deque[Values] = deque(maxlen=1)  # rules that the next heartbeat reports
        self._times = Timekeeper(bus, me.name, me.now_s)
        me.ready(values=lambda: self._adopted.popleft() if self._adopted else ())
        self._decide_by_s = me.now_s() + IDLE_PERIOD_S
        self._first_s: float | None = None  # when the first estimate since the last decision came
        self._last: Latest[Any] | None = None  # the estimate that came last since then

    def due_s(self) -> float:
        """Time to the next decision if no further estimate comes."""
        by_s = self._decide_by_s
        if self._first_s is not None:
            by_s = min(by_s, self._first_s + GATHER_S)
        return max(0.0, by_s - self._me.now_s())

    def turn(self) -> None:
        """Decide if it is time."""
        now_s = self._me.now_s()
        for latest in self._estimates.values():
            if latest.take() is not None:
                self._last = latest
                self._first_s = now_s if self._first_s is None else self._first_s
        reported = self._losses.take() is not None
        complete = self._first_s is not None and self._of_one_frame()
        gathered = self._first_s is not None and now_s - self._first_s >= GATHER_S
        if reported or complete or gathered or now_s >= self._decide_by_s:
            self._decide(now_s)

    def _decide(self, now_s: float) -> None:
        decision = self._supervisor.step(
            {name: latest.message for name, latest in self._estimates.items()},
            self._statistics.refresh(),
            self._lead.refresh(),
            self._state.refresh(),
            now_s=now_s,
            malformed=[name for name, latest in self._inputs.items() if latest.broken],
            losses=self._losses.message,
            lead_sent_s=self._lead.stamp.published_s,
            road_users=self._road_users.refresh(),
        )
        self._send(decision)
        self._journal.note(now_s)
        if self._last is not None:
            self._times.note(decision.t_s, self._last, began_s=now_s)
        self._decide_by_s = min(now_s + IDLE_PERIOD_S, self._supervisor.late_at_s)
        self._first_s, self._last = None, None
        change = self._changes.take()
        if change is not None:
            self._health = change.apply(self._supervisor.adopt)
            if self._health[0] is Health.OK:
                self._adopted.append(change.values(from_s=now_s))
        health, message = self._health
        self._me.count_step(health, "; ".join(filter(None, (message, line_words(decision.line_warning)))))

    def _of_one_frame(self) -> bool:
        """True when the newest messages of all estimators are of one frame."""
        stamps = {latest.message.t_s if latest.message else None for latest in self._estimates.values()}
        return len(stamps) == 1 and None not in stamps


@contextmanager
def node(me: Process) -> Iterator[SupervisorNode]:
    """The node of the supervisor; the rule file may change meanwhile."""
    rules = Path(me.options["rules"])
    with RuleWatch(rules, Path(me.options.get("edited_rules", rules))) as changes:
        supervisor = build(rules=rules, cruise_speed_mps=me.options["cruise_speed_mps"])
        yield SupervisorNode(me, supervisor, changes)


if __name__ == "__main__":
    serve(node)
