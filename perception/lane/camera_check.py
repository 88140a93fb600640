"""A check of the camera mounting against its file, from the lane detected while driving.

Pitch: the point where two lines converge gives the pitch of the camera. The fit estimates its deviation δ
from the file in every frame and corrects for it; the check reports the mean of δ on straight roads.

Height: all lengths on the road scale with the height of the camera. If the height in the file is s times too
large, a bend of curvature κ is measured as κ/s. The yaw rate r and the speed v give the true bend: over all
bends, the turn ∫|r|dt over the measured turn ∫|κ|·v·dt is s. The prediction of the lane also uses the yaw
rate, which reduces the measured s − 1 to about two thirds.
"""

from dataclasses import dataclass

from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import KAPPA, PITCH, PSI, LaneState
from perception.lane.model.prediction import VehicleMotion
from trepid.config import Settings
from trepid.types import Positive

MAX_STEP_S = 0.25  # between two detections of the same lane


class CameraCheckSettings(Settings):
    """Section ``camera_check`` of ``config/perception.yaml``."""

    straight_1pm: Positive
    bent_1pm: Positive
    memory_s: Positive
    pitch_limit_rad: Positive
    least_turn_rad: Positive
    height_limit: Positive


@dataclass(frozen=True, slots=True)
class MountingError:
    """Deviation of the mounting from its file; None: not yet known."""

    pitch_rad: float | None  # positive: the camera points further down than in its file
    height_ratio: float | None  # height in the file over the true height, or closer to 1


class CameraCheck:
    """Estimates the mounting error of one camera, frame by frame."""

    def __init__(self, settings: CameraCheckSettings) -> None:
        self._settings = settings
        self._pitch_rad, self._straight_s = 0.0, 0.0
        self._turned_rad, self._measured_rad = 0.0, 0.0
        self._heading_rad: float | None = None

    def step(self, fit: LaneFit, motion: VehicleMotion, *, dt_s: float) -> None:
        """Adds a lane detected ``dt_s`` after the one before; only lanes with two lines count.

        After any other lane or a longer interval, the change of heading is no measure of the turn.
        """
        if fit.by_edges or fit.boundaries_seen < 2 or not 0 < dt_s < MAX_STEP_S:
            self._heading_rad = None
            return
        lane = fit.state
        self._add_pitch(lane, dt_s)
        before, self._heading_rad = self._heading_rad, float(lane.mean[PSI])
        if before is not None:
            self._add_turn(lane, self._heading_rad - before, motion, dt_s)

    def _add_pitch(self, lane: LaneState, dt_s: float) -> None:
        if abs(float(lane.mean[KAPPA])) < self._settings.straight_1pm:
            self._straight_s += dt_s
            share = dt_s / min(self._straight_s, self._settings.memory_s)
            self._pitch_rad += share * (float(lane.mean[PITCH]) - self._pitch_rad)

    def _add_turn(
        self, lane: LaneState, heading_change_rad: float, motion: VehicleMotion, dt_s: float
    ) -> None:
        curvature, (speed_mps, yaw_rate_radps) = float(lane.mean[KAPPA]), motion
        if speed_mps is None or yaw_rate_radps is None or abs(curvature) < self._settings.bent_1pm:
            return
        side = 1.0 if curvature > 0 else -1.0
        self._turned_rad += side * (yaw_rate_radps * dt_s - heading_change_rad)
        self._measured_rad += side * curvature * speed_mps * dt_s

    @property
    def error(self) -> MountingError:
        """The error as far as it is known."""
        enough = self._measured_rad > self._settings.least_turn_rad
        return MountingError(
            pitch_rad=self._pitch_rad if self._straight_s >= self._settings.memory_s / 2 else None,
            height_ratio=self._turned_rad / self._measured_rad if enough else None,
        )

    @property
    def reason(self) -> str:
        """One line that describes an error above the limits; empty without one."""
        pitch, ratio, found = self.error.pitch_rad, self.error.height_ratio, []
        if pitch is not None and abs(pitch) > self._settings.pitch_limit_rad:
            direction = "down" if pitch > 0 else "up"
            found.append(f"points {abs(pitch):.3f} rad further {direction} than in its file")
        if ratio is not None and abs(ratio - 1) > self._settings.height_limit:
            found.append(f"is {'lower' if ratio > 1 else 'higher'} than in its file")
        return "the camera " + " and ".join(found) if found else ""
