"""The prior of a lane: its state before the first frame, on any road and on a straight one."""

import math

import numpy as np

from perception.lane.model.fit import solve_positive
from perception.lane.model.geometry import BEND, WIDTH, LaneState
from trepid.config import Settings
from trepid.types import NonNegative, Positive


class PriorSettings(Settings):
    """Section ``prior`` of ``config/perception.yaml``: standard deviations around a mean of 0, and widths."""

    offset_sigma_m: Positive
    heading_sigma_rad: Positive
    curvature_sigma_1pm: Positive
    curvature_rate_sigma_1pm2: Positive
    straight_curvature_sigma_1pm: Positive
    straight_curvature_rate_sigma_1pm2: Positive
    width_m: Positive
    width_sigma_m: Positive
    shoulder_m: NonNegative
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
        """Of (κ0, κ') on a straight road."""
        return self.straight_curvature_sigma_1pm, self.straight_curvature_rate_sigma_1pm2

    @property
    def lane(self) -> LaneState:
        """The prior of a lane between two lines."""
        return self._state(self.width_m, self.width_sigma_m)

    @property
    def road(self) -> LaneState:
        """The prior of a road between two edges."""
        return self._state(self.road_width_m, self.road_width_sigma_m)

    def _state(self, width_m: float, width_sigma_m: float) -> LaneState:
        """A straight lane with the vehicle in its centre."""
        mean = np.zeros(6)
        mean[WIDTH] = width_m
        place_sigma = self.offset_sigma_m, self.heading_sigma_rad
        sigma = np.array([*place_sigma, *self.bend_sigma, width_sigma_m, self.pitch_sigma_rad])
        return LaneState(mean=mean, covariance=np.diag(sigma**2))


def straight_prior(state: LaneState, settings: PriorSettings) -> LaneState:
    """The prior ``state`` for a straight road."""
    sigma = np.sqrt(np.diag(state.covariance))
    sigma[BEND] = settings.straight_bend_sigma
    return LaneState(mean=state.mean, covariance=np.diag(sigma**2))


def looks_straight(state: LaneState, settings: PriorSettings, *, log_odds: float) -> bool:
    """Whether a straight road explains ``state`` better than a road with curvature.

    Compares the log densities of m = (κ0, κ') under N(0, P + S), where P is the covariance of ``state`` and S
    that of the straight or the general prior; ``log_odds`` favour the straight road (MacKay 2003, chapter
    28).
    """
    straight, bent = settings.straight_bend_sigma, settings.bend_sigma
    return _bend_log_density(state, straight) + log_odds > _bend_log_density(state, bent)


def _bend_log_density(state: LaneState, sigma: tuple[float, float]) -> float:
    """log N((κ0, κ'); 0, P + S) up to a constant, with the standard deviations ``sigma`` of S."""
    bend, rate = state.mean[BEND].tolist()
    (of_bend, shared), (_, of_rate) = state.covariance[BEND, BEND].tolist()
    of_bend, of_rate = of_bend + sigma[0] ** 2, of_rate + sigma[1] ** 2
    determinant = of_bend * of_rate - shared**2
    misfit = (bend**2 * of_rate - 2 * bend * rate * shared + rate**2 * of_bend) / determinant
    return float(-0.5 * (misfit + math.log(determinant)))


def on_straight(state: LaneState, settings: PriorSettings) -> LaneState:
    """``state`` given that the road is straight: a Kalman update with (κ0, κ') measured as 0 ± the straight sigmas.

    The update moves heading and offset by their correlation with the bend.
    """
    by_bend = state.covariance[:, BEND]
    gain = solve_positive(by_bend[BEND] + np.diag(np.square(settings.straight_bend_sigma)), by_bend.T).T
    covariance = state.covariance - gain @ by_bend.T
    return LaneState(mean=state.mean - gain @ state.mean[BEND], covariance=(covariance + covariance.T) / 2)
