"""The last minutes of a drive as timelines, and the path that the car has driven."""

import math
from collections import deque
from collections.abc import Sequence
from typing import Any

from trepid.clothoid import Motion
from trepid.messages import SimTruth, VehicleState

SAMPLE_S = 0.2
KEPT = 450  # samples: 90 s
MAX_POINTS = 3000  # of the driven path
SPACING_M = 0.5
LONGEST_S = 1.5  # the path is not continued over a longer gap; without a viewer states are 1 s apart


class Timelines:
    """The newest samples of some quantities, numbered, so that a viewer gets those that it does not have."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = ("t_s", *names)
        self._rows: deque[list[float | None]] = deque(maxlen=KEPT)
        self.count = 0
        """Number of samples so far, kept or not."""
        self._due_s = -math.inf

    def due(self, now_s: float) -> bool:
        """True once every SAMPLE_S."""
        if now_s < self._due_s:
            return False
        self._due_s = max(self._due_s + SAMPLE_S, now_s)
        return True

    def add(self, now_s: float, values: Sequence[float | None]) -> None:
        """Add one sample; None where a quantity is not known."""
        self._rows.append([round(now_s, 3), *map(_short, values)])
        self.count += 1

    def since(self, count: int) -> list[list[float | None]]:
        """The kept samples after the first ``count``."""
        missing = min(len(self._rows), self.count - count)
        return list(self._rows)[len(self._rows) - missing :]


class PathHistory:
    """The driven path, as (x [m], y [m], fear): the true one of a simulated car, else by speed and yaw rate.

    When it has MAX_POINTS, every second point is dropped and the spacing doubles.
    """

    def __init__(self, spacing_m: float = SPACING_M) -> None:
        self._spacing_m = spacing_m
        self._points: list[tuple[float, float, float | None]] = []
        self._state: VehicleState | None = None
        self._measured = 0.0, 0.0, 0.0  # x, y, yaw
        self.thinned = 0
        """How often points were dropped; a viewer with another number needs all points."""
        self.pose: tuple[float, float, float] | None = None
        """x [m], y [m] and yaw [rad] of the car; None while they are not known."""
        self.true = False
        """The path is that of the simulator."""
        self.driven_m = 0.0

    def add(self, state: VehicleState | None, truth: SimTruth | None, fear: float | None) -> None:
        """Continue the path to the pose of ``truth``, or without it by the motion in ``state``."""
        if truth is not None:
            self.true = True
            self.pose = truth.x_m, truth.y_m, truth.yaw_rad
        elif state is not None and not self.true:
            self._continue(state)
        if self.pose is None:
            return
        x_m, y_m, _ = self.pose
        way_m = math.hypot(x_m - self._points[-1][0], y_m - self._points[-1][1]) if self._points else 0.0
        if self._points and way_m < self._spacing_m:
            return
        self.driven_m += way_m
        self._points.append((round(x_m, 2), round(y_m, 2), _short(fear)))
        if len(self._points) > MAX_POINTS:
            self._points = self._points[::2]
            self._spacing_m *= 2
            self.thinned += 1

    def since(self, thinned: int, count: int) -> tuple[bool, list[tuple[float, float, float | None]]]:
        """Whether the viewer has to begin anew, and the points after its ``count``."""
        anew = thinned != self.thinned or count > len(self._points)
        return anew or count == 0, self._points[0 if anew else count :]

    @property
    def count(self) -> int:
        """Number of points."""
        return len(self._points)

    def _continue(self, state: VehicleState) -> None:
        last, self._state = self._state, state
        known = state.speed_mps is not None and state.yaw_rate_radps is not None
        if not known:
            return
        held_s = 0.0 if last is None else state.t_s - last.t_s
        if 0.0 < held_s <= LONGEST_S:
            motion = Motion(state.speed_mps or 0.0, state.yaw_rate_radps or 0.0)
            ahead_m, left_m, turned_rad = motion.over(held_s)
            x_m, y_m, yaw_rad = self._measured
            x_m += ahead_m * math.cos(yaw_rad) - left_m * math.sin(yaw_rad)
            y_m += ahead_m * math.sin(yaw_rad) + left_m * math.cos(yaw_rad)
            self._measured = x_m, y_m, yaw_rad + turned_rad
        self.pose = self._measured


def _short(value: float | None) -> Any:
    return None if value is None or not math.isfinite(value) else round(value, 4)
