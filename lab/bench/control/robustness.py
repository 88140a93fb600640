"""Every lateral law on cars that differ from their vehicle file in ways that nothing declares.

Margins say how far a loop is from its limit for one linear error at a time. These are drives: a dead time of the
steering of 0 to 0.3 s, a lag three times as long, an angle that turns the car by 30 % more or less, all with the
noise of a camera, on the plants of Trepid, and on a plant with a lag and a noise behind the wheels
(:mod:`lab.bench.control.sampled_plant`) of which the vehicle file knows nothing.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from lab.bench.control.contestants import contestants, nominal, shipped_settings, with_tyres
from lab.bench.control.episode import Episode, Track, drive, road_of, s_curve
from lab.bench.control.sampled_plant import SampledPlant
from sim_harness.sweep.progress import SweepProgress
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import Vehicle

SPEEDS_MPS = (5.0, 10.0, 20.0, 30.0)
PLANTS = (Model.KINEMATIC, Model.SINGLE_TRACK)
DELAYS_S = (0.0, 0.1, 0.2, 0.3)  # beyond the dead time of the file
LAG_FACTOR, GAINS = 3.0, (0.7, 1.3)
NOISE_M = 0.03
SIGHT_S = 0.5  # of the lane ahead of the axle: a dead time of 0.3 s needs as much of it
SAMPLED_LAGS_S, SAMPLED_DELAYS_S = (0.1, 0.2, 0.3), (0.0, 0.1, 0.2)
SAMPLED_MPS, SAMPLED_S, SAMPLED_NOISE_MPS2 = 20.0, 25.0, 0.1
SHARE = 1.1  # of the root mean square of the best law, within which the configured one should be


class Error(NamedTuple):
    """An error of the vehicle file, and the drives with it."""

    name: str
    episodes: tuple[Episode, ...]


def bench_robustness(seed: int) -> dict[str, Any]:
    """Root mean square of the offset [m] by error of the vehicle file and law, and departures from the lane.

    A car departs where a wheel leaves the lane: at an offset of half of what the lane is wider than the car.
    """
    laws, errors = contestants(), list(errors_of_the_file(seed))
    rows: dict[str, dict[str, float]] = {error.name: {} for error in errors}
    departures = dict.fromkeys(laws, 0)
    drives = len(laws) * sum(len(error.episodes) for error in errors)
    with SweepProgress(drives, drives, noun="drives") as progress:
        for error in errors:
            for law, settings in laws.items():
                tracks = []
                for episode in error.episodes:
                    tracks.append(drive(episode, settings))
                    progress.step(1.0)
                rows[error.name][law] = round(max(map(_rms_m, tracks)), 4)
                departures[law] += sum(track.worst_m > _room_m(nominal()) for track in tracks)
    law = shipped_settings().lateral.law.value
    worse = [name for name, row in rows.items() if row[law] > SHARE * min(row.values())]
    return {
        "law of the configuration": law,
        "drives of a law": drives // len(laws),
        "errors where it is more than 1.1 times the best law": f"{len(worse)} of {len(rows)}",
        "departures": departures,
        "largest root mean square of the offset [m]": rows,
    }


def errors_of_the_file(seed: int) -> Iterator[Error]:
    """The errors, each with its drives."""
    for delay_s in DELAYS_S:
        yield Error(f"dead time + {delay_s:g} s", _s_curves(seed, delay_s=delay_s))
    yield Error(f"lag x {LAG_FACTOR:g}", _s_curves(seed, lag_factor=LAG_FACTOR))
    for gain in GAINS:
        yield Error(f"turns x {gain:g}", _s_curves(seed, gain=gain))
    yield Error("dead time + 0.2 s, turns x 1.3", _s_curves(seed, delay_s=0.2, gain=1.3))
    for lag_s in SAMPLED_LAGS_S:
        for delay_s in SAMPLED_DELAYS_S:
            name = f"sampled, lag {lag_s:g} s, dead time + {delay_s:g} s"
            yield Error(name, _straights(seed, lag_s=lag_s, delay_s=delay_s))


def _s_curves(
    seed: int, *, delay_s: float = 0.0, lag_factor: float = 1.0, gain: float = 1.0
) -> tuple[Episode, ...]:
    """The S at 2 m/s² at every speed on every plant."""
    return tuple(
        s_curve(
            speed_mps,
            with_tyres(nominal(), model),
            PlantSettings(model=model, vehicle=_real(delay_s, lag_factor, gain)),
            sight_s=SIGHT_S,
            offset_noise_m=NOISE_M,
            seed=seed,
        )
        for model in PLANTS
        for speed_mps in SPEEDS_MPS
    )


def _straights(seed: int, *, lag_s: float, delay_s: float) -> tuple[Episode, ...]:
    """A straight road on the plant with noise."""
    plant = partial(SampledPlant, lag_s=lag_s, noise_mps2=SAMPLED_NOISE_MPS2, seed=seed)
    episode = Episode(
        road=road_of([(SAMPLED_MPS * (SAMPLED_S + 2.0), 0.0)]),
        speed_mps=SAMPLED_MPS,
        duration_s=SAMPLED_S,
        nominal=nominal(),
        plant=PlantSettings(vehicle=_real(delay_s, 1.0, 1.0)),
        make_plant=plant,
        offset_noise_m=NOISE_M,
    )
    return tuple(replace(episode, seed=seed + number) for number in range(2))


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
