"""Checks of the inputs: age, finiteness, plausibility, rate of commands."""

from collections import deque
from math import isfinite
from typing import NamedTuple

from controller.limiter.limits import Limits
from trepid.messages import Command, VehicleState

COUNTED = 8  # arrivals over which the rate of commands is measured


class SeenState(NamedTuple):
    """A plausible vehicle state."""

    speed_mps: float  # magnitude; the last one known where it is not measured
    wheel_rad: float | None  # None: not measured
    driver: bool  # driver override as reported by the vehicle
    torque_nm: float | None
    yaw_rate_radps: float | None
    measures_speed: bool = True


def fresh(t_s: float | None, now_s: float, timeout_s: float, limits: Limits) -> bool:
    """Whether a stamp is recent; False for None, NaN and a stamp from the future."""
    return t_s is not None and -limits.early_s <= now_s - t_s <= timeout_s


def plausible_state(
    state: VehicleState | None, now_s: float, limits: Limits, *, last_mps: float | None = None
) -> SeenState | None:
    """``state`` if it is fresh and plausible, else None; yaw rate and torque may be None.

    ``last_mps`` is the last speed of a car that was steered by a measured wheel angle; None: there was none. From
    then on speed and wheel angle may be None in a state that names what it doubts.
    """
    if state is None:
        return None
    speed_mps, wheel_rad = state.speed_mps, state.road_wheel_angle_rad
    known_mps = last_mps if speed_mps is None else abs(speed_mps)
    is_partial = speed_mps is None or wheel_rad is None
    if known_mps is None or (is_partial and (last_mps is None or not state.doubted)):
        return None
    plausible = (
        fresh(state.t_s, now_s, limits.state_timeout_s, limits)
        and (speed_mps is None or abs(speed_mps) <= limits.max_speed_mps)
        and (wheel_rad is None or abs(wheel_rad) <= limits.max_angle_rad)
        and _known_is_finite(state.yaw_rate_radps)
        and _known_is_finite(state.driver_torque_nm)
    )
    if not plausible:
        return None
    return SeenState(
        speed_mps=known_mps,
        wheel_rad=wheel_rad,
        driver=state.driver_override,
        torque_nm=state.driver_torque_nm,
        yaw_rate_radps=state.yaw_rate_radps,
        measures_speed=speed_mps is not None,
    )


def is_finite(command: Command) -> bool:
    """Whether every number of ``command`` is finite."""
    return (
        _known_is_finite(command.t_s)
        and isfinite(command.road_wheel_angle_rad)
        and isfinite(command.road_wheel_rate_radps)
        and isfinite(command.speed_mps)
        and isfinite(command.accel_mps2)
        and isfinite(command.jerk_mps3)
    )


def _known_is_finite(value: float | None) -> bool:
    return value is None or isfinite(value)


class Arrivals:
    """Rate of the commands. A higher rate opens no limit, since all limits are per elapsed time."""

    def __init__(self, limits: Limits) -> None:
        self._longest_s = COUNTED / limits.command_rate_hz
        self._times_s: deque[float] = deque(maxlen=COUNTED)

    def too_seldom(self, received_s: float | None, now_s: float) -> bool:
        """Whether the last COUNTED commands, the newest received at ``received_s``, took too long."""
        if received_s is not None and received_s not in self._times_s:
            self._times_s.append(received_s)
        return len(self._times_s) == COUNTED and now_s - self._times_s[0] > self._longest_s
