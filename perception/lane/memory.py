"""The lane between frames: prediction with the motion of the vehicle, memory with growing doubt (inventory T01)."""

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from perception.lane.fit import KAPPA, KAPPA_RATE, PITCH, PSI, WIDTH, E, LaneState, solved
from trepid.clothoid import advanced
from trepid.config import Settings
from trepid.types import Array, Positive

BEND = slice(KAPPA, KAPPA_RATE + 1)


class PriorSettings(Settings):
    """Section ``prior``: what is known of a lane before the first look, as mean 0 ± sigma unless said."""

    offset_sigma_m: Positive
    heading_sigma_rad: Positive
    curvature_sigma_1pm: Positive
    curvature_rate_sigma_1pm2: Positive
    straight_curvature_sigma_1pm: Positive
    straight_curvature_rate_sigma_1pm2: Positive
    width_m: Positive
    width_sigma_m: Positive
    shoulder_m: Annotated[float, Field(ge=0)]
    shoulder_sigma_m: Positive
    road_width_m: Positive
    road_width_sigma_m: Positive
    pitch_sigma_rad: Positive

    @property
    def bend_sigma(self) -> tuple[float, float]:
        """Of (κ0, κ') on any road."""
        return self.curvature_sigma_1pm, self.curvature_rate_sigma_1pm2

    @property
    def straight_bend_sigma(self) -> tuple[float, float]:
        """Of (κ0, κ') on a road that does not bend."""
        return self.straight_curvature_sigma_1pm, self.straight_curvature_rate_sigma_1pm2


class TrackSettings(Settings):
    """Section ``track``: how a lane may change while driving, and how long it is believed unseen."""

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
    coast_decay_s: Positive
    gate_offset_m: Positive
    gate_heading_rad: Positive
    edge_gate_offset_m: Positive
    edge_gate_heading_rad: Positive
    edge_gate_width_m: Positive
    hold_m: Positive
    confirm_looks: Annotated[int, Field(ge=1)]
    rival_every: Annotated[int, Field(ge=1)]
    rival_margin: Annotated[float, Field(ge=0, le=1)]


def prior_state(settings: PriorSettings, *, width_m: float, width_sigma_m: float) -> LaneState:
    """The lane before the first look: straight ahead, centred, as wide as lanes are."""
    mean = np.zeros(6)
    mean[WIDTH] = width_m
    sigma = np.array(
        [
            settings.offset_sigma_m,
            settings.heading_sigma_rad,
            *settings.bend_sigma,
            width_sigma_m,
            settings.pitch_sigma_rad,
        ]
    )
    return LaneState(mean=mean, covariance=np.diag(sigma**2))


def straightened(state: LaneState, settings: PriorSettings) -> LaneState:
    """The prior ``state`` for a road that does not bend."""
    sigma = np.sqrt(np.diag(state.covariance))
    sigma[BEND] = settings.straight_bend_sigma
    return LaneState(mean=state.mean, covariance=np.diag(sigma**2))


def looks_straight(state: LaneState, settings: PriorSettings, *, log_odds: float) -> bool:
    """Whether a road that does not bend explains ``state`` better than one that may.

    Of both is foreseen m = (κ0, κ') ~ N(0, S), and seen with the covariance P of ``state``: the log density of m
    under N(0, P + S) of the straight road, and ``log_odds`` more, against the other's (MacKay 2003, chapter 28).
    """
    straight, bent = settings.straight_bend_sigma, settings.bend_sigma
    return _bend_log_density(state, straight) + log_odds > _bend_log_density(state, bent)


def _bend_log_density(state: LaneState, sigma: tuple[float, float]) -> float:
    """log N((κ0, κ'); 0, P + S) but for a constant, with the standard deviations ``sigma`` of S."""
    bend, rate = state.mean[BEND].tolist()
    (of_bend, shared), (_, of_rate) = state.covariance[BEND, BEND].tolist()
    of_bend, of_rate = of_bend + sigma[0] ** 2, of_rate + sigma[1] ** 2
    determinant = of_bend * of_rate - shared**2
    misfit = (bend**2 * of_rate - 2 * bend * rate * shared + rate**2 * of_bend) / determinant
    return float(-0.5 * (misfit + math.log(determinant)))


def on_straight(state: LaneState, settings: PriorSettings) -> LaneState:
    """``state`` where the road is known not to bend: a Kalman update with (κ0, κ') seen as 0 ± the straight sigmas.

    What the bend was taken for goes to the heading and the offset that it was traded for.
    """
    by_bend = state.covariance[:, BEND]
    gain = solved(by_bend[BEND] + np.diag(np.square(settings.straight_bend_sigma)), by_bend.T).T
    covariance = state.covariance - gain @ by_bend.T
    return LaneState(mean=state.mean - gain @ state.mean[BEND], covariance=(covariance + covariance.T) / 2)


def predict(
    state: LaneState,
    dt_s: float,
    *,
    speed_mps: float | None,
    yaw_rate_radps: float | None,
    track: TrackSettings,
    prior: PriorSettings,
) -> LaneState:
    """The lane ``dt_s`` later: e' = v·sinψ, ψ' = r − v·κ0, κ0' = v·κ', κ' and δ fade (Dickmanns 1992).

    An unknown speed moves nothing and counts as ``blind_speed_mps`` of doubt; an unknown yaw rate keeps ψ.
    """
    travelled = 0.0 if speed_mps is None else abs(speed_mps) * dt_s
    doubt = track.blind_speed_mps * dt_s if speed_mps is None else travelled
    mean = state.mean.copy()
    turned = yaw_rate_radps * dt_s if yaw_rate_radps is not None else mean[KAPPA] * travelled
    fade = math.exp(-travelled / track.curvature_rate_memory_m)
    settle = math.exp(-dt_s / track.pitch_memory_s)
    mean[[E, PSI, KAPPA]] = advanced(
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
    covariance[np.diag_indices(6)] += _process_noise(doubt, dt_s, fade, settle, yaw_rate_radps, track, prior)
    return LaneState(mean=mean, covariance=covariance)


def held(road: LaneState, lane: LaneState) -> LaneState:
    """The lane ``lane`` keeps its offset and width but runs as ``road`` does."""
    own = np.array([E, WIDTH])
    mean, covariance = road.mean.copy(), road.covariance.copy()
    mean[own] = lane.mean[own]
    covariance[own, :] = covariance[:, own] = 0.0
    covariance[np.ix_(own, own)] = lane.covariance[np.ix_(own, own)]
    return LaneState(mean=mean, covariance=covariance)


def at_most_sigma(covariance: Array, index: int, sigma: float) -> Array:
    """``covariance`` with one standard deviation brought down to ``sigma`` where it is greater.

    D·P·D with a diagonal D: correlations stay, so that what was positive definite stays it.
    """
    shrink = np.ones(len(covariance))
    shrink[index] = min(1.0, sigma / math.sqrt(covariance[index, index]))
    return covariance * np.outer(shrink, shrink)


def with_own_sigma(covariance: Array, index: int, sigma: float) -> Array:
    """``covariance`` with one state known to ``sigma``, whatever the others are."""
    own = covariance.copy()
    own[index, :] = own[:, index] = 0.0
    own[index, index] = sigma**2
    return own


def steady(lane: LaneState) -> LaneState:
    """``lane`` with its bend held: the last points before it was lost tell least of all how the bend goes on."""
    mean = lane.mean.copy()
    mean[KAPPA_RATE] = 0.0
    return LaneState(mean=mean, covariance=lane.covariance)


def _process_noise(
    doubt_m: float,
    dt_s: float,
    fade: float,
    settle: float,
    yaw_rate_radps: float | None,
    track: TrackSettings,
    prior: PriorSettings,
) -> Array:
    """Variances added on the way; fading states settle at the sigma of the prior."""
    heading = track.heading_noise_rad_per_sqrt_m**2 * doubt_m
    if yaw_rate_radps is None:
        heading += track.blind_heading_noise_rad_per_sqrt_s**2 * dt_s
    return np.array(
        [
            track.offset_noise_m_per_sqrt_m**2 * doubt_m,
            heading,
            track.curvature_noise_1pm_per_sqrt_m**2 * doubt_m,
            track.curvature_rate_noise_1pm2_per_sqrt_m**2 * doubt_m,
            track.width_noise_m_per_sqrt_m**2 * doubt_m,
            prior.pitch_sigma_rad**2 * (1 - settle**2),
        ]
    )
