"""The nodes behind the estimators in lock-step: perception that arrives late, supervisor and controller."""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Set
from dataclasses import dataclass

from controller.controller import Controller
from supervisor.supervisor import Supervisor
from trepid.messages import (
    Command,
    Decision,
    ImageStatistics,
    LeadVehicle,
    RoadUsers,
    SteeringEstimate,
    VehicleState,
)

_SAME_INSTANT_S = 1e-9
NONE_LOST: frozenset[str] = frozenset()


@dataclass(frozen=True, slots=True)
class Perception:
    """The results of one frame, and when they reach the supervisor."""

    due_s: float
    estimates: Mapping[str, SteeringEstimate]
    statistics: ImageStatistics | None
    lead: LeadVehicle | None
    road_users: RoadUsers | None = None


class Stack:
    """Holds the newest message of each topic, as every live process does."""

    def __init__(
        self,
        supervisor: Supervisor,
        controller: Controller,
        estimators: Iterable[str],
        *,
        idle_period_s: float | None,
    ) -> None:
        """``idle_period_s`` without perception is followed by a decision; None: every decision needs a frame."""
        self._supervisor, self._controller = supervisor, controller
        self._idle_period_s = idle_period_s
        self._decide_by_s = math.inf if idle_period_s is None else -math.inf
        self._underway: deque[Perception] = deque()
        self.estimates: dict[str, SteeringEstimate | None] = dict.fromkeys(estimators)
        self.statistics: ImageStatistics | None = None
        self.lead: LeadVehicle | None = None
        self.road_users: RoadUsers | None = None
        self.decision: Decision | None = None
        self.command: Command | None = None
        self.commanded_s: float | None = None

    def send(self, perception: Perception) -> None:
        """Put ``perception`` on its way to the supervisor."""
        self._underway.append(perception)

    def step(
        self, state: VehicleState, *, command_due: bool, now_s: float, lost: Set[str] = NONE_LOST
    ) -> None:
        """Deliver the messages that are due; decide on an arrival or when idle; command on a decision or when due.

        ``lost`` names the processes that do not run now.
        """
        arrived = bool(self._underway) and self._arrive(now_s)
        decided = (arrived or now_s >= self._decide_by_s - _SAME_INSTANT_S) and "supervisor" not in lost
        if decided:
            self.decision = self._supervisor.step(
                self.estimates,
                self.statistics,
                self.lead,
                state,
                now_s=now_s,
                road_users=self.road_users,
            )
            if self._idle_period_s is not None:
                self._decide_by_s = now_s + self._idle_period_s
        if (decided or command_due) and "controller" not in lost:
            self.command = self._controller.step(self.decision, state, now_s=now_s)
            self.commanded_s = now_s

    def _arrive(self, now_s: float) -> bool:
        """Take the messages that are due by ``now_s``; True when there are any."""
        arrived = False
        while self._underway and self._underway[0].due_s <= now_s + _SAME_INSTANT_S:
            perception = self._underway.popleft()
            self.estimates.update(perception.estimates)
            self.statistics, self.lead = perception.statistics, perception.lead or self.lead
            self.road_users = perception.road_users or self.road_users
            arrived = True
        return arrived
