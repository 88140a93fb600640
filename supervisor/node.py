"""Supervisor process: one decision per camera frame, and at least one every IDLE_PERIOD_S without frames."""

from collections import deque
from pathlib import Path
from typing import Any

from supervisor.inputs.watchdog import LEAD, STATE, STATISTICS
from supervisor.rules.reload import RuleWatch
from supervisor.supervisor import Supervisor, build
from trepid.bus import Latest
from trepid.messages import Health, SteeringEstimate
from trepid.processes.process import Process, Values, process
from trepid.topics import DECISION, IMAGE_STATISTICS, LEAD_VEHICLE, VEHICLE_STATE, estimate_topic

IDLE_PERIOD_S = 0.05  # decide at least this often
GATHER_S = 0.02  # wait this long for the other estimators of the same frame


def run(me: Process) -> None:
    """Build the supervisor and decide until the process is to stop; the rule file may change meanwhile."""
    rules = Path(me.options["rules"])
    with RuleWatch(rules) as changes:
        supervisor = build(rules=rules, cruise_speed_mps=me.options["cruise_speed_mps"])
        decide(me, supervisor, changes)


def decide(me: Process, supervisor: Supervisor, changes: RuleWatch) -> None:
    """Decide when all estimates of a frame are in, GATHER_S after the first, or after IDLE_PERIOD_S."""
    estimates = {name: me.bus.latest(estimate_topic(name)) for name in me.options["estimators"]}
    statistics, lead = me.bus.latest(IMAGE_STATISTICS), me.bus.latest(LEAD_VEHICLE)
    state = me.bus.latest(VEHICLE_STATE)
    inputs: dict[str, Latest[Any]] = {**estimates, STATISTICS: statistics, LEAD: lead, STATE: state}
    send = me.bus.publisher(DECISION)
    health = Health.OK, ""
    adopted: deque[Values] = deque(maxlen=1)  # rules that the next heartbeat reports
    me.ready(values=lambda: adopted.popleft() if adopted else ())
    decided_s = me.now_s()
    first_s: float | None = None  # when the first estimate since the last decision came
    while me.running():
        me.bus.wait(timeout_s=GATHER_S / 4)
        now_s = me.now_s()
        fresh = [name for name, latest in estimates.items() if latest.take() is not None]
        if fresh and first_s is None:
            first_s = now_s
        complete = first_s is not None and _same_frame(estimates)
        gathered = first_s is not None and now_s - first_s >= GATHER_S
        if not (complete or gathered or now_s - decided_s >= IDLE_PERIOD_S):
            continue
        decision = supervisor.step(
            {name: latest.message for name, latest in estimates.items()},
            statistics.refresh(),
            lead.refresh(),
            state.refresh(),
            now_s=now_s,
            malformed=[name for name, latest in inputs.items() if latest.broken],
        )
        send(decision)
        decided_s, first_s = now_s, None
        change = changes.take()
        if change is not None:
            health = change.adopted(supervisor.adopt)
            if health[0] is Health.OK:
                adopted.append(change.values(from_s=now_s))
        me.stepped(*health)


def _same_frame(estimates: dict[str, Latest[SteeringEstimate]]) -> bool:
    """True when the newest messages of all estimators are of one frame."""
    stamps = {latest.message.t_s if latest.message else None for latest in estimates.values()}
    return len(stamps) == 1 and None not in stamps


if __name__ == "__main__":
    with process() as me:
        run(me)
