"""Dynamic single track at the rear axle: yaw inertia, and tyres that saturate.

The state other than the pose is written as ratios to the speed u, so that nothing is singular at standstill:

    β = w/u   drift: lateral speed of the rear axle over its speed          κ = ψ'/u   yaw per metre [1/m]

    α_f = δ - atan(β + L·κ)        α_r = -atan(β)                           slip angles
    F   = D·sin(1.3·atan(C·α/(1.3·D)))       D = F_z·√(μ² - (a/g_n)²)       tyres: slope C, never more than D
    A   = (F_f·cos δ + F_r)/m - g·sin φ      N = (l_f·F_f·cos δ - l_r·F_r)/I_z
    U·β' = A - u²·κ - l_r·N - a·β            U·κ' = N - a·κ                 U = max(u, 1 m/s)
    x' = u·(cos ψ - β·sin ψ)       y' = u·(sin ψ + β·cos ψ)       ψ' = u·κ

With U = u these are the exact equations of the single track whose drive holds u' = a against the drag of the
tyres. Below 1 m/s the tyres settle at the rate of 1 m/s (within some 10 ms), not at the growing rate of the
equations: the steady state stays exact down to standstill, where it is that of the kinematic model. Load transfer
is not modelled.

Axle equations: Rajamani, Vehicle Dynamics and Control (2012), section 2.3. Tyres: magic formula with shape factor
1.3 and no curvature, Pacejka, Tire and Vehicle Dynamics (2012), section 4.3.1.
"""

import math

from sim_harness.world.plants.actuators import Actuation, state_after
from sim_harness.world.plants.axles import Axles, axles_of
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.runge_kutta import rk4
from sim_harness.world.plants.settings import AS_IN_THE_FILE, PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.bounds import within
from trepid.car.vehicle import Vehicle

SHAPE = 1.3  # of the magic formula, lateral
SETTLES_AS_AT_MPS = 1.0
MAX_STEP_S = 0.01
STEP_OF_FASTEST_MODE = 2.0  # at 1 m/s; Runge-Kutta is stable to 2.78
_STEADY_ROUNDS = 60  # the front angle as a fixed point; contracts by F_f/C_f·tan δ, well below 1/2
_STEADY_RAD = 1e-14


class SingleTrackPlant(Plant):
    """Dynamic single track. ``inner`` = (β, κ). Stateless."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings = AS_IN_THE_FILE) -> None:
        """Raises InputError when no tyre stiffness fits the understeer of ``vehicle``."""
        super().__init__(vehicle, settings)
        self.axles = axles_of(vehicle, settings)
        self._quasi_static = KinematicPlant(vehicle, settings)
        fastest_radps = _fastest_mode_mps2(self.axles) / SETTLES_AS_AT_MPS
        self._max_step_s = min(MAX_STEP_S, STEP_OF_FASTEST_MODE / fastest_radps)

    def stand_on(self, grade: float, bank_rad: float) -> None:
        super().stand_on(grade, bank_rad)
        self._quasi_static.stand_on(grade, bank_rad)

    def steady_inner(self, curvature_1pm: float, speed_mps: float) -> tuple[float, ...]:
        """(β, κ) of the steady state on ``curvature_1pm``."""
        return self._drift(curvature_1pm * speed_mps * speed_mps + self.bank_mps2), curvature_1pm

    def yaw_rate_radps(self, state: PlantState) -> float:
        return state.speed_mps * self._inner(state)[1]

    def lateral_accel_mps2(self, state: PlantState) -> float:
        """Acceleration A of the centre of gravity across the vehicle, in the plane of the road."""
        drift, curvature = self._inner(state)
        angle_rad = self.actuators.at(state).tyre_angle_rad
        front, rear = self._tyre_forces_n(angle_rad, drift, curvature, state.accel_mps2)
        return (front * math.cos(angle_rad) + rear) / self.axles.mass_kg - self.bank_mps2

    def steady_angle_rad(self, curvature_1pm: float, speed_mps: float) -> float:
        angle_rad, _ = self._steady(curvature_1pm, speed_mps)
        return within(angle_rad - self.actuators.offset_rad, self.actuators.max_angle_rad)

    def _steady(self, curvature_1pm: float, speed_mps: float) -> tuple[float, float]:
        """Angle of the front tyres [rad] and drift β in the steady state with yaw per metre ``curvature_1pm``.

        There N = 0, so each axle carries its own mass through the bend: F_r = m_r·A, F_f·cos δ = m_f·A. In a
        bend beyond the grip the tyres are at the peak of their force.
        """
        axles = self.axles
        lateral_mps2 = curvature_1pm * speed_mps * speed_mps + self.bank_mps2
        drift = self._drift(lateral_mps2)
        rolling_rad = math.atan(drift + self.vehicle.wheelbase_m * curvature_1pm)
        angle_rad = rolling_rad
        for _ in range(_STEADY_ROUNDS):
            share_mps2 = lateral_mps2 / math.cos(angle_rad)
            slip_rad = self._slip_rad(share_mps2, axles.front_mass_kg, axles.front_stiffness_nprad)
            before_rad, angle_rad = angle_rad, within(rolling_rad + slip_rad, self.actuators.max_angle_rad)
            if abs(angle_rad - before_rad) < _STEADY_RAD:
                break
        return angle_rad, drift

    def _slip_rad(self, lateral_mps2: float, mass_kg: float, stiffness_nprad: float) -> float:
        """Slip angle at which the tyres carry ``mass_kg`` through ``lateral_mps2``: the magic formula reversed."""
        peak_n = mass_kg * self.grip_mps2
        used = within(lateral_mps2 / self.grip_mps2, 1.0)
        return SHAPE * peak_n / stiffness_nprad * math.tan(math.asin(used) / SHAPE)

    def _tyre_forces_n(
        self, angle_rad: float, drift: float, curvature_1pm: float, accel_mps2: float
    ) -> tuple[float, float]:
        """Lateral forces of the front and the rear tyres, positive to the left."""
        axles = self.axles
        left_mps2 = math.sqrt(max(0.0, self.grip_mps2**2 - accel_mps2**2))
        front_slip = angle_rad - math.atan(drift + self.vehicle.wheelbase_m * curvature_1pm)
        front = _tyre_force_n(front_slip, axles.front_stiffness_nprad, axles.front_mass_kg * left_mps2)
        rear = _tyre_force_n(-math.atan(drift), axles.rear_stiffness_nprad, axles.rear_mass_kg * left_mps2)
        return front, rear

    def rates(self, pose: tuple[float, ...], motion: Actuation) -> tuple[float, ...]:
        """Time derivatives of (x, y, ψ, β, κ) while the actuators are in ``motion``."""
        speed_mps, accel_mps2, angle_rad, _, _ = motion
        _, _, yaw_rad, drift, curvature = pose
        axles = self.axles
        front, rear = self._tyre_forces_n(angle_rad, drift, curvature, accel_mps2)
        front *= math.cos(angle_rad)
        lateral_mps2 = (front + rear) / axles.mass_kg - self.bank_mps2
        turning = (axles.cg_to_front_m * front - axles.cg_to_rear_m * rear) / axles.yaw_inertia_kgm2
        settling_mps = max(speed_mps, SETTLES_AS_AT_MPS)
        sideways = lateral_mps2 - speed_mps * speed_mps * curvature - axles.cg_to_rear_m * turning
        cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
        return (
            speed_mps * (cos - drift * sin),
            speed_mps * (sin + drift * cos),
            speed_mps * curvature,
            (sideways - accel_mps2 * drift) / settling_mps,
            (turning - accel_mps2 * curvature) / settling_mps,
        )

    def _inner(self, state: PlantState) -> tuple[float, float]:
        """β and κ; for a state without them those of the steady state at its wheel angle."""
        if state.inner:
            drift, curvature = state.inner
            return drift, curvature
        speed_mps, accel_mps2, angle_rad, _, _ = self.actuators.at(state)
        curvature = self._quasi_static.curvature_1pm(angle_rad, speed_mps, accel_mps2)
        return self._drift(curvature * speed_mps * speed_mps + self.bank_mps2), curvature

    def _drift(self, lateral_mps2: float) -> float:
        """β at which the rear tyres carry their axle through ``lateral_mps2``."""
        axles = self.axles
        return -math.tan(self._slip_rad(lateral_mps2, axles.rear_mass_kg, axles.rear_stiffness_nprad))

    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        steps = math.ceil(h / self._max_step_s - 1e-6)
        for _ in range(steps):
            start, middle, end = self.actuators.during(state, accel_demand_mps2, h / steps)
            before = (state.x_m, state.y_m, state.yaw_rad, *self._inner(state))
            x_m, y_m, yaw_rad, drift, curvature = rk4(self.rates, before, start, middle, end, h / steps)
            state = state_after(state, end, h / steps, (x_m, y_m, yaw_rad), inner=(drift, curvature))
        return state


def _fastest_mode_mps2(axles: Axles) -> float:
    """Rate of the faster of the two lateral modes at low speed, times the speed."""
    front, rear = axles.front_stiffness_nprad, axles.rear_stiffness_nprad
    front_m, rear_m = axles.cg_to_front_m, axles.cg_to_rear_m
    across = (front + rear) / axles.mass_kg
    turning = (front_m**2 * front + rear_m**2 * rear) / axles.yaw_inertia_kgm2
    coupling2 = (front_m * front - rear_m * rear) ** 2 / (axles.mass_kg * axles.yaw_inertia_kgm2)
    return (across + turning) / 2 + math.sqrt((across - turning) ** 2 / 4 + coupling2)


def _tyre_force_n(slip_rad: float, stiffness_nprad: float, peak_n: float) -> float:
    """Lateral force of the tyres of an axle: the magic formula."""
    if peak_n == 0.0:
        return 0.0
    return peak_n * math.sin(SHAPE * math.atan(stiffness_nprad * slip_rad / (SHAPE * peak_n)))
