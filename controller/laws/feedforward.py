"""Lateral control: lane to path curvature, by feed-forward of the lane's bend and feedback of offset and heading.

The lane passed in is the one at the moment the command begins to act (:mod:`controller.prediction`), so the
loop has no dead time, only the lag τ of steering and tyres. Along the travelled path s (not time) and for
small errors

    e' = ψ        ψ' = κ_a - κ        T·κ_a' = κ_cmd - κ_a        T = v·τ [m], ' = d/ds

Feed-forward κ_ff = κ(s + T) undoes the lag of a clothoid exactly (a ramp comes out of a first-order lag one T
late). With κ_cmd = κ_ff - k_e·e - k_ψ·sin ψ the error obeys T·e''' + e'' + k_ψ·e' + k_e·e = 0. Comparing with
T·(s + p)(s² + 2ζω·s + ω²) gives

    p = 1/T - 2ζω        k_e = a·ω²        k_ψ = a·2ζω + T·ω²        a = p·T = 1 - 2ζωT

All three poles lie in the open left half-plane exactly for ω > 0, ζ > 0 and a > 0. The bandwidth

    ω = min(ω_s, ω_t/v, 1/(4ζT)) [rad/m]

keeps a ≥ 1/2 at any speed and lag. ω_s makes the path independent of speed when slow (no singularity at v = 0);
ω_t caps the bandwidth in time when fast. Gains that are constant in time grow with v² and leave the lane at speed.

The offset is limited to the value that demands the largest approach angle ψ_max: a car far from the centre returns
along a straight line at that angle instead of turning across the lane.

Rajamani, Vehicle Dynamics and Control (2012), sections 2.5 and 3.1; Franklin et al., Feedback Control of Dynamic
Systems (2015), section 7.5 (pole placement).
"""

import math
from typing import Annotated, NamedTuple

from pydantic import Field

from controller.laws.law import Acting, LateralLaw
from controller.model.tyres import Tyres
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.config import Settings
from trepid.types import Positive

_MIN_SPEED_MPS = 0.1  # avoids a division by zero; ω_s is the smaller bandwidth there


class FeedforwardSettings(Settings):
    """``lateral.feedforward`` in ``config/controller.yaml``."""

    bandwidth_radpm: Positive  # ω_s
    bandwidth_radps: Positive  # ω_t
    damping: Annotated[float, Field(ge=0.5, le=2.0)]  # ζ
    max_approach_rad: Annotated[float, Field(gt=0, lt=1.5)]  # ψ_max when slow
    max_approach_mps: Positive  # lateral speed that ψ_max may reach when fast


class Gains(NamedTuple):
    """κ_cmd = κ_ff - offset·e - heading·sin ψ."""

    offset_1pm2: float  # k_e
    heading_1pm: float  # k_ψ


class Feedforward(LateralLaw):
    """The law; it has no state."""

    def __init__(self, settings: FeedforwardSettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._lag_s = vehicle.steering_lag_s
        self._tyres = Tyres(vehicle)

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """κ_cmd [1/m]."""
        lag_s = self._lag_s + self._tyres.lag_s(at.speed_mps)
        return path_curvature(at.lane, speed_mps=at.speed_mps, lag_s=lag_s, settings=self._settings)


def gains(speed_mps: float, *, lag_s: float, settings: FeedforwardSettings) -> Gains:
    """Gains that put the poles of the loop, lag included, at the scheduled bandwidth and damping."""
    speed_mps = at_least(abs(speed_mps), _MIN_SPEED_MPS)
    lag_m, damping = speed_mps * lag_s, settings.damping
    bandwidth = at_most(settings.bandwidth_radps / speed_mps, settings.bandwidth_radpm)
    if lag_m > 0.0:
        bandwidth = at_most(0.25 / (damping * lag_m), bandwidth)
    share = 1.0 - 2.0 * damping * bandwidth * lag_m
    return Gains(
        offset_1pm2=share * bandwidth**2,
        heading_1pm=share * 2.0 * damping * bandwidth + lag_m * bandwidth**2,
    )


def path_curvature(lane: Lane, *, speed_mps: float, lag_s: float, settings: FeedforwardSettings) -> float:
    """Demanded curvature κ_cmd [1/m] for ``lane`` at the moment the command acts."""
    gain = gains(speed_mps, lag_s=lag_s, settings=settings)
    ahead_m = at_least(speed_mps, 0.0) * lag_s
    feedforward = lane.path_curvature(lane.curvature_at(ahead_m))
    approach = gain.offset_1pm2 / gain.heading_1pm * lane.offset_m
    approach = within(approach, math.sin(_max_approach(speed_mps, settings)))
    return feedforward - gain.heading_1pm * (math.sin(lane.heading_rad) + approach)


def _max_approach(speed_mps: float, settings: FeedforwardSettings) -> float:
    """ψ_max [rad], at which the lateral speed v·sin ψ stays within its limit."""
    speed_mps = at_least(abs(speed_mps), settings.max_approach_mps)
    return at_most(math.asin(settings.max_approach_mps / speed_mps), settings.max_approach_rad)
