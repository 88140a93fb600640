"""Lateral control by LQI: feed-forward of the bend, optimal feedback of what is left, scheduled over speed.

The lane passed in is the one at the moment the command begins to act, so the dead time is over; what is left are
the lag τ of the steering and T of the tyres (`controller.model.tyres`). In lateral accelerations, for small errors,

    z' = e    e' = w    w' = p    T·p' = q - p    τ·q' = u - q

z integral of the offset, e offset, w = v·sin χ sideways speed (χ course error), p = v²·(κ_path - κ) and
q = v²·(κ_wheel - κ(s + v·T)) what path and wheel bend more than the lane, u = v²·(κ_cmd - κ_ff) the feedback. A lag
of zero takes its state away. κ_ff = κ(s + v·(T + τ)) undoes both lags on a clothoid. The gains of u = -K·x minimise

    ∫ e² + (d·w/ω)² + (i·ω·z)² + u²/ω⁴ dt

ω is the bandwidth, d raises the damping, and without integral and lags the poles are those of
s² + √(2 + d²)·ω·s + ω². Like the pole placement of :mod:`controller.laws.feedforward` it is ω = min(ω_t, ω_s·v),
slowed down further until the margins asked for hold with the prediction over the dead time in the loop
(:mod:`controller.laws.lqr`): a vehicle file with slow steering gets a slow loop, never an unstable one.

Far from the centre, with r = |e| + |w|·k_w/k_e above r₀, the bandwidth falls by r₀/r, to a least one: a wheel
whose jerk is limited cannot follow large errors as quickly as small ones (low-and-high gain: Lin and Saberi, IEEE
Trans. Automatic Control 40 (1995)).

The integral is bounded, stands still when r is above r₀, and is forgotten when a driver steers. Further off still,
the car comes back along a straight line at the approach angle.

Anderson and Moore, Optimal Control (1990), sections 2.3 and 3.3; Hippe, Windup in Control (2006), chapter 2.
"""

import math
from functools import lru_cache
from itertools import pairwise
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from controller.laws.law import Acting
from controller.laws.lqr import Margins, gains, loop, margins
from controller.model.tyres import Tyres
from trepid.bounds import at_least, at_most, within
from trepid.clothoid import Lane
from trepid.config import Settings
from trepid.types import Array, NonNegative, Positive
from trepid.vehicle import Vehicle

SPEEDS_MPS = (0.5, 1.0, 2.0, 3.0, 5.0, 7.0, 10.0, 14.0, 20.0, 28.0, 40.0, 56.0, 80.0)
_SLOWER = 0.92  # by which the bandwidth falls until the margins hold
_MIN_SPEED_MPS = SPEEDS_MPS[0]
_SHORTEST_LAG_S = 1e-3  # a quicker lag is none
_OMEGA = np.geomspace(0.02, 200.0, 240)  # frequencies in bandwidths, on which margins are looked for


class MarginSettings(Settings):
    """``lateral.lqi.margins``: what the loop must bear before it is unstable."""

    gain_db: NonNegative
    phase_rad: Annotated[float, Field(ge=0, lt=math.pi / 2)]
    delay_s: NonNegative
    delay_share: NonNegative  # of dead time plus lags, on top


class LqiSettings(Settings):
    """``lateral.lqi`` in ``config/controller.yaml``."""

    bandwidth_radpm: Positive  # ω_s
    bandwidth_radps: Positive  # ω_t
    damping: NonNegative  # d
    integral: NonNegative  # i
    max_integral_mps2: NonNegative  # that the integral may ask for
    near_m: Positive  # r₀
    far_radps: Positive  # bandwidth far from the centre
    max_approach_rad: Annotated[float, Field(gt=0, lt=1.5)]
    max_approach_mps: Positive
    margins: MarginSettings


class Gains(NamedTuple):
    """u = -(integral·z + offset·e + sideways·w + path·p + wheel·q)."""

    integral_1ps3: float
    offset_1ps2: float
    sideways_1ps: float
    path: float
    wheel: float


class Design(NamedTuple):
    """The loop at one speed."""

    speed_mps: float
    bandwidth_radps: float
    gains: Gains
    margins: Margins


class Lags(NamedTuple):
    """What the loop has to live with."""

    dead_s: float
    steering_s: float
    tyres_s: float

    def noticeable(self) -> "Lags":
        """Without lags too short to matter, whose poles would only cost digits."""
        lasting = (lag_s if lag_s > _SHORTEST_LAG_S else 0.0 for lag_s in (self.steering_s, self.tyres_s))
        return Lags(self.dead_s, *lasting)


def model(lags: Lags) -> tuple[Array, Array, list[int]]:
    """A, B of (z, e, w, p, q), and which of the five states there are."""
    a = np.zeros((5, 5))
    b = np.zeros(5)
    states = [0, 1, 2]
    a[0, 1] = a[1, 2] = 1.0
    into, rate = 2, 1.0
    for state, lag_s in ((3, lags.tyres_s), (4, lags.steering_s)):
        if lag_s > 0.0:
            a[into, state] = rate
            a[state, state] = -1.0 / lag_s
            into, rate = state, 1.0 / lag_s
            states.append(state)
    b[into] = rate
    return a[np.ix_(states, states)], b[states], states


def design(speed_mps: float, lags: Lags, settings: LqiSettings) -> Design:
    """The quickest loop at ``speed_mps``, up to the bandwidth in ``settings``, that has the margins."""
    need, lags = settings.margins, lags.noticeable()
    least_s = need.delay_s + need.delay_share * sum(lags)
    omega = at_most(settings.bandwidth_radps, settings.bandwidth_radpm * speed_mps)
    while True:
        found = Design(speed_mps, omega, *_at(omega, lags, settings))
        has = found.margins
        if has.gain_db >= need.gain_db and has.phase_rad >= need.phase_rad and has.delay_s >= least_s:
            return found
        omega *= _SLOWER


def _at(omega: float, lags: Lags, settings: LqiSettings) -> tuple[Gains, Margins]:
    """Gains and margins at bandwidth ω. Time is counted in 1/ω, so that all numbers are near one."""
    scaled = Lags(*(omega * lag_s for lag_s in lags))
    a, b, states = model(scaled)
    weights = np.diag([settings.integral**2, 1.0, settings.damping**2, 0.0, 0.0])[np.ix_(states, states)]
    if settings.integral == 0.0:  # nothing asks for the integral then, and nothing would stabilise it
        a, b, weights, states = a[1:, 1:], b[1:], weights[1:, 1:], states[1:]
    k = gains(a, b, weights, 1.0)
    found = margins(loop(a, b, k, scaled.dead_s, _OMEGA), _OMEGA)
    full = np.zeros(5)
    full[states] = k * omega ** np.array([3.0, 2.0, 1.0, 0.0, 0.0])[states]
    return Gains(*full.tolist()), found._replace(delay_s=found.delay_s / omega)


@lru_cache(maxsize=64)
def schedule(
    dead_s: float, steering_s: float, tyres_s: tuple[float, ...], settings: LqiSettings
) -> tuple[Design, ...]:
    """A design at each of ``SPEEDS_MPS``."""
    return tuple(
        design(speed_mps, Lags(dead_s, steering_s, lag_s), settings)
        for speed_mps, lag_s in zip(SPEEDS_MPS, tyres_s, strict=True)
    )


class Lqi:
    """The law."""

    def __init__(self, settings: LqiSettings, vehicle: Vehicle, *, command_delay_s: float) -> None:
        """``command_delay_s``: on the way to the actuator, mean hold of the command included."""
        self._settings = settings
        self._tyres = Tyres(vehicle)
        self._lag_s = vehicle.steering_lag_s
        self.designs = schedule(
            command_delay_s + vehicle.steering_delay_s,
            vehicle.steering_lag_s,
            tuple(self._tyres.lag_s(speed_mps) for speed_mps in SPEEDS_MPS),
            settings,
        )
        self._integral_mps2 = 0.0  # what the integral asks for

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """κ_cmd [1/m]."""
        lane, speed_mps = at.lane, at_least(abs(at.speed_mps), _MIN_SPEED_MPS)
        sideways_mps = speed_mps * math.sin(lane.heading_rad)
        gain = self._gains(speed_mps)
        far_m = abs(lane.offset_m) + abs(sideways_mps) * gain.sideways_1ps / gain.offset_1ps2
        if far_m <= self._settings.near_m:
            self._integrate(gain, lane.offset_m, dt_s)
        else:
            gain = self._softened(gain, self._settings.near_m / far_m)
        approach_mps = self._approach(gain, lane.offset_m, speed_mps)
        tyres_m, steering_m = self._tyres.lag_s(speed_mps) * at.speed_mps, self._lag_s * at.speed_mps
        beside, wheel_1pm = (self._bend(lane, ahead_m) for ahead_m in (0.0, tyres_m))
        ahead_1pm = self._bend(lane, tyres_m + steering_m)
        speed2 = speed_mps * speed_mps
        feedback_mps2 = (
            self._integral_mps2
            + gain.sideways_1ps * (sideways_mps + approach_mps)
            + gain.path * speed2 * (at.curvature_1pm - beside)
            + gain.wheel * speed2 * (at.steady_1pm - wheel_1pm)
        )
        return ahead_1pm - feedback_mps2 / speed2

    def release(self) -> None:
        """Forget the integral."""
        self._integral_mps2 = 0.0

    def _softened(self, gain: Gains, share: float) -> Gains:
        """``gain`` at ``share`` of its bandwidth, but no slower than far from the centre."""
        share = at_least(share, at_most(self._settings.far_radps / math.sqrt(gain.offset_1ps2), 1.0))
        return gain._replace(
            offset_1ps2=share * share * gain.offset_1ps2, sideways_1ps=share * gain.sideways_1ps
        )

    def _bend(self, lane: Lane, ahead_m: float) -> float:
        """Curvature that keeps the distance to the lane ``ahead_m`` from here."""
        return lane.path_curvature(lane.curvature_at(at_least(ahead_m, 0.0)))

    def _approach(self, gain: Gains, offset_m: float, speed_mps: float) -> float:
        """The sideways speed back to the centre that ``offset_m`` asks for, within the approach angle."""
        most_mps = at_most(
            speed_mps * math.sin(self._settings.max_approach_rad), self._settings.max_approach_mps
        )
        return within(gain.offset_1ps2 / gain.sideways_1ps * offset_m, most_mps)

    def _integrate(self, gain: Gains, offset_m: float, dt_s: float) -> None:
        step_mps2 = gain.integral_1ps3 * offset_m * dt_s
        self._integral_mps2 = within(self._integral_mps2 + step_mps2, self._settings.max_integral_mps2)

    def _gains(self, speed_mps: float) -> Gains:
        """Interpolated between the speeds of the schedule."""
        for slow, fast in pairwise(self.designs):
            if speed_mps <= fast.speed_mps:
                share = (speed_mps - slow.speed_mps) / (fast.speed_mps - slow.speed_mps)
                return Gains(*[a + share * (b - a) for a, b in zip(slow.gains, fast.gains, strict=True)])
        return self.designs[-1].gains
