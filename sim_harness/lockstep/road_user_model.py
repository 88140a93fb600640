"""The true road users with the errors of a camera's detector, for sweeps without rendering.

A detector finds the ground point in the image. With the focal length f and the height h of the lens, an error of e
pixels at the feet turns the distance x from the lens into x / (1 + e·x/(f·h)), which moves the ground point along
its ray: the error grows with the square of the distance. An error of e pixels to the side moves it by e·x/f. Both
errors are first-order Gauss-Markov processes (Gelb, Applied Optimal Estimation (1974), section 3.7). A road user is
reported after a while in sight, and missed and found again with rates that depend on its distance; its velocity
follows the true one with a lag, also over frames that miss it.
"""

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, Settings, load
from trepid.messages import RoadUsers
from trepid.types import Array, NonNegative, Positive, Share


class RoadUserModelSettings(Settings):
    """``config/road_user_model.yaml``. Lists of equal length, interpolated over the distance."""

    distances_m: Annotated[tuple[Positive, ...], Field(min_length=2)]
    seen: tuple[Share, ...]  # share of the time; beyond the last distance nothing is seen
    foot_sigma_px: NonNegative
    side_sigma_px: NonNegative
    memory_s: Positive  # of both errors
    found_after_s: NonNegative  # in sight until the first report
    lost_for_s: Positive  # mean length of a loss of sight
    velocity_after_s: NonNegative  # after the first report
    velocity_lag_s: Positive
    velocity_sigma_mps: NonNegative

    @model_validator(mode="after")
    def _same_lengths(self) -> "RoadUserModelSettings":
        if len(self.seen) != len(self.distances_m):
            raise ValueError(f"seen must have {len(self.distances_m)} numbers, one for each distance")
        return self


@dataclass(slots=True)
class _UserErrors:
    """The state of the errors for one road user."""

    errors: Array  # foot, side, and the two axes of the velocity
    in_sight_s: float = 0.0
    tracked_s: float = 0.0
    detected: bool = True
    velocity_mps: Array | None = field(default=None)


class RoadUserModel:
    """Adds the errors of a detector to the true road users."""

    def __init__(self, settings: RoadUserModelSettings, camera: Camera, *, seed: int) -> None:
        self._settings, self._camera = settings, camera
        self._rng = np.random.default_rng((seed, 31))
        self._tracks: dict[int, _UserErrors] = {}
        self._t_s: float | None = None

    def step(self, truth: RoadUsers, numbers: tuple[int, ...]) -> RoadUsers:
        """The output of the detector; ``numbers``: which road user of the scenario each item of ``truth`` is."""
        dt_s = 0.0 if self._t_s is None else truth.t_s - self._t_s
        self._t_s = truth.t_s
        kept = math.exp(-dt_s / self._settings.memory_s)
        for gone in set(self._tracks) - set(numbers):
            del self._tracks[gone]
        found = []
        for place, number in enumerate(numbers):
            track = self._tracks.get(number)
            if track is None:
                track = self._tracks[number] = _UserErrors(self._rng.standard_normal(4))
            fresh = self._rng.standard_normal(4)
            track.errors = kept * track.errors + math.sqrt(1 - kept**2) * fresh
            item = self._detection(truth, place, track, dt_s, float(self._rng.random()))
            found += [] if item is None else [item]
        columns: tuple[tuple[float, ...], ...] = tuple(zip(*(item[1:] for item in found), strict=True))
        x_m, y_m, x_mps, y_mps = columns or ((), (), (), ())
        return replace(
            truth,
            kinds=tuple(item[0] for item in found),
            x_m=x_m,
            y_m=y_m,
            x_mps=x_mps,
            y_mps=y_mps,
            confidences=(1.0,) * len(found),
        )

    def _detection(
        self, truth: RoadUsers, place: int, track: _UserErrors, dt_s: float, chance: float
    ) -> tuple[str, float, float, float, float] | None:
        """Kind, ground point and velocity as the detector reports them; None without a report."""
        s, camera = self._settings, self._camera
        ahead_m, left_m = truth.x_m[place] - camera.x_m, truth.y_m[place] - camera.y_m
        away_m = math.hypot(ahead_m, left_m)
        in_image = abs(math.atan2(left_m, ahead_m) - camera.yaw_rad) < math.atan(camera.cx_px / camera.fx_px)
        seen = float(np.interp(away_m, s.distances_m, s.seen, right=0.0)) if in_image else 0.0
        track.in_sight_s = track.in_sight_s + dt_s if seen > 0.0 else 0.0
        self._lose_or_find(track, seen, dt_s, chance)
        if seen == 0.0:
            track.tracked_s, track.velocity_mps = 0.0, None
        if track.in_sight_s < s.found_after_s or seen == 0.0:
            return None
        foot, side, *velocity_errors = track.errors.tolist()
        ratio = 1 / max(1 + s.foot_sigma_px * foot * away_m / (camera.fy_px * camera.height_m), 0.5)
        aside_m = s.side_sigma_px * side * away_m / camera.fx_px
        x_m, y_m = camera.x_m + ahead_m * ratio, camera.y_m + left_m * ratio + aside_m
        true_mps = np.array((truth.x_mps[place], truth.y_mps[place]))
        before_mps = np.zeros(2) if track.velocity_mps is None else track.velocity_mps
        track.velocity_mps = true_mps + (before_mps - true_mps) * math.exp(-dt_s / s.velocity_lag_s)
        known = track.tracked_s >= s.velocity_after_s
        track.tracked_s += dt_s
        if not track.detected:
            return None
        noisy = (track.velocity_mps + s.velocity_sigma_mps * np.array(velocity_errors)).tolist()
        x_mps, y_mps = noisy if known else (math.nan, math.nan)
        return truth.kinds[place], x_m, y_m, x_mps, y_mps

    def _lose_or_find(self, track: _UserErrors, seen: float, dt_s: float, chance: float) -> None:
        """Lose or find the road user again: a Markov chain that is right for the share ``seen`` of the time."""
        seen = min(max(seen, 1e-3), 1 - 1e-6)
        found_1ps = 1 / self._settings.lost_for_s
        rate_1ps = found_1ps * (1 - seen) / seen if track.detected else found_1ps
        if chance < 1 - math.exp(-rate_1ps * dt_s):
            track.detected = not track.detected


def build_road_user_model(camera: Camera, *, seed: int) -> RoadUserModel:
    """The model in ``config/``. Raises InputError."""
    return RoadUserModel(load(CONFIG_DIR / "road_user_model.yaml", RoadUserModelSettings), camera, seed=seed)
