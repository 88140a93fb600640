"""CommonRoad's single-track drift and multi-body models as plants: equations and tyres that are not ours.

Vehicle 2 of the CommonRoad set (BMW 320i) shortened to the wheelbase of the vehicle file: the distances to the
axles shrink by one ratio, the moments of inertia in yaw and pitch by its square; masses, springs and tyres are
theirs. Steering and drive are :mod:`sim_harness.world.plants.actuators`, so the models get a steering rate and an
acceleration. Their understeer is their own: measured here, not that of the vehicle file. They know no bank.

Both models divide by the speed and their wheels become infinitely stiff towards standstill, which is why they
switch to a kinematic model near 0.1 m/s themselves. Here the kinematic plant takes over below ``ROLLING_MPS``.

Althoff, Koschi and Manzinger, CommonRoad: Composable benchmarks for motion planning on roads (IV 2017); Althoff and
Würsching, CommonRoad: Vehicle Models (2020), chapters 7 and 8.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim_harness.world.plants.actuators import Actuators, Motion, moved
from sim_harness.world.plants.axles import ANTI_LOCK, GRAVITY_MPS2
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.runge_kutta import rk4
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.config import InputError
from trepid.messages import Command
from trepid.vehicle import Vehicle

ROLLING_MPS = 0.5
# [rad/(m/s²)], measured at 20 m/s and 2 m/s² (a test measures again): 0.004 and -0.058 deg/g. All their wheels have
# the same tyres, whose stiffness is proportional to their load; that is neutral.
UNDERSTEER = {Model.COMMONROAD_DRIFT: 7e-6, Model.COMMONROAD_MULTI_BODY: -1.03e-4}
_SETTLING = 2.0  # step times the rate of the stiffest mode, the wheels; Runge-Kutta is stable to 2.78

Vector = tuple[float, ...]
Inputs = tuple[float, float]  # steering rate [rad/s], acceleration [m/s²]


class CommonRoadPlant:
    """Advances a :class:`PlantState` with a CommonRoad model; ``inner`` = () rolls without slip."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings) -> None:
        """Raises InputError for a bank, and where the package is not installed."""
        if settings.bank_rad != 0.0:
            raise InputError(f"plant: model {settings.model.value!r} has no bank")
        own = UNDERSTEER[settings.model]
        self.vehicle = vehicle.model_copy(update=dict(understeer_gradient_rad_per_mps2=own))
        self._model = _model(settings.model, vehicle, settings)
        self._cg_m = float(self._model.parameters.b)
        self._stiffness_mps2 = _wheel_stiffness_mps2(self._model.parameters)
        self._rolling = KinematicPlant(self.vehicle, settings.model_copy(update=dict(load_kg=0.0)))
        grip_mps2 = ANTI_LOCK * settings.friction * GRAVITY_MPS2
        self.actuators = Actuators(vehicle, settings, grip_mps2=grip_mps2)

    def initial(
        self,
        x_m: float = 0.0,
        y_m: float = 0.0,
        yaw_rad: float = 0.0,
        speed_mps: float = 0.0,
        curvature_1pm: float = 0.0,
    ) -> PlantState:
        """Rolling without slip on ``curvature_1pm``; the tyres settle within some tenths of a second."""
        return self._rolling.initial(x_m, y_m, yaw_rad, speed_mps, curvature_1pm)

    def step(self, state: PlantState, command: Command, dt_s: float) -> PlantState:
        """State after ``dt_s`` under ``command``. Raises ValueError when a demand is not finite."""
        return self.actuators.drive(state, command, dt_s, self._advance)

    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ'."""
        return state.inner[0] if state.inner else self._rolling.yaw_rate_radps(state)

    def lateral_accel_mps2(self, state: PlantState) -> float:
        """v·ψ', which leaves out the part of a changing drift."""
        return state.speed_mps * self.yaw_rate_radps(state)

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        """Angle of the steering that holds ``curvature_1pm`` at ``speed_mps``, by the measured understeer."""
        return self._rolling.steady_angle_rad(curvature_1pm, speed_mps)

    def _advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        start, end = self.actuators.at(state), self.actuators.after(state, accel_demand_mps2, h)
        if state.speed_mps < ROLLING_MPS:
            return self._rolling.advance(state, accel_demand_mps2, h)
        steps = math.ceil(h * self._stiffness_mps2 / (_SETTLING * state.speed_mps))
        inputs = ((end.tyre_angle_rad - start.tyre_angle_rad) / h, end.accel_mps2)
        vector = self._vector(state, start)
        for _ in range(steps):
            vector = rk4(self._model.rates, vector, inputs, inputs, inputs, h / steps)
        x_m, y_m, _, _, yaw_rad = vector[:5]
        pose = (x_m - self._cg_m * math.cos(yaw_rad), y_m - self._cg_m * math.sin(yaw_rad), yaw_rad)
        end = end._replace(speed_mps=max(0.0, self._model.speed_mps(vector)))
        inner = vector[5:] if end.speed_mps >= ROLLING_MPS else ()
        return moved(state, end, h, pose, inner)

    def _vector(self, state: PlantState, motion: Motion) -> Vector:
        """The model's vector at ``state``; its position is that of the centre of gravity."""
        x_m = state.x_m + self._cg_m * math.cos(state.yaw_rad)
        y_m = state.y_m + self._cg_m * math.sin(state.yaw_rad)
        yaw_rate_radps = self.yaw_rate_radps(state)
        drift = math.atan(self._cg_m * yaw_rate_radps / state.speed_mps)
        total_mps = state.speed_mps / math.cos(drift)
        core = [x_m, y_m, motion.tyre_angle_rad, total_mps, state.yaw_rad, yaw_rate_radps, drift]
        if not state.inner:
            return tuple(self._model.init(core, self._model.parameters))
        return self._model.resume(core, state.speed_mps, state.inner)


@dataclass(frozen=True, slots=True)
class _Model:
    """One of CommonRoad's models. Its vector starts with x, y, δ, speed, ψ; the yaw rate follows."""

    init: Callable[
        [list[float], Any], list[float]
    ]  # from (x, y, δ, total speed, ψ, ψ', drift) to rolling wheels
    dynamics: Callable[[list[float], list[float], Any], list[float]]
    parameters: Any
    drift_at: int | None  # where the vector holds the drift if its speed is the total; None: the longitudinal

    def resume(self, core: list[float], speed_mps: float, inner: Vector) -> Vector:
        """The vector for ``core``, with the longitudinal speed and the states kept as ``inner``."""
        vector = (*core[:3], speed_mps, core[4], *inner)
        if self.drift_at is None:
            return vector
        return (*vector[:3], speed_mps / math.cos(vector[self.drift_at]), *vector[4:])

    def speed_mps(self, vector: Vector) -> float:
        """Longitudinal speed."""
        if self.drift_at is None:
            return vector[3]
        return vector[3] * math.cos(vector[self.drift_at])

    def rates(self, vector: Vector, inputs: Inputs) -> list[float]:
        """Time derivatives. The models write into their arguments, so they get copies."""
        return self.dynamics(list(vector), list(inputs), self.parameters)


def _model(model: Model, vehicle: Vehicle, settings: PlantSettings) -> _Model:
    """Vehicle 2, shortened and loaded, in ``model``. Raises InputError where the package is not installed."""
    try:
        from vehiclemodels.init_mb import init_mb
        from vehiclemodels.init_std import init_std
        from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
        from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb
        from vehiclemodels.vehicle_dynamics_std import vehicle_dynamics_std
    except ImportError as error:
        raise InputError(f"plant: model {model.value!r} needs: pip install 'trepid[bench]'") from error
    parameters = _adapted(parameters_vehicle2(), vehicle, settings)
    if model is Model.COMMONROAD_DRIFT:
        return _Model(init_std, vehicle_dynamics_std, parameters, drift_at=6)
    return _Model(init_mb, vehicle_dynamics_mb, parameters, drift_at=None)


def _adapted(p: Any, vehicle: Vehicle, settings: PlantSettings) -> Any:
    """CommonRoad's parameters, shortened, loaded over the centre of gravity, on a road of the given friction."""
    ratio = vehicle.wheelbase_m / (p.a + p.b)
    p.a, p.b = p.a * ratio, p.b * ratio
    p.I_z, p.I_y_s = p.I_z * ratio**2, p.I_y_s * ratio**2
    p.m, p.m_s = p.m + settings.load_kg, p.m_s + settings.load_kg
    p.tire.p_dx1, p.tire.p_dy1 = p.tire.p_dx1 * settings.friction, p.tire.p_dy1 * settings.friction
    # The actuators limit angle and rate.
    p.steering.min, p.steering.max = -math.inf, math.inf
    p.steering.v_min, p.steering.v_max = -math.inf, math.inf
    return p


def _wheel_stiffness_mps2(p: Any) -> float:
    """Rate at which the wheels take the speed of the road, times the speed: R²·K·F_z/I_w of the heavier axle."""
    axle_n = p.m * GRAVITY_MPS2 * max(p.a, p.b) / (p.a + p.b)
    return float(p.R_w**2 * p.tire.p_kx1 * axle_n / p.I_y_w)
