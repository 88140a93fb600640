"""Every lateral law on cars that differ from their vehicle file in ways that nothing declares.

Margins say how far a loop is from its limit for one linear error at a time. These are drives: a dead time of the
steering of 0 to 0.3 s, a lag three times as long, an angle that turns the car by 30 % more or less, all with the
noise of a camera, on the plants of Trepid and of CommonRoad, and on a plant with a lag and a noise behind the
wheels of which the vehicle file knows nothing. Where the folder of data sets has the model of comma's controls
challenge, the laws drive that too (:mod:`lab.bench.control.learned_plant`, for both).
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lab.bench.control.contestants import contestants, nominal, shipped_settings, with_tyres
from lab.bench.control.episode import Episode, Track, drive, road_of, s_curve
from lab.bench.control.learned_plant import LearnedPlant, SampledPlant
from lab.bench.real.sets import data_folder
from sim_harness.sweep.progress import SweepProgress
from sim_harness.world.plants.commonroad import UNDERSTEER
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import Vehicle

SPEEDS_MPS = (5.0, 10.0, 20.0, 30.0)
PLANTS = (Model.KINEMATIC, Model.SINGLE_TRACK, Model.COMMONROAD_DRIFT)
DELAYS_S = (0.0, 0.1, 0.2, 0.3)  # beyond the dead time of the file
LAG_FACTOR, GAINS = 3.0, (0.7, 1.3)
NOISE_M = 0.03
SIGHT_S = 0.5  # of the lane ahead of the axle: a dead time of 0.3 s needs as much of it
SAMPLED_LAGS_S, SAMPLED_DELAYS_S = (0.1, 0.2, 0.3), (0.0, 0.1, 0.2)
DECLARED_S = (0.1, 0.3)  # dead times that the vehicle file states
USUAL_LAG_S = 0.2  # of the sampled plant with them
LEARNED = "models/tinyphysics.onnx"  # in the folder of data sets
SAMPLED_MPS, SAMPLED_S, SAMPLED_NOISE_MPS2 = 20.0, 25.0, 0.1
SHARE = 1.1  # of the root mean square of the best law, within which the configured one should be


class Error(NamedTuple):
    """An error of the vehicle file, and the drives with it."""

    name: str
    episodes: tuple[Episode, ...]


def bench_robustness(seed: int, data: Path | None = None) -> dict[str, Any]:
    """Root mean square of the offset [m] by error of the vehicle file and law, and departures from the lane.

    A car departs where a wheel leaves the lane: at an offset of half of what the lane is wider than the car.
    ``data``: folder of data sets, which may hold the model of a learned car.
    """
    learned = data_folder(data) / LEARNED
    laws, errors = contestants(), list(errors_of_the_file(seed, learned if learned.is_file() else None))
    rows: dict[str, dict[str, float]] = {error.name: {} for error in errors}
    left: dict[str, dict[str, int]] = {error.name: {} for error in errors}
    drives = len(laws) * sum(len(error.episodes) for error in errors)
    with SweepProgress(drives, drives, noun="drives") as progress:
        for error in errors:
            for law, settings in laws.items():
                tracks = []
                for episode in error.episodes:
                    tracks.append(drive(episode, settings))
                    progress.step(1.0)
                rows[error.name][law] = round(max(map(_rms_m, tracks)), 4)
                left[error.name][law] = sum(track.worst_m > _room_m(nominal()) for track in tracks)
    law = shipped_settings().lateral.law.value
    worse = [name for name, row in rows.items() if row[law] > SHARE * min(row.values())]
    return {
        "law of the configuration": law,
        "drives of a law": drives // len(laws),
        "learned plant": "driven"
        if learned.is_file()
        else f"not driven: there is no {LEARNED} in the data sets",
        "errors where it is more than 1.1 times the best law": f"{len(worse)} of {len(rows)}",
        "departures": {one: sum(row[one] for row in left.values()) for one in laws},
        "errors with departures of the configured law": {n: row[law] for n, row in left.items() if row[law]},
        "largest root mean square of the offset [m]": rows,
    }


def errors_of_the_file(seed: int, learned: Path | None = None) -> Iterator[Error]:
    """The errors, each with its drives; ``learned``: the model of a learned car."""
    for delay_s in DELAYS_S:
        yield Error(f"dead time + {delay_s:g} s", _s_curves(seed, delay_s=delay_s))
    yield Error(f"lag x {LAG_FACTOR:g}", _s_curves(seed, lag_factor=LAG_FACTOR))
    for gain in GAINS:
        yield Error(f"turns x {gain:g}", _s_curves(seed, gain=gain))
    yield Error("dead time + 0.2 s, turns x 1.3", _s_curves(seed, delay_s=0.2, gain=1.3))
    known = nominal()
    for lag_s in SAMPLED_LAGS_S:
        for delay_s in SAMPLED_DELAYS_S:
            name = f"sampled, lag {lag_s:g} s, dead time + {delay_s:g} s"
            yield Error(name, _straights(seed, _sampled_plant(lag_s), known, delay_s=delay_s))
    kinds = {f"sampled, lag {USUAL_LAG_S:g} s": _sampled_plant(USUAL_LAG_S)}
    if learned is not None:
        kinds["learned"] = partial(LearnedPlant, path=learned)
    for kind, plant in kinds.items():
        for declared_s in DECLARED_S:
            stated = known.model_copy(update=dict(steering_delay_s=declared_s))
            for delay_s in SAMPLED_DELAYS_S:
                name = f"{kind}, dead time {declared_s:g} s declared + {delay_s:g} s"
                yield Error(name, _straights(seed, plant, stated, delay_s=delay_s))


def _sampled_plant(lag_s: float) -> Callable[..., Plant]:
    return partial(SampledPlant, lag_s=lag_s, noise_mps2=SAMPLED_NOISE_MPS2)


def _s_curves(
    seed: int, *, delay_s: float = 0.0, lag_factor: float = 1.0, gain: float = 1.0
) -> tuple[Episode, ...]:
    """The S at 2 m/s² at every speed on every plant."""
    return tuple(
        s_curve(
            speed_mps,
            _vehicle_file(model),
            PlantSettings(model=model, vehicle=_real(delay_s, lag_factor, gain)),
            sight_s=SIGHT_S,
            offset_noise_m=NOISE_M,
            seed=seed,
        )
        for model in PLANTS
        for speed_mps in SPEEDS_MPS
    )


def _straights(
    seed: int, make: Callable[..., Plant], known: Vehicle, *, delay_s: float
) -> tuple[Episode, ...]:
    """A straight road on a plant with noise; ``known`` is the vehicle file."""
    episode = Episode(
        road=road_of([(SAMPLED_MPS * (SAMPLED_S + 2.0), 0.0)]),
        speed_mps=SAMPLED_MPS,
        duration_s=SAMPLED_S,
        nominal=known,
        plant=PlantSettings(vehicle={"steering_delay_s": known.steering_delay_s + delay_s}),
        offset_noise_m=NOISE_M,
    )
    return tuple(
        replace(episode, seed=seed + number, make_plant=partial(make, seed=seed + number))
        for number in range(2)
    )


def _vehicle_file(model: Model) -> Vehicle:
    """The vehicle file of a car of ``model``: its understeer is stated, so that each error stands alone."""
    own = UNDERSTEER.get(model)
    known = with_tyres(nominal(), model)
    return known if own is None else known.model_copy(update=dict(understeer_gradient_rad_per_mps2=own))


def _real(delay_s: float, lag_factor: float, gain: float) -> dict[str, float]:
    """The fields of the true car: a wheelbase shorter by the gain turns the car by so much more."""
    known = nominal()
    return {
        "steering_delay_s": known.steering_delay_s + delay_s,
        "steering_lag_s": known.steering_lag_s * lag_factor,
        "wheelbase_m": known.wheelbase_m / gain,
    }


def _rms_m(track: Track) -> float:
    return math.sqrt(float(np.mean(np.square(track.offset_m))))


def _room_m(vehicle: Vehicle) -> float:
    return (vehicle.lane_width_m - vehicle.track_m) / 2
