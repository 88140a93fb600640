"""Lateral acceleration by the yaw rate beyond that of the bicycle model.

A car turns in while braking in a bend, its understeer on a slope or with a load differs from the vehicle file, and
steering has an offset. All of these are in

    e = v·ψ' - κ(δ)·v²

the lateral acceleration beyond that of the steady turn at the measured wheel angle, filtered with τ and led by T:
e + T·e' of the filtered e, with e' = (unfiltered - filtered)/τ. In transients the yaw rate follows the wheel late,
so that e has the sign opposite to the motion of the wheel: it narrows the limit on the side without demand.
"""

from controller.limiter.inputs import Seen
from controller.limiter.interval import clip
from controller.limiter.limits import Limits
from controller.limiter.turn import SteadyTurn

FILTER_S = 0.1  # τ, for gyroscopes with a noise of 0.002 rad/s
LEAD_S = 0.3  # T: delay of steering and filter


class Excess:
    """Call ``step`` with every plausible state."""

    def __init__(self, turn: SteadyTurn, limits: Limits) -> None:
        self._turn = turn
        self._most_mps2 = limits.yaw_share * limits.lateral_accel_mps2
        self._filtered_mps2 = 0.0

    def step(self, seen: Seen, dt_s: float) -> float:
        """Lateral acceleration [m/s²] beyond the steady turn, + = to the left, within its bounds.

        Zero while yaw rate, wheel angle or speed is not measured.
        """
        if seen.yaw_rate_radps is None or seen.wheel_rad is None or not seen.measures_speed:
            self._filtered_mps2 = 0.0
            return 0.0
        steady_1pm = self._turn.curvature_1pm(seen.wheel_rad, seen.speed_mps)
        excess_mps2 = seen.speed_mps * (seen.yaw_rate_radps - steady_1pm * seen.speed_mps)
        rate_mps3 = (excess_mps2 - self._filtered_mps2) / (FILTER_S + dt_s)
        self._filtered_mps2 += rate_mps3 * dt_s
        return clip(self._filtered_mps2 + LEAD_S * rate_mps3, (-self._most_mps2, self._most_mps2))
