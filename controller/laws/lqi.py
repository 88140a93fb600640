"""Lateral control by LQI: feed-forward of the bend, optimal feedback of the error, gains scheduled over speed.

The lane passed in is the one at the moment the command begins to act, so the loop has no dead time, only the
lag τ of the steering and T of the tyres (`controller.model.tyres`). In lateral accelerations, for small errors,

    z' = e    e' = w    w' = p    T·p' = q - p    τ·q' = u - q

z integral of the offset, e offset, w = v·sin χ sideways speed (χ course error), p = v²·(κ_path - κ) and q =
v²·(κ_wheel - κ(s + v·T)) the excess of path and wheel over the lane, u = v²·(κ_cmd - κ_ff) the feedback. A lag of
zero takes its state away. κ_ff = κ(s + v·(T + τ)) undoes both lags on a clothoid. The gains of u = -K·x minimise

    ∫ e² + (d·w/ω)² + (i·ω·z)² + u²/ω⁴ dt

ω is the bandwidth, d raises the damping, and without integral and lags the poles are those of
s² + √(2 + d²)·ω·s + ω². Like the pole placement of :mod:`controller.laws.feedforward` it is ω = min(ω_t, ω_s·v),
lowered further until the demanded margins hold with the prediction over the dead time in the loop
(:mod:`controller.laws.lqi_design`): slow steering gives a slow loop, never an unstable one.

Far from the centre, with r = |e| + |w|·k_w/k_e above r₀, the bandwidth falls by r₀/r, to a least one: a wheel
whose jerk is limited cannot follow large errors as quickly as small ones (low-and-high gain: Lin and Saberi, IEEE
Trans. Automatic Control 40 (1995)).

The integral is bounded, held while r is above r₀, and reset when a driver steers. Farther from the centre the car
returns along a straight line at the approach angle.

Anderson and Moore, Optimal Control (1990), sections 2.3 and 3.3; Hippe, Windup in Control (2006), chapter 2.

A schedule of gains is computed once per vehicle, with python-control, whose import alone takes seconds. It is kept
in a folder of the user (:mod:`trepid.files.cache`) under a hash of all inputs of the computation: dead time, lags,
settings, the source of the design and the versions of the libraries.
"""

import json
import math
from functools import lru_cache
from importlib.metadata import version
from itertools import pairwise
from pathlib import Path

from controller.laws.law import Acting, LateralLaw
from controller.laws.lqi_settings import SPEEDS_MPS, Design, Gains, Lags, LqiSettings, Margins
from controller.model.tyres import Tyres
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.files.cache import cache_file, keep

_MIN_SPEED_MPS = SPEEDS_MPS[0]


class Lqi(LateralLaw):
    """The law."""

    def __init__(self, settings: LqiSettings, vehicle: Vehicle, *, command_delay_s: float) -> None:
        """``command_delay_s``: on the way to the actuator, mean hold of the command included."""
        self._settings = settings
        self._tyres = Tyres(vehicle)
        self._lag_s = vehicle.steering_lag_s
        dead_s = command_delay_s + vehicle.steering_delay_s
        self.lags = tuple(
            Lags(dead_s, vehicle.steering_lag_s, self._tyres.lag_s(speed_mps)) for speed_mps in SPEEDS_MPS
        )
        self.designs = schedule(self.lags, settings)
        self._integral_mps2 = 0.0  # demand of the integral

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """κ_cmd [1/m]."""
        lane, speed_mps = at.lane, at_least(abs(at.speed_mps), _MIN_SPEED_MPS)
        sideways_mps = speed_mps * math.sin(lane.heading_rad)
        gain = self._gains(speed_mps)
        far_m = abs(lane.offset_m) + abs(sideways_mps) * gain.sideways_1ps / gain.offset_1ps2
        if far_m <= self._settings.near_m:
            self._integrate(gain, lane.offset_m, dt_s)
        else:
            gain = self._soften(gain, self._settings.near_m / far_m)
        approach_mps = self._approach(gain, lane.offset_m, speed_mps)
        tyres_m, steering_m = self._tyres.lag_s(speed_mps) * at.speed_mps, self._lag_s * at.speed_mps
        here_1pm, wheel_1pm = (self._bend(lane, ahead_m) for ahead_m in (0.0, tyres_m))
        ahead_1pm = self._bend(lane, tyres_m + steering_m)
        speed2 = speed_mps * speed_mps
        feedback_mps2 = (
            self._integral_mps2
            + gain.sideways_1ps * (sideways_mps + approach_mps)
            + gain.path * speed2 * (at.curvature_1pm - here_1pm)
            + gain.wheel * speed2 * (at.steady_1pm - wheel_1pm)
        )
        return ahead_1pm - feedback_mps2 / speed2

    def release(self) -> None:
        """Reset the integral."""
        self._integral_mps2 = 0.0

    def _soften(self, gain: Gains, share: float) -> Gains:
        """``gain`` at ``share`` of its bandwidth, but no slower than far from the centre."""
        share = at_least(share, at_most(self._settings.far_radps / math.sqrt(gain.offset_1ps2), 1.0))
        offset_1ps2, sideways_1ps = share * share * gain.offset_1ps2, share * gain.sideways_1ps
        return gain._replace(offset_1ps2=offset_1ps2, sideways_1ps=sideways_1ps)

    def _bend(self, lane: Lane, ahead_m: float) -> float:
        """Curvature [1/m] that keeps the offset to the lane ``ahead_m`` ahead."""
        return lane.path_curvature(lane.curvature_at(at_least(ahead_m, 0.0)))

    def _approach(self, gain: Gains, offset_m: float, speed_mps: float) -> float:
        """Demanded sideways speed [m/s] back to the centre, within the approach angle."""
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


_SOURCES = ("lqi_design.py", "lqi_settings.py")


@lru_cache(maxsize=64)
def schedule(lags: tuple[Lags, ...], settings: LqiSettings) -> tuple[Design, ...]:
    """A design at each of ``SPEEDS_MPS``; ``lags``: dead time and lags at each."""
    path = _file(lags, settings)
    stored = _read(path)
    if stored is not None:
        return stored
    from controller.laws.lqi_design import design

    found = tuple(design(speed, lag, settings) for speed, lag in zip(SPEEDS_MPS, lags, strict=True))
    if path is not None:
        keep(path, json.dumps(found).encode())
    return found


def _file(lags: tuple[Lags, ...], settings: LqiSettings) -> Path | None:
    """Where the schedule is kept; None without a home folder."""
    sources = [(Path(__file__).parent / name).read_bytes().hex() for name in _SOURCES]
    versions = [version(name) for name in ("control", "numpy", "scipy")]
    key = json.dumps([SPEEDS_MPS, lags, settings.model_dump(mode="json"), sources, versions])
    return cache_file("gains", key, ".json")


def _read(path: Path | None) -> tuple[Design, ...] | None:
    """The stored schedule; None unless it is complete and finite."""
    try:
        rows = json.loads(path.read_text(encoding="utf-8")) if path is not None else None
        designs = tuple(
            Design(float(speed), float(bandwidth), Gains(*map(float, gains)), Margins(*map(float, margins)))
            for speed, bandwidth, gains, margins in rows or ()
        )
    except (OSError, ValueError, TypeError):
        return None
    finite = all(math.isfinite(one.bandwidth_radps + sum(one.gains)) for one in designs)
    return designs if finite and tuple(one.speed_mps for one in designs) == SPEEDS_MPS else None
