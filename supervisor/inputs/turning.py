"""How much more the car turns than its wheels: lateral acceleration that nothing the car steers accounts for.

    e = sign(ψ')·v·(ψ' - v·tan δ/(L + K_us·v²))

The limiter takes the same excess from the lateral acceleration that it allows
(:mod:`controller.limiter.turn`), so that a gyroscope with an offset makes it cut the demand: the car then leaves
its path because of a measurement, not because the bend is too tight. A yaw rate below that of the wheels takes
nothing from the limit.
"""

import math

from supervisor.inputs.validation import steady_yaw_rate_radps
from trepid.bounds import at_least
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Motion
from trepid.messages import VehicleState

SMOOTH_S = 0.5  # time constant: a car that follows its wheels late turns too much, then too little by as much


class TurnExcess:
    """Running mean of the excess. Call ``step`` with every state."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._mean_mps2 = 0.0
        self._last_s: float | None = None

    def step(self, state: VehicleState | None, motion: Motion | None, *, now_s: float) -> float:
        """The excess [m/s²], 0 and more; 0 without a measured yaw rate or wheel angle, which ``state_doubt`` rates.

        ``motion`` is that of ``state``, None where it is lost.
        """
        excess_mps2 = None if state is None or motion is None else self._excess_mps2(state, motion)
        if excess_mps2 is None:
            self._mean_mps2, self._last_s = 0.0, None
            return 0.0
        dt_s = 0.0 if self._last_s is None else at_least(now_s - self._last_s, 0.0)
        self._last_s = now_s
        self._mean_mps2 += (1.0 - math.exp(-dt_s / SMOOTH_S)) * (excess_mps2 - self._mean_mps2)
        return at_least(self._mean_mps2, 0.0)

    def _excess_mps2(self, state: VehicleState, motion: Motion) -> float | None:
        if state.yaw_rate_radps is None or state.road_wheel_angle_rad is None:
            return None
        steady_radps = steady_yaw_rate_radps(self._vehicle, state.road_wheel_angle_rad, motion.speed_mps)
        turn_radps = motion.yaw_rate_radps
        return math.copysign(1.0, turn_radps) * abs(motion.speed_mps) * (turn_radps - steady_radps)
