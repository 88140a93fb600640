"""The lane between frames: prediction with the motion of the vehicle (inventory T01)."""

import math
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from perception.lane.model.geometry import KAPPA, KAPPA_RATE, PITCH, PSI, E, LaneState
from perception.lane.model.prior import PriorSettings
from trepid.car.camera import Camera
from trepid.clothoid import Lane, advance_clothoid
from trepid.config import Settings
from trepid.messages import VehicleState
from trepid.types import Array, NonNegative, Positive, PositiveShare, Share

MAX_SPEED_MPS = (
    100.0  # a state beyond it, or beyond the next one, is none (supervisor.yaml has the same limits)
)
MAX_YAW_RATE_RADPS = 5.0


class TrackSettings(Settings):
    """Section ``track`` of ``config/perception.yaml``: process noise, limits of the memory, gates of a match."""

    offset_noise_m_per_sqrt_m: Positive
    heading_noise_rad_per_sqrt_m: Positive
    curvature_noise_1pm_per_sqrt_m: Positive
    curvature_rate_noise_1pm2_per_sqrt_m: Positive
    width_noise_m_per_sqrt_m: Positive
    blind_speed_mps: Positive
    blind_heading_noise_rad_per_sqrt_s: Positive
    pitch_memory_s: Positive
    curvature_rate_memory_m: Positive
    max_coast_s: Positive
    max_shown_s: Positive
    coast_decay_s: Positive
    coast_decay_m: Positive
    gate_offset_m: Positive
    gate_heading_rad: Positive
    edge_gate_offset_m: Positive
    edge_gate_heading_rad: Positive
    edge_gate_width_m: Positive
    hold_m: Positive
    confirm_looks: Annotated[int, Field(ge=1)]
    lines_every: Annotated[int, Field(ge=1)]
    rival_every: Annotated[int, Field(ge=2)]
    rival_margin: Share
    second_every: Annotated[int, Field(ge=1)]
    second_looks: Annotated[float, Field(ge=1)]
    second_lines: Annotated[float, Field(ge=1)]
    second_gate_m: Positive
    second_enough: PositiveShare
    vertical_curvature_1pm: NonNegative


class VehicleMotion(NamedTuple):
    """Speed and yaw rate of the vehicle; None where they are not known."""

    speed_mps: float | None
    yaw_rate_radps: float | None

    @classmethod
    def of(cls, state: VehicleState | None) -> "VehicleMotion":
        """The motion that ``state`` reports, without values that no vehicle has."""
        if state is None:
            return cls(None, None)
        return cls(
            _possible(state.speed_mps, MAX_SPEED_MPS), _possible(state.yaw_rate_radps, MAX_YAW_RATE_RADPS)
        )


def _possible(value: float | None, limit: float) -> float | None:
    return value if value is not None and abs(value) <= limit else None


def travelled_distance_m(motion: VehicleMotion, dt_s: float, track: TrackSettings) -> float:
    """Distance [m] driven in ``dt_s``; at ``blind_speed_mps`` where the speed is not known."""
    return (track.blind_speed_mps if motion.speed_mps is None else abs(motion.speed_mps)) * dt_s


def predict(
    state: LaneState, dt_s: float, motion: VehicleMotion, *, track: TrackSettings, prior: PriorSettings
) -> LaneState:
    """The lane ``dt_s`` later: e' = v·sinψ, ψ' = r − v·κ0, κ0' = v·κ', κ' and δ fade (Dickmanns 1992).

    With an unknown speed nothing moves, but the noise is that of ``blind_speed_mps``; an unknown yaw rate
    keeps ψ.
    """
    speed_mps, yaw_rate_radps = motion
    travelled = 0.0 if speed_mps is None else abs(speed_mps) * dt_s
    noise_m = travelled_distance_m(motion, dt_s, track)
    mean = state.mean.copy()
    turned = yaw_rate_radps * dt_s if yaw_rate_radps is not None else mean[KAPPA] * travelled
    fade = math.exp(-travelled / track.curvature_rate_memory_m)
    settle = math.exp(-dt_s / track.pitch_memory_s)
    mean[[E, PSI, KAPPA]] = advance_clothoid(
        *mean[[E, PSI, KAPPA, KAPPA_RATE]], way_m=travelled, turned_rad=turned, sin=math.sin
    )
    mean[KAPPA_RATE] *= fade
    mean[PITCH] *= settle
    transition = np.eye(6)
    transition[E, PSI] = travelled
    transition[PSI, KAPPA] = -travelled
    transition[KAPPA, KAPPA_RATE] = travelled
    transition[KAPPA_RATE, KAPPA_RATE] = fade
    transition[PITCH, PITCH] = settle
    covariance = transition @ state.covariance @ transition.T
    noise = _process_noise(noise_m, dt_s, yaw_rate_radps, track)
    noise[PITCH] = prior.pitch_sigma_rad**2 * (1 - settle**2)
    covariance[np.diag_indices(6)] += noise
    return LaneState(mean=mean, covariance=covariance)


def unseen_variance_m2(ahead_m: Array, end_m: float, track: TrackSettings) -> Array:
    """Variance [m²] that the place of the lane gains at ``ahead_m`` beyond ``end_m``, where no pixel shows it.

    The rate of the curvature changes there as it does between frames, by white noise of the density q =
    ``curvature_rate_noise_1pm2_per_sqrt_m``². A change at a distance u before a place moves the place by u³/6, so
    that over d = ``ahead_m`` − ``end_m`` it gains q·∫(u³/6)² du = q·d⁷/252.
    """
    beyond_m = np.maximum(ahead_m - end_m, 0.0)
    return np.asarray(track.curvature_rate_noise_1pm2_per_sqrt_m**2 * beyond_m**7 / 252)


def grade_variance_m2(ahead_m: Array, lane: Lane, camera: Camera, track: TrackSettings) -> Array:
    """Variance [m²] of the place of ``lane`` at ``ahead_m``, because the ground ahead may rise or fall.

    On ground of the vertical curvature κ_v a point x from the lens is κ_v·x²/2 high, and with the height H of the
    lens it has the pixel of flat ground at s·x, s·y, s - 1 = κ_v·x²/(2·H). The lane y(x), as it is seen from the
    lens, moves by (s - 1)·(y - x·y') there; κ_v has the deviation ``vertical_curvature_1pm``. A straight lane that
    the lens is in the middle of stays where it is on every hill. The clothoid of a lane that turns back is none:
    |y - x·y'| counts up to x.
    """
    x_m = np.maximum(ahead_m - camera.x_m, 0.0)
    slope = np.array([lane.slope_at(at_m) for at_m in ahead_m])
    aside_m = np.array([lane.y_m(at_m) for at_m in ahead_m]) - camera.y_m - x_m * slope
    aside_m = np.clip(aside_m, -x_m, x_m)
    return np.asarray((track.vertical_curvature_1pm * x_m**2 / (2 * camera.height_m) * aside_m) ** 2)


def steady(lane: LaneState) -> LaneState:
    """``lane`` with a constant bend: the rate of the bend is the least certain part of a lane just lost."""
    mean = lane.mean.copy()
    mean[KAPPA_RATE] = 0.0
    return LaneState(mean=mean, covariance=lane.covariance)


def _process_noise(noise_m: float, dt_s: float, yaw_rate_radps: float | None, track: TrackSettings) -> Array:
    """Variances added over ``noise_m`` of travel and ``dt_s``, shape (6,); 0 for δ."""
    heading = track.heading_noise_rad_per_sqrt_m**2 * noise_m
    if yaw_rate_radps is None:
        heading += track.blind_heading_noise_rad_per_sqrt_s**2 * dt_s
    return np.array(
        [
            track.offset_noise_m_per_sqrt_m**2 * noise_m,
            heading,
            track.curvature_noise_1pm_per_sqrt_m**2 * noise_m,
            track.curvature_rate_noise_1pm2_per_sqrt_m**2 * noise_m,
            track.width_noise_m_per_sqrt_m**2 * noise_m,
            0.0,
        ]
    )
