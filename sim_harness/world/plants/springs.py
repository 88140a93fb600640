"""Pitch and roll of a body on its springs, and so of the camera that it carries.

The forces of the tyres turn the body: with f_x ahead and f_y to the left, per mass, and the gains k of the springs

    pitch → -k_p·f_x + k_m·m        roll → k_r·f_y        θ'' = ω²·(θ_steady - θ) - 2·ζ·ω·θ'

Pitch is positive nose down, roll left side up (ISO 8855); m is the load, which lowers the end where it lies. On a
grade and on a bank f_x and f_y hold the weight, so that a parked car leans downhill. Over a speed hump the springs
and their dampers stand on axles with the pitch θ_a, and the equation holds for θ - θ_a. Between two instants the
forces and the rate of θ_a are constant and the equation has its closed solution.

Gillespie, Fundamentals of Vehicle Dynamics (1992): ride frequencies of 1 to 1.5 Hz with damping ratios of 0.2 to
0.4 (chapter 5), roll of 3 to 7 degrees at 1 g (chapter 6).
"""

import math
from dataclasses import dataclass

from pydantic import Field

from trepid.config import Settings
from trepid.types import NonNegative, OpenShare, Positive

MOST_RAD = 0.12  # of pitch and roll: the springs meet their stops


class Springs(Settings):
    """The springs of a body; the defaults are those of a small passenger car."""

    roll_gradient_rad_per_mps2: NonNegative = 0.0089  # 5 deg/g
    pitch_gradient_rad_per_mps2: NonNegative = 0.0045  # 2.5 deg/g, as anti-dive leaves it
    load_pitch_rad_per_kg: float = Field(default=-2e-5, ge=-1e-3, le=1e-3)  # - = in the rear: the nose rises
    frequency_hz: Positive = 1.4
    damping_ratio: OpenShare = 0.3


@dataclass(frozen=True, slots=True)
class Attitude:
    """How a body is turned on its springs."""

    pitch_rad: float = 0.0  # + = nose down
    roll_rad: float = 0.0  # + = left side up


LEVEL = Attitude()


class BodyOnSprings:
    """The attitude of one body over time."""

    def __init__(self, springs: Springs, *, load_kg: float = 0.0) -> None:
        self._springs, self._load_rad = springs, springs.load_pitch_rad_per_kg * load_kg
        self._last_s: float | None = None
        self._pitch, self._roll = (0.0, 0.0), (0.0, 0.0)  # angle [rad] and rate [rad/s]
        self._axles_rad = 0.0

    def step(self, ahead_mps2: float, left_mps2: float, *, now_s: float, axles_rad: float = 0.0) -> Attitude:
        """The attitude at ``now_s``; ``ahead_mps2``, ``left_mps2``: forces of the tyres per mass since the last.

        ``axles_rad``: pitch of the plane through the axles now, + = nose down. The first step gives the steady
        attitude.
        """
        springs = self._springs
        steady = (
            self._load_rad - springs.pitch_gradient_rad_per_mps2 * ahead_mps2,
            springs.roll_gradient_rad_per_mps2 * left_mps2,
        )
        if self._last_s is None:
            self._pitch, self._roll = (axles_rad + steady[0], 0.0), (steady[1], 0.0)
        else:
            elapsed_s = max(now_s - self._last_s, 0.0)
            turned_rad = axles_rad - self._axles_rad
            axle_rate = turned_rad / elapsed_s if elapsed_s > 0.0 else 0.0
            above = self._pitch[0] - self._axles_rad, self._pitch[1] - axle_rate
            swung = self._swing(above, steady[0], elapsed_s)
            self._pitch = swung[0] + axles_rad, swung[1] + axle_rate
            self._roll = self._swing(self._roll, steady[1], elapsed_s)
        self._last_s, self._axles_rad = now_s, axles_rad
        pitch_rad, roll_rad = (max(min(of[0], MOST_RAD), -MOST_RAD) for of in (self._pitch, self._roll))
        return Attitude(pitch_rad, roll_rad)

    def _swing(self, motion: tuple[float, float], goal_rad: float, t: float) -> tuple[float, float]:
        """Angle and rate after ``t`` [s] towards ``goal_rad``."""
        natural, ratio = math.tau * self._springs.frequency_hz, self._springs.damping_ratio
        ringing = natural * math.sqrt(1 - ratio * ratio)
        off, rate = motion[0] - goal_rad, motion[1]
        decay = math.exp(-ratio * natural * t)
        cos, sin = math.cos(ringing * t), math.sin(ringing * t) / ringing
        angle = goal_rad + decay * (off * cos + (rate + ratio * natural * off) * sin)
        return angle, decay * (rate * cos - (natural * natural * off + ratio * natural * rate) * sin)
