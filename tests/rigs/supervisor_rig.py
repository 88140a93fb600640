"""The supervisor over a scripted drive."""

from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Any

from message_rig import estimate

from supervisor.supervisor import Supervisor, SupervisorSettings, build
from trepid.config import CONFIG_DIR, load
from trepid.messages import (
    Decision,
    ImageStatistics,
    LeadVehicle,
    Losses,
    Mode,
    RoadUsers,
    SteeringEstimate,
    VehicleState,
)

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)


FRAME_S = 0.04


LATENCY_S = 0.03


ESTIMATE = estimate()


STATISTICS = ImageStatistics(
    t_s=0.0,
    brightness=0.45,
    contrast=0.15,
    over_exposed=0.01,
    under_exposed=0.01,
    sharpness=200.0,
    frozen_s=0.0,
    spots=0.0,
)


STATE = VehicleState(
    t_s=0.0, speed_mps=8.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
)


@dataclass
class Drive:
    """A supervisor fed with fresh messages at 25 Hz; a message set to None is missing from then on."""

    supervisor: Supervisor = field(default_factory=build)
    now_s: float = 0.0
    speed_mps: float = 0.0
    latest: dict[str, Any] = field(default_factory=dict)  # the last message of every sender
    estimators: tuple[str, ...] = ("cv", "cnn")

    def frame(
        self,
        *,
        cv: SteeringEstimate | None = ESTIMATE,
        cnn: SteeringEstimate | None = ESTIMATE,
        statistics: ImageStatistics | None = STATISTICS,
        lead: LeadVehicle | None = None,
        road_users: RoadUsers | None = None,
        state: VehicleState | None = STATE,
        losses: Losses | None = None,
        segments: SteeringEstimate | None = None,
    ) -> Decision:
        self.now_s += FRAME_S
        seen_s = self.now_s - LATENCY_S
        if state is not None:
            self.latest["state"] = replace(state, t_s=self.now_s - 0.01, speed_mps=self.speed_mps)
        sent = {"cv": cv, "cnn": cnn, "segments": segments, "statistics": statistics, "lead": lead}
        sent["road_users"] = road_users
        for name, message in sent.items():
            if message is not None:
                self.latest[name] = replace(message, t_s=seen_s)
        get = self.latest.get
        return self.supervisor.step(
            {name: get(name) for name in self.estimators},
            get("statistics"),
            get("lead"),
            get("state"),
            now_s=self.now_s,
            road_users=get("road_users"),
            losses=losses,
        )

    def last(self, duration_s: float, **messages: Any) -> Decision:
        """Frames for ``duration_s``; the last decision."""
        for _ in range(round(duration_s / FRAME_S)):
            decision = self.frame(**messages)
        return decision

    @classmethod
    def under_way(cls) -> "Drive":
        """Keeping the lane at 8 m/s."""
        return deepcopy(_under_way())


@cache
def _under_way() -> Drive:
    """The drive that every test of a car under way copies."""
    drive = Drive()
    drive.last(SETTINGS.modes.reengage_after_s + 0.2)  # type: ignore[operator]
    drive.speed_mps = 8.0
    assert drive.last(6.0).mode is Mode.KEEP
    return drive
