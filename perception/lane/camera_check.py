"""Does the camera stand as its file says? What the tracked lane shows of it while driving.

Pitch: where two lines run together shows how far down the camera looks, so the tracker knows δ, what it looks
further down than the file says, and uses it: a wrong pitch is corrected at once, and its mean is reported.

Height: on the road everything is measured in heights of the camera. With a height s times too large in the file a
bend of curvature κ is seen with κ/s, but the yaw rate r and the speed v know better: over all bends the turn ∫|r|dt
over that which was seen, ∫|κ|·v·dt, is s. The tracker follows the yaw rate too, so some two thirds of s − 1 show.
"""

from dataclasses import dataclass

from perception.lane.fit import KAPPA, PITCH, PSI, LaneState
from trepid.config import Settings
from trepid.types import Positive


class CameraCheckSettings(Settings):
    """Section ``camera_check`` of ``config/perception.yaml``."""

    straight_1pm: Positive
    bent_1pm: Positive
    memory_s: Positive
    pitch_limit_rad: Positive
    least_turn_rad: Positive
    height_limit: Positive


@dataclass(frozen=True, slots=True)
class CameraDoubt:
    """What is wrong with the mounting, as far as it has shown; None: not yet known."""

    pitch_error_rad: float | None  # looks this much further down than its file says
    height_ratio: float | None  # height in its file over its true height, or nearer to 1


class CameraCheck:
    """Gathers evidence about the mounting of one camera, frame by frame."""

    def __init__(self, settings: CameraCheckSettings) -> None:
        self._settings = settings
        self._pitch_rad, self._straight_s = 0.0, 0.0
        self._turned_rad, self._seen_rad = 0.0, 0.0
        self._heading_rad: float | None = None

    def step(
        self, lane: LaneState, *, speed_mps: float | None, yaw_rate_radps: float | None, dt_s: float
    ) -> None:
        """A lane seen by both its lines, ``dt_s`` after the frame before."""
        settings = self._settings
        curvature, heading = float(lane.mean[KAPPA]), float(lane.mean[PSI])
        if abs(curvature) < settings.straight_1pm:
            self._straight_s += dt_s
            share = dt_s / min(self._straight_s, settings.memory_s)
            self._pitch_rad += share * (float(lane.mean[PITCH]) - self._pitch_rad)
        before, self._heading_rad = self._heading_rad, heading
        if (
            speed_mps is None
            or yaw_rate_radps is None
            or before is None
            or abs(curvature) < settings.bent_1pm
        ):
            return
        side = 1.0 if curvature > 0 else -1.0
        self._turned_rad += side * (yaw_rate_radps * dt_s - (heading - before))
        self._seen_rad += side * curvature * speed_mps * dt_s

    def pause(self) -> None:
        """A frame without both lines: the heading before it is no measure of the turn after it."""
        self._heading_rad = None

    @property
    def doubt(self) -> CameraDoubt:
        """What has shown so far."""
        enough = self._seen_rad > self._settings.least_turn_rad
        return CameraDoubt(
            pitch_error_rad=self._pitch_rad if self._straight_s >= self._settings.memory_s / 2 else None,
            height_ratio=self._turned_rad / self._seen_rad if enough else None,
        )

    @property
    def reason(self) -> str:
        """One line for people where the mounting is not as its file says, else nothing."""
        doubt, found = self.doubt, []
        pitch, ratio = doubt.pitch_error_rad, doubt.height_ratio
        if pitch is not None and abs(pitch) > self._settings.pitch_limit_rad:
            found.append(
                f"looks {abs(pitch):.3f} rad further {'down' if pitch > 0 else 'up'} than its file says"
            )
        if ratio is not None and abs(ratio - 1) > self._settings.height_limit:
            found.append(f"stands {'lower' if ratio > 1 else 'higher'} than its file says")
        return "the camera " + " and ".join(found) if found else ""
