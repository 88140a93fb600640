"""The samplers of populations follow their published equations, continue a study, and find a minimum."""

import math

import numpy as np
import optuna
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from optuna.samplers import RandomSampler

from sim_harness.tuning import populations
from sim_harness.tuning.study import SAMPLERS, check_sampler
from trepid.config import InputError

optuna.logging.set_verbosity(optuna.logging.ERROR)
POINT = arrays(float, 3, elements=st.floats(0, 1))
POPULATIONS = ("bat", "bat-harmony", "pso", "de", "ga")


def test_an_unknown_sampler_is_refused_with_the_known_ones() -> None:
    with pytest.raises(InputError, match=r"--sampler batt: did you mean 'bat'"):
        check_sampler("batt")


@given(POINT, POINT, POINT, st.floats(0, 1))
def test_a_bat_flies_by_the_frequency_times_its_way_from_the_best(v, x, best, beta) -> None:
    expected = [vi + (xi - bi) * (0.0 + (2.0 - 0.0) * beta) for vi, xi, bi in zip(v, x, best, strict=True)]
    assert populations.bat_velocity(v, x, best, beta) == pytest.approx(expected)


def test_a_bat_grows_quiet_and_calls_more_often_with_each_accepted_step() -> None:
    assert [populations.loudness(t) for t in range(3)] == pytest.approx([1.0, 0.9, 0.81])
    assert populations.pulse_rate(0) == 0.0
    assert populations.pulse_rate(2) == pytest.approx(0.5 * (1 - math.exp(-1.8)))


@given(POINT, POINT, POINT)
def test_a_particle_at_its_own_and_the_common_best_only_loses_speed(v, x, r) -> None:
    assert populations.swarm_velocity(v, x, x, x, r, r) == pytest.approx(0.7298 * v)


@given(POINT, POINT, POINT, POINT, POINT, POINT)
def test_a_particle_is_pulled_by_both_bests(v, x, own, best, r1, r2) -> None:
    expected = 0.7298 * v + 1.49618 * r1 * (own - x) + 1.49618 * r2 * (best - x)
    assert populations.swarm_velocity(v, x, own, best, r1, r2) == pytest.approx(expected)


@given(POINT, POINT, POINT, POINT, arrays(bool, 3))
def test_a_differential_trial_has_the_mutant_where_it_crosses_and_its_target_elsewhere(
    x, a, b, c, crosses
) -> None:
    for i, value in enumerate(populations.differential_trial(x, a, b, c, crosses)):
        assert value == pytest.approx(a[i] + 0.5 * (b[i] - c[i]) if crosses[i] else x[i])


@given(POINT, POINT, POINT)
def test_a_child_is_in_the_box_of_its_parents_widened_by_half_of_their_distance(a, b, share) -> None:
    child, size = populations.blend(a, b, share), np.abs(a - b)
    assert np.all(child >= np.minimum(a, b) - 0.5 * size - 1e-12)
    assert np.all(child <= np.maximum(a, b) + 0.5 * size + 1e-12)
    assert populations.blend(a, b, share) == pytest.approx(populations.blend(b, a, share))


def test_a_harmony_of_one_note_is_that_note_within_the_bandwidth_or_random() -> None:
    rng, note = np.random.default_rng(0), np.full(4000, 0.5)
    tuned = np.abs(populations.improvise([note], rng) - 0.5) <= 0.05
    assert tuned.mean() == pytest.approx(0.9 + 0.1 * 0.1, abs=0.02)


def sphere(trial: optuna.Trial) -> float:
    return sum((trial.suggest_float(f"x{i}", -5.0, 5.0) - 1.0) ** 2 for i in range(4))


def least(sampler: optuna.samplers.BaseSampler, trials: int = 150) -> float:
    study = optuna.create_study(sampler=sampler)
    study.optimize(sphere, n_trials=trials)
    return study.best_value


@pytest.mark.parametrize("name", POPULATIONS)
def test_a_population_finds_a_lower_point_of_a_bowl_than_random_search(name: str) -> None:
    pairs = [(least(SAMPLERS[name](seed)), least(RandomSampler(seed=seed))) for seed in range(3)]
    assert np.mean([math.log(found / random) for found, random in pairs]) < 0.0


@pytest.mark.parametrize("name", POPULATIONS)
def test_a_study_goes_on_with_another_sampler_object(name: str) -> None:
    study = optuna.create_study(sampler=SAMPLERS[name](1))
    study.optimize(sphere, n_trials=40)
    before = study.best_value
    study.sampler = SAMPLERS[name](2)
    study.optimize(sphere, n_trials=80)
    assert study.best_value < before
    members = [trial.system_attrs.get(populations.MEMBER) for trial in study.trials[1:]]
    assert members == [i % 12 for i in range(len(members))]


@pytest.mark.parametrize("name", POPULATIONS)
def test_points_stay_within_their_ranges_also_on_a_logarithmic_one(name: str) -> None:
    def slope(trial: optuna.Trial) -> float:
        return trial.suggest_float("rate", 1e-5, 1e-1, log=True) + trial.suggest_float(
            "y", 2.0, 3.0, step=0.25
        )

    study = optuna.create_study(sampler=SAMPLERS[name](0))
    study.optimize(slope, n_trials=60)
    assert all(1e-5 <= trial.params["rate"] <= 1e-1 for trial in study.trials)
    assert {trial.params["y"] for trial in study.trials} <= {2.0, 2.25, 2.5, 2.75, 3.0}
