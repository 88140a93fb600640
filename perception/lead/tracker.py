"""Vehicles and people over time: a Kalman filter for each, in a frame that stands still on the road.

The own motion is taken out by odometry (speed and yaw rate of the vehicle), so that a track holds where a vehicle
is on the ground and how fast it moves there. With p = (x, y) and v = (ẋ, ẏ) in the odometry frame,

    p' = p + v·dt,   v' = v + w,   w white: Q = S·[[dt³/3, dt²/2], [dt²/2, dt]],  S = a² per axis
    z = p + n,       R = T·diag((ρ_r·r)² + ρ_0², (ρ_b·r)² + ρ_1²)·Tᵀ,   T turns to the line of sight

that is, the range is known to a share of itself, and across the line of sight the bearing counts (Bar-Shalom, Li
and Kirubarajan, Estimation with Applications to Tracking and Navigation (2001), sections 6.2.2 and 10.4). Whether
there is a vehicle is a log-odds that grows with the score of every detection and falls with every miss (Thrun,
Burgard and Fox, Probabilistic Robotics (2005), section 4.2).

That sum takes the frames for independent. A detector that is unsure of a vehicle is so in many frames, because its
picture is nearly the same in all of them: in rain a van got 0.05 to 0.4 for 4 s, at 26 to 6 m. Where a vehicle was
sure for ``sure_s``, an unsure detection at the place to which it is predicted therefore says nothing for or against
it, since hardly any would be there without it, and one below ``unsure_confidence`` counts as a miss.
"""

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lead.detection import Detection
from trepid.config import Settings
from trepid.types import OpenShare, Positive

Vector = NDArray[np.float64]
EYE = np.eye(4)


class TrackSettings(Settings):
    """Section ``track`` of ``config/lead.yaml``."""

    range_sigma: Positive  # ρ_r, share of the distance
    range_floor_m: Positive  # ρ_0
    bearing_sigma_rad: Positive  # ρ_b
    aside_floor_m: Positive  # ρ_1
    accel_mps2: Positive  # a
    first_speed_sigma_mps: Positive  # of a new track: it may stand or be oncoming
    gate_sigmas: Positive
    miss_log_odds: Annotated[float, Field(lt=0)]
    max_log_odds: Positive
    lost_log_odds: float  # a track below this is dropped
    new_confidence: Annotated[float, Field(gt=0, lt=1)]  # least confidence of a detection that starts a track
    max_coast_s: Positive
    sure_s: Positive  # time of full confidence, from which on a vehicle is sure
    unsure_confidence: OpenShare  # of a sure vehicle: a detection from here to an even chance says nothing


class Track:
    """One vehicle: (x, y, ẋ, ẏ) of its nearer end in the odometry frame."""

    def __init__(
        self, at: Vector, noise: Vector, speed_mps: Vector, width_m: float, settings: TrackSettings
    ) -> None:
        self._settings = settings
        self.state = np.concatenate([at, speed_mps])
        self.covariance = np.zeros((4, 4))
        self.covariance[:2, :2] = noise
        self.covariance[2:, 2:] = settings.first_speed_sigma_mps**2 * np.eye(2)
        self.width_m = width_m
        self.kind = ""
        self.log_odds = 0.0
        self.unseen_s = self._sure_s = 0.0

    @property
    def confidence(self) -> float:
        """Probability that the vehicle exists."""
        return 1 / (1 + math.exp(-self.log_odds))

    @property
    def speed_sigma_mps(self) -> float:
        """Largest standard deviation of the speed."""
        return float(math.sqrt(np.linalg.eigvalsh(self.covariance[2:, 2:])[-1]))

    def aside_sigma_mps(self, turn: Vector) -> float:
        """Standard deviation of the speed across the axis of a vehicle whose frame is turned by ``turn``."""
        return float(math.sqrt((turn.T @ self.covariance[2:, 2:] @ turn)[1, 1]))

    def predict(self, dt_s: float) -> None:
        """Predict by ``dt_s`` at constant velocity."""
        if dt_s <= 0:
            return
        step = EYE.copy()
        step[0, 2] = step[1, 3] = dt_s
        power = self._settings.accel_mps2**2
        noise = np.kron([[dt_s**3 / 3, dt_s**2 / 2], [dt_s**2 / 2, dt_s]], power * np.eye(2))
        self.state = step @ self.state
        self.covariance = step @ self.covariance @ step.T + noise
        self.unseen_s += dt_s
        if self.log_odds >= self._settings.max_log_odds:
            self._sure_s += dt_s

    def surprise(self, at: Vector, noise: Vector) -> float:
        """Mahalanobis distance of a detection [sigmas]."""
        off = at - self.state[:2]
        return float(math.sqrt(off @ np.linalg.solve(self.covariance[:2, :2] + noise, off)))

    def correct(self, at: Vector, noise: Vector, detection: Detection) -> None:
        """Update with a detection (Joseph's form keeps the covariance symmetric and positive)."""
        gain = np.linalg.solve(self.covariance[:2, :2] + noise, self.covariance[:2]).T
        self.state = self.state + gain @ (at - self.state[:2])
        kept = EYE.copy()
        kept[:, :2] -= gain
        self.covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        self.width_m += 0.1 * (detection.width_m - self.width_m)
        self.kind = detection.kind
        self._believe(self._evidence(detection.confidence))
        self.unseen_s = 0.0

    def _evidence(self, confidence: float) -> float:
        """Log-odds that a detection at the place of the vehicle adds."""
        evidence, settings = math.log(confidence / (1 - confidence)), self._settings
        if self._sure_s < settings.sure_s:
            return evidence
        return max(evidence, 0.0 if confidence >= settings.unsure_confidence else settings.miss_log_odds)

    def miss(self) -> None:
        """Lower the existence after a frame without a detection."""
        self._believe(self._settings.miss_log_odds)

    def _believe(self, log_odds: float) -> None:
        limit = self._settings.max_log_odds
        self.log_odds = min(max(self.log_odds + log_odds, -limit), limit)


class Odometry:
    """Ego pose in the frame of the first step: the chord of an arc for each step."""

    def __init__(self) -> None:
        self.x_m = self.y_m = self.yaw_rad = 0.0

    def move(self, speed_mps: float, yaw_rate_radps: float, dt_s: float) -> None:
        """Move the ego vehicle for ``dt_s``."""
        middle_rad = self.yaw_rad + yaw_rate_radps * dt_s / 2
        self.x_m += speed_mps * dt_s * math.cos(middle_rad)
        self.y_m += speed_mps * dt_s * math.sin(middle_rad)
        self.yaw_rad += yaw_rate_radps * dt_s

    @property
    def turn(self) -> Vector:
        """Rotation from the vehicle frame to the odometry frame."""
        cos, sin = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return np.array([[cos, -sin], [sin, cos]])

    def from_vehicle(self, x_m: float, y_m: float) -> Vector:
        """A point of the vehicle frame in the odometry frame."""
        return self.turn @ (x_m, y_m) + (self.x_m, self.y_m)

    def to_vehicle(self, point: Vector) -> Vector:
        """A point of the odometry frame in the vehicle frame."""
        return np.asarray(self.turn.T @ (point - (self.x_m, self.y_m)))


class Tracker:
    """The tracks of all detected vehicles."""

    def __init__(self, settings: TrackSettings, *, eye_m: float, at_rest: bool = False) -> None:
        """``eye_m``: distance of the camera ahead of the rear axle. ``at_rest``: new tracks stand on the road."""
        self._settings, self._eye_m, self._at_rest = settings, eye_m, at_rest
        self.odometry = Odometry()
        self.tracks: list[Track] = []

    def step(
        self, detections: Sequence[Detection], *, speed_mps: float, yaw_rate_radps: float, dt_s: float
    ) -> None:
        """Predict by ``dt_s`` and update with ``detections``, given in falling order of confidence."""
        self.odometry.move(speed_mps, yaw_rate_radps, dt_s)
        for track in self.tracks:
            track.predict(dt_s)
        free = list(self.tracks)
        for detection in detections:
            at, noise = self._measurement(detection)
            surprises = [track.surprise(at, noise) for track in free]
            nearest = int(np.argmin(surprises)) if free else None
            if nearest is not None and surprises[nearest] <= self._settings.gate_sigmas:
                free.pop(nearest).correct(at, noise, detection)
            elif detection.confidence >= self._settings.new_confidence:
                self._begin(at, noise, detection, speed_mps)
        for track in free:
            track.miss()
        self.tracks = [track for track in self.tracks if self._lives(track)]

    def _begin(self, at: Vector, noise: Vector, detection: Detection, speed_mps: float) -> None:
        """A new track at the speed of the ego vehicle, or at rest; half of that speed is within its deviation."""
        first_mps = 0.0 if self._at_rest else speed_mps
        own = self.odometry.turn @ (first_mps, 0.0)
        track = Track(at, noise, own, detection.width_m, self._settings)
        track.covariance[2:, 2:] *= max(abs(first_mps) / 2 / self._settings.first_speed_sigma_mps, 1.0) ** 2
        track.kind = detection.kind
        track.log_odds = math.log(detection.confidence / (1 - detection.confidence))
        self.tracks.append(track)

    def _measurement(self, detection: Detection) -> tuple[Vector, Vector]:
        """Place and covariance of a detection in the odometry frame."""
        s = self._settings
        ahead_m = max(detection.ahead_m - self._eye_m, 0.1)
        range_m, bearing_rad = math.hypot(ahead_m, detection.left_m), math.atan2(detection.left_m, ahead_m)
        own_m = s.range_sigma * range_m if detection.ahead_sigma_m is None else detection.ahead_sigma_m
        along = own_m**2 + s.range_floor_m**2
        across = (s.bearing_sigma_rad * range_m) ** 2 + s.aside_floor_m**2
        cos, sin = (f(bearing_rad + self.odometry.yaw_rad) for f in (math.cos, math.sin))
        sight = np.array([[cos, -sin], [sin, cos]])
        return (
            self.odometry.from_vehicle(detection.ahead_m, detection.left_m),
            sight @ np.diag([along, across]) @ sight.T,
        )

    def _lives(self, track: Track) -> bool:
        behind = self.odometry.to_vehicle(track.state[:2])[0] <= self._eye_m
        s = self._settings
        return not behind and track.log_odds > s.lost_log_odds and track.unseen_s <= s.max_coast_s
