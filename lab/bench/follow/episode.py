"""One case, driven and scored: distance from the leader's path, smoothness of hand-overs, gap."""

import math
from dataclasses import asdict, dataclass, field

import numpy as np
from numpy.typing import NDArray

from lab.bench.follow.cases import Kind, case
from sim_harness.lockstep.closed_loop import Instant, run
from supervisor.path.trail import LEAD
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, load
from trepid.messages import Mode

HAND_OVER_S = 0.2  # after a change of path, in which the wheel must not jump
MOVING_MPS = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Episode:
    """Scores of one case; None where nothing is to be scored."""

    seed: int
    kind: str
    collisions: int
    departures: int
    path_error_m: (
        float | None
    )  # greatest distance of the rear axle from the leader's path while it was followed, ...
    joined_error_m: float | None  # ... once the hand-over has ended
    road_error_m: float  # greatest distance from the middle of the lane
    hand_over_step_deg: (
        float | None
    )  # greatest change of the wheel within one decision after a change of path
    hand_over_turn_deg: float | None  # ... within 0.2 s, the angle for the road included
    followed_s: float
    stopped: bool  # at any time after the road was lost
    min_time_gap_s: float | None  # while following and moving


@dataclass(slots=True)
class Watcher:
    """Records the data of the scores."""

    leaders: list[list[tuple[float, float]]] = field(default_factory=list)
    own: list[tuple[float, float]] = field(default_factory=list)
    on_trail_s: list[float] = field(default_factory=list)  # time on the trail; NaN: not on the trail
    wheel_rad: list[float] = field(default_factory=list)
    source: list[str] = field(default_factory=list)
    t_s: list[float] = field(default_factory=list)
    gap_s: list[float] = field(default_factory=list)
    road_m: list[float] = field(default_factory=list)
    followed: int = 0
    stopped: bool = False

    def __call__(self, now: Instant) -> None:
        """Record an instant; of the run-up only the paths of leaders."""
        truth, decision = now.truth, now.decision
        places = zip(truth.traffic_x_m, truth.traffic_y_m, strict=True)
        if not self.leaders:
            self.leaders = [[] for _ in truth.traffic_x_m]
        for path, place in zip(self.leaders, places, strict=True):
            path.append(place)
        if now.now_s < 0 or decision is None or now.command is None:
            return
        speed_mps = truth.speed_mps or 0.0
        led = decision.path_source == LEAD and speed_mps > MOVING_MPS
        before_s = self.on_trail_s[-1] if self.on_trail_s else math.nan
        self.t_s.append(now.now_s)
        self.own.append((truth.x_m, truth.y_m))
        since_s = 0.0 if math.isnan(before_s) else before_s + now.now_s - self.t_s[-2]
        self.on_trail_s.append(since_s if led else math.nan)
        self.wheel_rad.append(now.command.road_wheel_angle_rad)
        self.source.append(decision.path_source)
        self.road_m.append(truth.lateral_offset_m)
        follows = decision.mode is Mode.FOLLOW
        self.followed += follows
        self.stopped = self.stopped or (self.followed > 0 and decision.mode is Mode.STOP)
        if follows and speed_mps > MOVING_MPS and truth.lead_gap_m is not None:
            self.gap_s.append(truth.lead_gap_m / speed_mps)


def drive(seed: int, *, rendered: bool) -> Episode:
    """Drive and score the case of ``seed``."""
    kind, scenario = case(seed, rendered=rendered)
    led_over_s = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).follow.hand_over_s
    watcher = Watcher()
    result = run(scenario, seed=seed, witness=watcher)
    steps_deg, turns_deg = hand_overs(watcher)
    return Episode(
        seed=seed,
        kind=str(kind),
        collisions=result.metrics.collisions,
        departures=result.metrics.departures,
        path_error_m=_path_error_m(watcher, kind, after_s=0.0),
        joined_error_m=_path_error_m(watcher, kind, after_s=led_over_s),
        road_error_m=float(np.abs(watcher.road_m).max()),
        hand_over_step_deg=max(steps_deg, default=None),
        hand_over_turn_deg=max(turns_deg, default=None),
        followed_s=round(watcher.followed * 0.01, 2),
        stopped=watcher.stopped,
        min_time_gap_s=min(watcher.gap_s, default=None),
    )


def _path_error_m(watcher: Watcher, kind: Kind, *, after_s: float) -> float | None:
    """Greatest distance from the nearest path of a vehicle ahead, counted from ``after_s`` on the trail.

    None when no vehicle was followed for that long.

    A leader that leaves the road counts up to the edge of the road.
    """
    if kind is Kind.LEAVES_ROAD:
        return None
    own = np.array(watcher.own)[np.array(watcher.on_trail_s) >= after_s][::4]
    if not len(own):
        return None
    nearest = [distances_m(own, np.array(path)[::5]) for path in watcher.leaders]
    return float(np.min(nearest, axis=0).max())


def distances_m(points: NDArray[np.float64], path: NDArray[np.float64]) -> NDArray[np.float64]:
    """Distance of each point (n, 2) from a polyline (m, 2), extended straight before its first point."""
    way = np.diff(path, axis=0)
    moved = np.hypot(*way.T) > 1e-6
    start, way = path[:-1][moved], way[moved]
    if not len(way):
        return np.asarray(np.hypot(*(points - path[0]).T))
    start, way = (
        np.vstack([start[:1] - 100 * way[:1] / np.hypot(*way[0]), start]),
        np.vstack([start[:1], way]),
    )
    way[0] = path[0] - start[0]
    length2 = (way**2).sum(axis=1)
    off = points[:, None] - start
    share = np.clip((off * way).sum(axis=2) / length2, 0, 1)
    return np.asarray(np.hypot(*np.moveaxis(off - share[:, :, None] * way, 2, 0)).min(axis=1))


def hand_overs(watcher: Watcher) -> tuple[list[float], list[float]]:
    """At each change between road and leader: greatest step in one period, and turn within HAND_OVER_S [deg]."""
    led = [source == LEAD for source in watcher.source]
    wheel = np.degrees(watcher.wheel_rad)
    steps, turns = [], []
    for i in range(1, len(led)):
        if led[i] != led[i - 1] and watcher.source[i] != "none" and watcher.source[i - 1] != "none":
            after = wheel[i - 1 : i + round(HAND_OVER_S / 0.01)]
            steps.append(float(np.abs(np.diff(after)).max()))
            turns.append(float(np.abs(after - after[0]).max()))
    return steps, turns


def row(episode: Episode) -> dict[str, object]:
    """The episode as JSON, to 4 decimals."""
    numbers = asdict(episode)
    return {
        key: round(v, 4) if isinstance(v, float) and math.isfinite(v) else v for key, v in numbers.items()
    }
