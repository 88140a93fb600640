"""Cars as networks know them that learned from real drives: as any such model answers, and comma's from a file.

:class:`SampledPlant`: a model that was learned from drives gives the next lateral acceleration from the last ones
and draws it from a distribution, ten times a second, late and with noise, as the plant of comma's controls
challenge. It has no state that a vehicle file describes:

    a(k+1) = a(k) + clip((1 - e^(-h/T))·(a_steady - a(k)) + σ·n(k), ±0.5 m/s²)        h = 0.1 s

with the steady lateral acceleration a_steady of the present wheel angle, the lag T behind the wheels and n normal.

:class:`LearnedPlant`: ten times a second the network of the challenge gives a distribution over 1024 lateral
accelerations from the last 20 commands, speeds and lateral accelerations; one is drawn. Its command is a steering
torque in -2 to 2, which an unknown gain, lag and dead time separate from the lateral acceleration. So the plant has
no wheels: the lateral acceleration that the wheel angle would hold by the vehicle file, divided by the gain, is the
command. The gain is measured once, as a team measures its car: the settled expectation under a constant command.

The model is a user's to fetch: ``models/tinyphysics.onnx`` of github.com/commaai/controls_challenge, MIT, in the
folder of data sets. Inputs ``states`` (1, 20, 4) float32 = command, lateral acceleration by roll, speed,
acceleration; ``tokens`` (1, 20) int64; output (1, 20, 1024) logits.

Github.com/commaai/controls_challenge: 10 Hz, a lateral acceleration that changes by at most 0.5 m/s² a step.
"""

import math
from functools import cache
from pathlib import Path

import numpy as np
import onnxruntime

from sim_harness.world.plants.lateral import LateralPlant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.plants.state import PlantState
from trepid.bounds import within
from trepid.car.vehicle import Vehicle
from trepid.config import InputError
from trepid.types import Array

STEP_S = 0.1
LARGEST_STEP_MPS2 = 0.5
STEPS = 1000  # of noise, which then repeats


class SampledPlant(LateralPlant):
    """The plant. ``inner`` = (lateral acceleration, number of the sample)."""

    def __init__(
        self, vehicle: Vehicle, settings: PlantSettings, *, lag_s: float, noise_mps2: float, seed: int
    ) -> None:
        """``lag_s``: T; ``noise_mps2``: σ of a sample."""
        super().__init__(vehicle, settings)
        self._share = 1.0 - math.exp(-STEP_S / lag_s)
        self._noise_mps2 = (noise_mps2 * np.random.default_rng(seed).standard_normal(STEPS)).tolist()

    def answer(self, state: PlantState, curvature_1pm: float, h: float) -> tuple[float, ...]:
        """That of the sample in which the step begins."""
        sample = math.floor(state.clock_s / STEP_S + 1e-6)
        if state.inner and sample == state.inner[1]:
            return state.inner
        return self._next_inner(state, curvature_1pm * state.speed_mps**2, sample)

    def _next_inner(self, state: PlantState, steady_mps2: float, sample: int) -> tuple[float, ...]:
        """``inner`` of ``sample``, where the wheels would hold ``steady_mps2``."""
        before_mps2 = self.lateral_mps2(state)
        change_mps2 = self._share * (steady_mps2 - before_mps2) + self._noise_mps2[sample % STEPS]
        return before_mps2 + within(change_mps2, LARGEST_STEP_MPS2), float(sample)


CONTEXT = 20  # samples that the network sees
VALUES_MPS2 = np.linspace(-5.0, 5.0, 1024)  # lateral acceleration of a token
LARGEST_COMMAND = 2.0
PROBED_COMMAND, PROBED_STEPS = 0.3, 60  # of the measurement of the gain
MOTION = 3  # numbers of ``PlantState.inner`` per sample of the context: command, speed, lateral acceleration


@cache
def session(path: Path) -> onnxruntime.InferenceSession:
    """The network in the file. Raises InputError where it is no such network."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    try:
        found = onnxruntime.InferenceSession(str(path), options, ["CPUExecutionProvider"])
    except Exception as error:  # ONNX Runtime raises classes of its own for every kind of damage
        raise InputError(f"{path}: no ONNX model: {str(error).splitlines()[0]}") from error
    names = {one.name for one in found.get_inputs()}
    if names != {"states", "tokens"}:
        raise InputError(f"{path}: inputs {', '.join(sorted(names))}; a model of a car has states and tokens")
    return found


class LearnedPlant(SampledPlant):
    """The plant. ``inner`` = (lateral acceleration, number of the sample, and the context, oldest first)."""

    def __init__(self, vehicle: Vehicle, settings: PlantSettings, *, path: Path, seed: int) -> None:
        """``path``: of the network."""
        super().__init__(vehicle, settings, lag_s=1.0, noise_mps2=0.0, seed=seed)
        self._network, self._seed = session(path), seed
        self._gain_at: dict[float, tuple[float, float]] = {}

    def _next_inner(self, state: PlantState, steady_mps2: float, sample: int) -> tuple[float, ...]:
        """The drawn lateral acceleration, and the context with the present command."""
        speed_mps, lateral_mps2 = state.speed_mps, self.lateral_mps2(state)
        gain_mps2, bias_mps2 = self._calibration(round(speed_mps))
        command = within((steady_mps2 - bias_mps2) / gain_mps2, LARGEST_COMMAND)
        old = state.inner[2:] or (0.0, speed_mps, 0.0) * CONTEXT
        context = (*old[MOTION:], command, speed_mps, lateral_mps2)
        share = self._shares(np.reshape(context, (CONTEXT, MOTION)))
        drawn_mps2 = float(np.random.default_rng((self._seed, sample)).choice(VALUES_MPS2, p=share))
        change_mps2 = within(drawn_mps2 - lateral_mps2, LARGEST_STEP_MPS2)
        return (lateral_mps2 + change_mps2, float(sample), *context)

    def _shares(self, context: Array) -> Array:
        """Probability of every value of the next lateral acceleration, shape (1024,)."""
        command, speed_mps, lateral_mps2 = context.T
        zero = np.zeros(CONTEXT)
        states = np.stack([command, zero, speed_mps, zero], axis=1)[None].astype(np.float32)
        tokens = np.digitize(np.clip(lateral_mps2, -5.0, 5.0), VALUES_MPS2, right=True)[None].astype(np.int64)
        logits = np.asarray(self._network.run(None, {"states": states, "tokens": tokens})[0], float)[0, -1]
        share = np.exp(logits - logits.max())
        return np.asarray(share / share.sum(), float)

    def _calibration(self, speed_mps: float) -> tuple[float, float]:
        """Lateral acceleration [m/s²] per command, and without one, at about ``speed_mps``."""
        if speed_mps not in self._gain_at:
            left, right = (self._steady_mps2(sign * PROBED_COMMAND, speed_mps) for sign in (1.0, -1.0))
            gain_mps2 = (left - right) / (2 * PROBED_COMMAND)
            if not gain_mps2 > 0.0:
                raise InputError(
                    f"the learned car does not turn left by a positive command at {speed_mps} m/s"
                )
            self._gain_at[speed_mps] = gain_mps2, (left + right) / 2
        return self._gain_at[speed_mps]

    def _steady_mps2(self, command: float, speed_mps: float) -> float:
        """Expectation [m/s²] after a constant command."""
        context = np.tile((command, speed_mps, 0.0), (CONTEXT, 1))
        for _ in range(PROBED_STEPS):
            mean_mps2 = float(self._shares(context) @ VALUES_MPS2)
            before_mps2 = context[-1, 2]
            mean_mps2 = before_mps2 + within(mean_mps2 - before_mps2, LARGEST_STEP_MPS2)
            context = np.vstack([context[1:], (command, speed_mps, mean_mps2)])
        return math.fsum(context[:, 2]) / CONTEXT
