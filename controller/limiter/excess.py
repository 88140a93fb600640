"""How much more the car turns than its wheels say: what the yaw rate adds to the bicycle.

A car that brakes in a bend turns in, one on a slope or with a load understeers otherwise than its file says, and a
steering has an offset. All of it is in

    e = v·ψ' - κ(δ)·v²

the lateral acceleration beyond that of the steady turn at the measured wheel angle, filtered with τ and led by T:
e + T·e' of the filtered e, with e' = (unfiltered - filtered)/τ. In transients the yaw rate follows the wheel late,
so that e points away from where the wheel is going: there it narrows the side that nothing is asked for.
"""

from controller.limiter.inputs import Seen
from controller.limiter.interval import clip
from controller.limiter.limits import Limits
from controller.limiter.turn import SteadyTurn

FILTER_S = 0.1  # τ, for gyroscopes with a noise of 0.002 rad/s
LEAD_S = 0.3  # T: steering and filter are so late


class Excess:
    """``step`` it with every state that is believed."""

    def __init__(self, turn: SteadyTurn, limits: Limits) -> None:
        self._turn = turn
        self._most_mps2 = limits.yaw_share * limits.lateral_accel_mps2
        self._filtered_mps2 = 0.0

    def step(self, seen: Seen, dt_s: float) -> float:
        """Lateral acceleration [m/s²] that the wheels do not account for, + = to the left, within its bounds.

        Zero while the yaw rate is not measured.
        """
        if seen.yaw_rate_radps is None:
            self._filtered_mps2 = 0.0
            return 0.0
        steady_1pm = self._turn.curvature_1pm(seen.wheel_rad, seen.speed_mps)
        excess_mps2 = seen.speed_mps * (seen.yaw_rate_radps - steady_1pm * seen.speed_mps)
        rate_mps3 = (excess_mps2 - self._filtered_mps2) / (FILTER_S + dt_s)
        self._filtered_mps2 += rate_mps3 * dt_s
        return clip(self._filtered_mps2 + LEAD_S * rate_mps3, (-self._most_mps2, self._most_mps2))
