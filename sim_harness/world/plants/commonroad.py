"""CommonRoad's single-track drift and multi-body models as plants: independent equations and tyre models.

Vehicle 2 of the CommonRoad set (BMW 320i) shortened to the wheelbase of the vehicle file: the distances to the
axles shrink by one ratio, the moments of inertia in yaw and pitch by its square; masses, springs and tyres are
unchanged. Steering and drive are those of :mod:`sim_harness.world.plants.actuators`: the inputs of the models are
a steering rate and an acceleration. The understeer is that of the models, not of the vehicle file. A banked road
is not simulated.

Both models divide by the speed, and their wheels become infinitely stiff towards standstill; they switch to a
kinematic model near 0.1 m/s themselves. The kinematic plant replaces them below ``ROLLING_MPS``.

Althoff, Koschi and Manzinger, CommonRoad: Composable benchmarks for motion planning on roads (IV 2017); Althoff and
Würsching, CommonRoad: Vehicle Models (2020), chapters 7 and 8.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from sim_harness.world.plants.actuators import Actuation
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.foreign import ForeignPlant, Inner, Pose
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.runge_kutta import rk4
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.car.vehicle import Vehicle
from trepid.config import InputError

ROLLING_MPS = 0.5
# [rad/(m/s²)] at 20 m/s and 2 m/s², measured by a test: 0.004 and -0.058 deg/g. All wheels have the same tyres,
# whose stiffness is proportional to their load; that is neutral.
UNDERSTEER = {Model.COMMONROAD_DRIFT: 7e-6, Model.COMMONROAD_MULTI_BODY: -1.03e-4}
_SETTLING = 2.0  # step times the rate of the stiffest mode, the wheels; Runge-Kutta is stable to 2.78

Vector = tuple[float, ...]
Inputs = tuple[float, float]  # steering rate [rad/s], acceleration [m/s²]


class CommonRoadPlant(ForeignPlant):
    """A CommonRoad model. ``inner``: the model's vector from the yaw rate on."""

    ROLLING_MPS = ROLLING_MPS
    YAW_RATE_AT = 0

    def __init__(self, vehicle: Vehicle, settings: PlantSettings) -> None:
        """Raises InputError for a banked road, and where the package is not installed."""
        if settings.bank_rad != 0.0:
            raise InputError(f"plant: model {str(settings.model)!r} does not simulate a banked road")
        model = Model(settings.model)
        own = UNDERSTEER[model]
        known = vehicle.model_copy(update=dict(understeer_gradient_rad_per_mps2=own))
        self._model = _model(model, vehicle, settings)
        self._stiffness_mps2 = _wheel_stiffness_mps2(self._model.parameters)
        super().__init__(
            known,
            settings,
            rolling=KinematicPlant(known, settings.model_copy(update=dict(load_kg=0.0))),
            cg_to_rear_m=float(self._model.parameters.b),
        )

    def _integrate(
        self, state: PlantState, start: Pose, accel_demand_mps2: float, h: float
    ) -> tuple[Pose, Actuation, Inner]:
        before, end = self.actuators.at(state), self.actuators.after(state, accel_demand_mps2, h)
        steps = math.ceil(h * self._stiffness_mps2 / (_SETTLING * state.speed_mps))
        inputs = ((end.tyre_angle_rad - before.tyre_angle_rad) / h, end.accel_mps2 + self.actuators.pull_mps2)
        vector = self._vector(state, start, before)
        for _ in range(steps):
            vector = rk4(self._model.rates, vector, inputs, inputs, inputs, h / steps)
        x_m, y_m, _, _, yaw_rad = vector[:5]
        end = end._replace(speed_mps=max(0.0, self._model.speed_mps(vector)))
        return (x_m, y_m, yaw_rad), end, vector[5:]

    def _vector(self, state: PlantState, pose: Pose, motion: Actuation) -> Vector:
        """The model's vector at ``state`` with its centre of gravity at ``pose``."""
        x_m, y_m, yaw_rad = pose
        yaw_rate_radps = self.yaw_rate_radps(state)
        drift = math.atan(self._cg_m * yaw_rate_radps / state.speed_mps)
        total_mps = state.speed_mps / math.cos(drift)
        core = [x_m, y_m, motion.tyre_angle_rad, total_mps, yaw_rad, yaw_rate_radps, drift]
        if not state.inner:
            return tuple(self._model.init(core, self._model.parameters))
        return self._model.resume(core, state.speed_mps, state.inner)


@dataclass(frozen=True, slots=True)
class _Model:
    """One of CommonRoad's models. Its vector starts with x, y, δ, speed, ψ, yaw rate."""

    # From (x, y, δ, total speed, ψ, ψ', drift) to the vector with rolling wheels.
    init: Callable[[list[float], Any], list[float]]
    dynamics: Callable[[list[float], list[float], Any], list[float]]
    parameters: Any
    drift_at: int | None  # index of the drift if the vector holds the total speed; None: longitudinal

    def resume(self, core: list[float], speed_mps: float, inner: Vector) -> Vector:
        """The vector for ``core``, with the longitudinal speed and the states kept as ``inner``."""
        vector = (*core[:3], speed_mps, core[4], *inner)
        if self.drift_at is None:
            return vector
        return (*vector[:3], speed_mps / math.cos(vector[self.drift_at]), *vector[4:])

    def speed_mps(self, vector: Vector) -> float:
        if self.drift_at is None:
            return vector[3]
        return vector[3] * math.cos(vector[self.drift_at])

    def rates(self, vector: Vector, inputs: Inputs) -> list[float]:
        """Time derivatives. The models modify their arguments, so copies are passed."""
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
    parameters = _adapt_parameters(parameters_vehicle2(), vehicle, settings)
    if model is Model.COMMONROAD_DRIFT:
        return _Model(init_std, vehicle_dynamics_std, parameters, drift_at=6)
    return _Model(init_mb, vehicle_dynamics_mb, parameters, drift_at=None)


def _adapt_parameters(p: Any, vehicle: Vehicle, settings: PlantSettings) -> Any:
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
