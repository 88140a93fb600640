"""Weights of the confidence of `cv`: `python -m lab.bench.perception.fit_confidence --seed 1 --seed 2`.

Prints the section ``confidence`` of config/perception.yaml; with ``--estimator segments`` that of
config/segments.yaml. The samples are the clips of the harness set with
their true lanes; the same images upside down and on their side, where every lane is wrong; and a third of the
clips on trodden snow, whose patches have edges of their own.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Annotated, Protocol

import numpy as np
import typer

from lab.bench.perception.clips import GAP, ClipCase, ClipFrame, harness_set, moments
from lab.bench.perception.scores import TOLERANCE_RAD
from perception.estimators import lane_cv_settings
from perception.lane.lane_cv import LaneCv
from perception.lane.rating import Features
from perception.lane.settings import ConfidenceSettings
from perception.segments.estimator import NAME as SEGMENTS
from perception.segments.estimator import build as build_segments
from sim_harness.world.roads.drawn import SNOW_COVER
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Array, Image

TURNS: tuple[Callable[[Image], Image], ...] = (np.flipud, np.rot90, lambda image: np.rot90(image, 3))
TURNED_EVERY, TURNED_FRAMES = 10, 14  # every tenth clip is turned; number of its first frames
SNOWED_UP_EVERY = 3  # every third case is repeated on snow
RIDGE = 1.0  # prior standard deviation of a weight
STEPS = 30


class Finder(Protocol):
    """An estimator that states the features of its confidence."""

    @property
    def features(self) -> Features | None:
        """Those of the last confidence; None without a lane."""

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The estimate of ``frame``."""
        ...


def finder_for(name: str, camera: Camera, vehicle: Vehicle) -> Finder:
    """A fresh estimator ``name`` for ``camera``. Raises InputError."""
    if name == "cv":
        return LaneCv(lane_cv_settings(), camera, vehicle)
    if name == SEGMENTS:
        return build_segments(camera, vehicle, lane_cv_settings())
    raise InputError(f"--estimator {name}: expected cv or {SEGMENTS}")


def cases(seed: int) -> list[ClipCase]:
    """The harness set without its gaps, and every third case again on trodden snow."""
    shown = [case for case in harness_set(seed) if case.condition != GAP]
    rng = np.random.default_rng((seed, 62))
    snowed_up = [
        replace(case, snow_cover=float(rng.uniform(*SNOW_COVER))) for case in shown[::SNOWED_UP_EVERY]
    ]
    return shown + snowed_up


def samples(clips: Iterable[Iterable[ClipFrame]], make: Callable[[], Finder]) -> tuple[Array, Array]:
    """Features of each confidence, (n, features), and whether its angle was within two degrees, (n,)."""
    inputs: list[Features] = []
    right: list[bool] = []
    for number, clip in enumerate(clips):
        shown = list(clip)
        for features, estimate, moment in _estimates(shown, make(), lambda image: image):
            if not estimate.reason:  # detected in this frame
                inputs.append(features)
                right.append(_right(estimate, moment.truth))
        if number % TURNED_EVERY == 0:
            for turn in TURNS:
                turned = [found for found, _, _ in _estimates(shown[:TURNED_FRAMES], make(), turn)]
                inputs += turned
                right += [False] * len(turned)
    return np.array(inputs), np.array(right, float)


def _estimates(
    shown: list[ClipFrame], finder: Finder, turn: Callable[[Image], Image]
) -> Iterator[tuple[Features, SteeringEstimate, ClipFrame]]:
    for moment in shown:
        t_s = moment.frame.t_s
        image = np.ascontiguousarray(turn(moment.frame.image))
        estimate = finder.step(Frame(t_s=t_s, image=image), moment.state, now_s=t_s)
        if finder.features is not None:
            yield finder.features, estimate, moment


def _right(estimate: SteeringEstimate, truth: SteeringEstimate) -> bool:
    assert estimate.road_wheel_angle_rad is not None and truth.road_wheel_angle_rad is not None
    return abs(estimate.road_wheel_angle_rad - truth.road_wheel_angle_rad) <= TOLERANCE_RAD


def fit_weights(inputs: Array, right: Array) -> Array:
    """Weights of the logistic regression by Newton's method, with a Gaussian prior on all but the bias."""
    weights = np.zeros(inputs.shape[1])
    prior = np.diag([0.0] + [1 / RIDGE**2] * (len(weights) - 1))
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-inputs @ weights))
        slope = inputs.T @ (right - chance) - prior @ weights
        bend = (inputs.T * (chance * (1 - chance))) @ inputs + prior
        weights = weights + np.linalg.solve(bend, slope)
    return weights


def main(
    seed: Annotated[list[int], typer.Option(help="Seed of a harness set; may be repeated.")],
    estimator: Annotated[str, typer.Option(help="cv or segments.")] = "cv",
    every: Annotated[int, typer.Option(min=1, help="Use every so-manieth clip.")] = 1,
) -> None:
    """Render the sets, estimate, fit, print the weights."""
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    clips = (moments(case, camera, vehicle) for one in seed for case in cases(one)[::every])
    inputs, right = samples(clips, lambda: finder_for(estimator, camera, vehicle))
    print(f"# {len(right)} samples, {100 * right.mean():.1f} % right")
    for name, weight in zip(ConfidenceSettings.model_fields, fit_weights(inputs, right), strict=True):
        print(f"  {name}: {weight:.2f}")


if __name__ == "__main__":
    typer.run(main)
