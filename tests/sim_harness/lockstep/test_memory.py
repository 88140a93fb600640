"""A long drive needs no more memory than a short one: nothing in the nodes grows with the time driven."""

import gc
import sys
from types import FunctionType, ModuleType
from typing import Any

from sim_harness.lockstep.closed_loop import build_parts
from sim_harness.lockstep.oracle import clear_view
from sim_harness.lockstep.stack import Perception, Stack
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import load_scenario

SETTLED_S, LONGER_S = 20.0, 50.0
ALLOWED_BYTES = 20_000  # a message a second would be more


def size_of(*roots: Any) -> int:
    """Bytes of all objects that can be reached from ``roots``, without code."""
    seen: dict[int, Any] = {}
    waiting = list(roots)
    while waiting:
        found = waiting.pop()
        if id(found) in seen or isinstance(found, type | ModuleType | FunctionType):
            continue
        seen[id(found)] = found
        waiting += gc.get_referents(found)
    return sum(map(sys.getsizeof, seen.values()))


def test_supervisor_controller_limiter_and_vehicle_keep_their_size() -> None:
    settings = load_simulator()
    scenario = load_scenario("circuit", {"sight": "truth"}, check=False)
    parts = build_parts(scenario, seed=0)
    stack = Stack(
        parts.supervisor,
        parts.controller,
        scenario.estimators,
        idle_period_s=settings.idle_decision_period_s,
    )
    tick = 0

    def drive_until(end_s: float) -> float:
        """Speed of the car then."""
        nonlocal tick
        while (now_s := tick * settings.period_s) < end_s:
            state, truth = parts.vehicle.step(stack.command, stack.commanded_s, now_s=now_s)
            if tick % 4 == 0:
                estimates = {name: oracle.step(truth) for name, oracle in parts.oracles.items()}
                stack.send(Perception(now_s + 0.03, estimates, clear_view(truth.t_s), None))
            stack.step(state, command_due=tick % 2 == 0, now_s=now_s)
            tick += 1
        return state.speed_mps or 0.0

    assert drive_until(SETTLED_S) > 3.0
    before = size_of(parts.supervisor, parts.controller, parts.vehicle)
    assert drive_until(LONGER_S) > 3.0
    assert size_of(parts.supervisor, parts.controller, parts.vehicle) - before < ALLOWED_BYTES
