"""A car as a sequence model knows it: its lateral acceleration changes ten times a second, late and with noise.

A model that was learned from drives gives the next lateral acceleration from the last ones and draws it from a
distribution, as the plant of comma's controls challenge. It has no state that a vehicle file describes:

    a(k+1) = a(k) + clip((1 - e^(-h/T))·(a_steady - a(k)) + σ·n(k), ±0.5 m/s²)        h = 0.1 s

with the steady lateral acceleration a_steady of the present wheel angle, the lag T behind the wheels and n normal.

Github.com/commaai/controls_challenge: 10 Hz, a lateral acceleration that changes by at most 0.5 m/s² a step.
"""

import math

import numpy as np

from sim_harness.world.plants.actuators import state_after
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.bounds import within
from trepid.car.vehicle import Vehicle

STEP_S = 0.1
LARGEST_STEP_MPS2 = 0.5
LEAST_MPS = 1.0  # below it the yaw rate is that of this speed
STEPS = 1000  # of noise, which then repeats


class SampledPlant(KinematicPlant):
    """The plant. ``inner`` = (lateral acceleration, number of the sample)."""

    def __init__(
        self, vehicle: Vehicle, settings: PlantSettings, *, lag_s: float, noise_mps2: float, seed: int
    ) -> None:
        """``lag_s``: T; ``noise_mps2``: σ of a sample."""
        super().__init__(vehicle, settings)
        self._share = 1.0 - math.exp(-STEP_S / lag_s)
        self._noise_mps2 = (noise_mps2 * np.random.default_rng(seed).standard_normal(STEPS)).tolist()

    def yaw_rate_radps(self, state: PlantState) -> float:
        """ψ' = a/v."""
        if not state.inner:
            return super().yaw_rate_radps(state)
        return state.inner[0] / max(state.speed_mps, LEAST_MPS)

    def advance(self, state: PlantState, accel_demand_mps2: float, h: float) -> PlantState:
        """``state`` after ``h`` [s] with the lateral acceleration of the sample in which it begins."""
        lateral_mps2, inner = self.yaw_rate_radps(state) * max(state.speed_mps, LEAST_MPS), state.inner
        sample = math.floor(state.clock_s / STEP_S + 1e-6)
        if not inner or sample != inner[1]:
            inner = self._next_inner(state, lateral_mps2, sample)
            lateral_mps2 = inner[0]
        end = self.actuators.after(state, accel_demand_mps2, h)
        turn_rad, way_m = lateral_mps2 / max(state.speed_mps, LEAST_MPS) * h, state.speed_mps * h
        middle_rad = state.yaw_rad + turn_rad / 2
        pose = (
            state.x_m + way_m * math.cos(middle_rad),
            state.y_m + way_m * math.sin(middle_rad),
            state.yaw_rad + turn_rad,
        )
        return state_after(state, end, h, pose, inner=inner)

    def _next_inner(self, state: PlantState, lateral_mps2: float, sample: int) -> tuple[float, ...]:
        """``inner`` of ``sample`` after the lateral acceleration of the one before."""
        angle_rad, speed_mps = self.actuators.at(state).tyre_angle_rad, state.speed_mps
        steady_mps2 = self.curvature_1pm(angle_rad, speed_mps) * speed_mps * speed_mps
        change_mps2 = self._share * (steady_mps2 - lateral_mps2) + self._noise_mps2[sample % STEPS]
        return lateral_mps2 + within(change_mps2, LARGEST_STEP_MPS2), float(sample)
