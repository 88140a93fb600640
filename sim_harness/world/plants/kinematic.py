"""Kinematic bicycle with understeer: the tyres are in steady state at every instant.

State at the centre of the rear axle: position (x, y) [m] and yaw [rad] in the plane of the road, speed [m/s].

    x' = v·cos ψ      y' = v·sin ψ      ψ' = v·κ      δ = atan(L·κ) + K_us·(κ·v² + g·sin φ)

The last line holds at every instant (quasi-static understeer). On a road banked by φ, left side up, the tyres also
carry the part of the weight that pulls to the right. They carry no more than friction allows:

    (κ·v² + g·sin φ)² + a² ≤ (μ·g·cos φ)²

The actuators have closed solutions for a constant demand, so only the pose is integrated, by Runge-Kutta of
order 4.

Rajamani, Vehicle Dynamics and Control (2012), sections 2.2 (kinematics) and 3.3 (understeer gradient).
"""

import math

from sim_harness.world.plants.actuators import Actuation, state_after
from sim_harness.world.plants.axles import axles_of
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import AS_IN_THE_FILE, PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.bounds import within
from trepid.car.vehicle import Vehicle

_NEWTON_STEPS = 20  # two or three in practice
_LAST_STEP_RAD = 1e-9  # the error after a step is of the order of the step's square


class KinematicPlant(Plant):
    """Kinematic bicycle. Stateless except for a cache of the last motion and its yaw rate."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings = AS_IN_THE_FILE) -> None:
        """Raises InputError when no axle stiffness fits the understeer and load of ``vehicle``."""
        super().__init__(vehicle, settings)
        self.wheelbase_m = vehicle.wheelbase_m
        self.understeer_rad_per_mps2 = vehicle.understeer_gradient_rad_per_mps2
        if settings.load_kg > 0.0:
            self.understeer_rad_per_mps2 = axles_of(vehicle, settings).understeer_gradient_rad_per_mps2
        # Cache: a step begins with the motion at which the last one ended.
        self._known: Actuation | None = None
        self._known_rate = 0.0  # yaw rate of that motion
        self._last: PlantState | None = None  # state with that motion

    def curvature_1pm(self, tyre_angle_rad: float, speed_mps: float, accel_mps2: float = 0.0) -> float:
        """Path curvature κ at the rear axle that solves δ = atan(L·κ) + K_us·(κ·v² + g·sin φ), within the grip.

        With θ = atan(L·κ): Newton on θ + (K_us·v²/L)·tan θ = δ - K_us·g·sin φ. For K_us ≥ 0 the left side is
        convex above zero and the start lies above the root, so the sequence falls to it. Raises ValueError where
        an oversteering vehicle (K_us < 0) has no steady state, as at and above its critical speed √(-L/K_us).
        """
        gradient, wheelbase_m = self.understeer_rad_per_mps2, self.wheelbase_m
        compliance = gradient * speed_mps * speed_mps / wheelbase_m
        rest_rad = tyre_angle_rad - gradient * self.bank_mps2
        if compliance == 0.0:
            curvature = math.tan(rest_rad) / wheelbase_m
        else:
            curvature = self._solve(rest_rad, compliance, speed_mps) / wheelbase_m
        lateral_mps2 = curvature * speed_mps * speed_mps + self.bank_mps2
        if lateral_mps2 * lateral_mps2 + accel_mps2 * accel_mps2 <= self.grip_mps2 * self.grip_mps2:
            return curvature
        return self._slide_curvature_1pm(lateral_mps2, speed_mps, accel_mps2)

    def stand_on(self, grade: float, bank_rad: float) -> None:
        before_mps2 = self.bank_mps2
        super().stand_on(grade, bank_rad)
        if self.bank_mps2 != before_mps2:
            self._known = self._last = None

    def yaw_rate_radps(self, state: PlantState) -> float:
        if state is self._last:
            return self._known_rate
        return self._yaw_rate(self.actuators.at(state))

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        lateral_mps2 = curvature_1pm * speed_mps * speed_mps + self.bank_mps2
        angle_rad = math.atan(self.wheelbase_m * curvature_1pm) + self.understeer_rad_per_mps2 * lateral_mps2
        return within(angle_rad - self.actuators.offset_rad, self.actuators.max_angle_rad)

    def _solve(self, rest_rad: float, compliance: float, speed_mps: float) -> float:
        """tan θ where θ + compliance·tan θ = rest."""
        theta = rest_rad / (1.0 + compliance) if compliance > -1.0 else 0.0
        for _ in range(_NEWTON_STEPS):
            tangent = math.tan(theta)
            growth = 1.0 + tangent * tangent
            slope = 1.0 + compliance * growth
            if slope <= 0.0:
                break
            step = (rest_rad - theta - compliance * tangent) / slope
            if -_LAST_STEP_RAD < step < _LAST_STEP_RAD:
                return tangent + growth * step
            theta += step
        raise ValueError(f"{self.vehicle.name} has no steady state at {speed_mps} m/s: it oversteers")

    def _slide_curvature_1pm(self, lateral_mps2: float, speed_mps: float, accel_mps2: float) -> float:
        """Curvature when the tyres would have to carry ``lateral_mps2`` and slide."""
        if speed_mps == 0.0:
            return 0.0
        left_mps2 = math.sqrt(max(0.0, self.grip_mps2**2 - accel_mps2**2))
        return (math.copysign(left_mps2, lateral_mps2) - self.bank_mps2) / (speed_mps * speed_mps)

    def pose_after(
        self, pose: tuple[float, float, float], start: Actuation, middle: Actuation, end: Actuation, h: float
    ) -> tuple[float, float, float]:
        """(x, y, yaw) one Runge-Kutta step of ``h`` [s] after ``pose``, with the motion at start, middle and end.

        ψ' does not depend on the pose, so its four stages fall together to Simpson's rule.
        """
        x_m, y_m, yaw_1 = pose
        v_0, v_mid, v_end = start.speed_mps, middle.speed_mps, end.speed_mps
        rate_0, rate_mid, rate_end = self._yaw_rate(start), self._yaw_rate(middle), self._yaw_rate(end)
        yaw_2 = yaw_1 + h / 2 * rate_0
        yaw_3 = yaw_1 + h / 2 * rate_mid
        yaw_4 = yaw_1 + h * rate_mid
        sin, cos = math.sin, math.cos
        x_rates = v_0 * cos(yaw_1) + 2 * v_mid * (cos(yaw_2) + cos(yaw_3)) + v_end * cos(yaw_4)
        y_rates = v_0 * sin(yaw_1) + 2 * v_mid * (sin(yaw_2) + sin(yaw_3)) + v_end * sin(yaw_4)
        yaw_rad = yaw_1 + h / 6 * (rate_0 + 4 * rate_mid + rate_end)
        return x_m + h / 6 * x_rates, y_m + h / 6 * y_rates, yaw_rad

    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        start, middle, end = self.actuators.during(state, accel_demand_mps2, h)
        pose = self.pose_after((state.x_m, state.y_m, state.yaw_rad), start, middle, end, h)
        self._last = state_after(state, end, h, pose)
        return self._last

    def _yaw_rate(self, motion: Actuation) -> float:
        if motion is not self._known and motion != self._known:
            speed_mps, accel_mps2, angle_rad, _, _ = motion
            self._known_rate = speed_mps * self.curvature_1pm(angle_rad, speed_mps, accel_mps2)
            self._known, self._last = motion, None
        return self._known_rate
