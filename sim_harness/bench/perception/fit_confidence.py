"""Weights of the confidence of `cv`: `python -m sim_harness.bench.perception.fit_confidence --seed 1 --seed 2`.

Prints the section ``confidence`` of config/perception.yaml. What is right is known on the clips of the harness set;
pictures on their side or upside down, in which every lane is wrong, teach it doubt where nothing of the set would,
and so do some of the clips once more under trodden snow, whose patches have edges of their own.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import Annotated

import numpy as np
import typer

from perception.estimators import lane_cv_settings
from perception.lane.confidence import ConfidenceSettings
from perception.lane.lane_cv import LaneCv
from sim_harness.bench.perception.clips import GAP, Case, Moment, harness_set, moments
from sim_harness.bench.perception.scores import TOLERANCE_RAD
from sim_harness.world.roads.drawn import SNOW_COVER
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, SteeringEstimate
from trepid.types import Array, Image
from trepid.vehicle import Vehicle

TURNS: tuple[Callable[[Image], Image], ...] = (np.flipud, np.rot90, lambda image: np.rot90(image, 3))
TURNED_EVERY, TURNED_FRAMES = 10, 14  # clips of which, and how many of their first frames
SNOWED_UP_EVERY = 3  # cases of which are looked at once more
RIDGE = 1.0  # standard deviation of a weight before anything is seen: about 1
STEPS = 30


def cases(seed: int) -> list[Case]:
    """The harness set but for its gaps, and every third of it once more under trodden snow."""
    shown = [case for case in harness_set(seed) if case.condition != GAP]
    rng = np.random.default_rng((seed, 62))
    snowed_up = [
        replace(case, snow_cover=float(rng.uniform(*SNOW_COVER))) for case in shown[::SNOWED_UP_EVERY]
    ]
    return shown + snowed_up


def samples(clips: Iterable[Iterable[Moment]], camera: Camera, vehicle: Vehicle) -> tuple[Array, Array]:
    """What each confidence rests on, (n, features), and whether its angle was within two degrees, (n,)."""
    rests_on: list[tuple[float, ...]] = []
    right: list[bool] = []
    for number, clip in enumerate(clips):
        shown = list(clip)
        for grounds, estimate, moment in _looks(shown, camera, vehicle, lambda image: image):
            if not estimate.reason:  # seen, not remembered
                rests_on.append(grounds)
                right.append(_right(estimate, moment.truth))
        if number % TURNED_EVERY == 0:
            for turn in TURNS:
                turned = [grounds for grounds, _, _ in _looks(shown[:TURNED_FRAMES], camera, vehicle, turn)]
                rests_on += turned
                right += [False] * len(turned)
    return np.array(rests_on), np.array(right, float)


def _looks(
    shown: list[Moment], camera: Camera, vehicle: Vehicle, turn: Callable[[Image], Image]
) -> Iterator[tuple[tuple[float, ...], SteeringEstimate, Moment]]:
    finder = LaneCv(lane_cv_settings(), camera, vehicle)
    for moment in shown:
        t_s = moment.frame.t_s
        image = np.ascontiguousarray(turn(moment.frame.image))
        estimate = finder.step(Frame(t_s=t_s, image=image), moment.state, now_s=t_s)
        if finder.rests_on is not None:
            yield finder.rests_on, estimate, moment


def _right(estimate: SteeringEstimate, truth: SteeringEstimate) -> bool:
    assert estimate.road_wheel_angle_rad is not None and truth.road_wheel_angle_rad is not None
    return abs(estimate.road_wheel_angle_rad - truth.road_wheel_angle_rad) <= TOLERANCE_RAD


def fitted(rests_on: Array, right: Array) -> Array:
    """Weights of the logistic regression by Newton's method, with a Gaussian prior on all but the bias."""
    weights = np.zeros(rests_on.shape[1])
    prior = np.diag([0.0] + [1 / RIDGE**2] * (len(weights) - 1))
    for _ in range(STEPS):
        chance = 1 / (1 + np.exp(-rests_on @ weights))
        slope = rests_on.T @ (right - chance) - prior @ weights
        bend = (rests_on.T * (chance * (1 - chance))) @ rests_on + prior
        weights = weights + np.linalg.solve(bend, slope)
    return weights


def main(seed: Annotated[list[int], typer.Option(help="Of the harness sets.")]) -> None:
    """Draw the sets, look at them, fit, print."""
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    clips = (moments(case, camera, vehicle) for one in seed for case in cases(one))
    rests_on, right = samples(clips, camera, vehicle)
    print(f"# {len(right)} looks, {100 * right.mean():.1f} % right")
    for name, weight in zip(ConfidenceSettings.model_fields, fitted(rests_on, right), strict=True):
        print(f"  {name}: {weight:.2f}")


if __name__ == "__main__":
    typer.run(main)
