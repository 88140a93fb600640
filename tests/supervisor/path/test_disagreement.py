"""A difference of two views counts as far as the deviations that they state do not account for it."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from supervisor.inputs.validation import ValidatedEstimate, at_distance
from supervisor.path.fusion import Fusion, FusionResult
from supervisor.supervisor import SupervisorSettings
from trepid.clothoid import Lane, Motion
from trepid.config import CONFIG_DIR, load
from trepid.messages import SIGMA_AHEAD_M

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).fusion
VAGUE_M = (0.3, 0.3, 0.5, 2.0, 4.0, 8.0)  # of a network that knows little of the curvature
SURE_M = (0.02, 0.02, 0.03, 0.05, 0.1, 0.2)
speeds = st.floats(1.0, 35.0)
deviations = st.lists(st.floats(0.0, 20.0), min_size=6, max_size=6).map(tuple)


def fuse(
    bend_1pm: float,
    speed_mps: float,
    *,
    of_cv: tuple[float, ...],
    of_cnn: tuple[float, ...],
    aside_m: float = 0.0,
) -> FusionResult:
    """A straight lane of cv, and one of cnn that bends and lies ``aside_m`` to the right."""
    views = [
        ValidatedEstimate(
            estimator=name,
            age_s=0.0,
            t_s=0.0,
            broken=False,
            confidence=0.95,
            lane=Lane(offset_m, 0.0, curvature_1pm, 0.0),
            lookahead_m=8.0,
            width_error_m=0.0,
            measures_width=True,
            ahead_sigma_m=sigma_m,
        )
        for name, curvature_1pm, offset_m, sigma_m in (
            ("cv", 0.0, 0.0, of_cv),
            ("cnn", bend_1pm, aside_m, of_cnn),
        )
    ]
    return Fusion(SETTINGS).step(views, Motion(speed_mps, 0.0), now_s=0.0)


def test_at_speed_the_noise_of_a_vague_curvature_is_no_second_road() -> None:
    found = fuse(0.003, 25.0, of_cv=SURE_M, of_cnn=VAGUE_M)
    assert found.disagreement_mps2 == pytest.approx(0.003 * 25.0**2)
    assert found.weighted_disagreement_mps2 == 0.0


@pytest.mark.parametrize("speed_mps", [8.0, 15.0, 25.0, 33.0])
def test_a_bend_of_small_deviation_on_a_straight_road_is_a_second_road_at_every_speed(
    speed_mps: float,
) -> None:
    found = fuse(3.0 / speed_mps**2, speed_mps, of_cv=SURE_M, of_cnn=SURE_M)
    assert found.weighted_disagreement_mps2 > 2.0


@pytest.mark.parametrize("speed_mps", [0.0, 1.0, 3.0, 7.9])
def test_two_roads_contradict_each_other_as_much_before_a_slow_car(speed_mps: float) -> None:
    found = fuse(0.04, speed_mps, of_cv=SURE_M, of_cnn=SURE_M)
    at_look_ahead = fuse(0.04, SETTINGS.min_lookahead_m / SETTINGS.lookahead_s, of_cv=SURE_M, of_cnn=SURE_M)
    assert found.weighted_disagreement_mps2 == pytest.approx(at_look_ahead.weighted_disagreement_mps2)


@given(st.floats(-0.05, 0.05), speeds, deviations, deviations)
def test_a_larger_deviation_never_raises_and_a_larger_difference_never_lowers_the_disagreement(
    bend_1pm: float, speed_mps: float, of_cv: tuple[float, ...], of_cnn: tuple[float, ...]
) -> None:
    def disagreement(bend_1pm: float, factor: float) -> float:
        vaguer = tuple(factor * sigma for sigma in of_cnn)
        found = fuse(bend_1pm, speed_mps, of_cv=of_cv, of_cnn=vaguer)
        return found.weighted_disagreement_mps2

    now = disagreement(bend_1pm, 1.0)
    assert disagreement(bend_1pm, 1.5) <= now + 1e-12
    assert disagreement(1.5 * bend_1pm, 1.0) >= now - 1e-12


@given(st.floats(-0.05, 0.05), speeds, deviations)
def test_without_a_stated_deviation_the_difference_counts_in_full(
    bend_1pm: float, speed_mps: float, sigma_m: tuple[float, ...]
) -> None:
    silent = fuse(bend_1pm, speed_mps, of_cv=(), of_cnn=())
    stated = fuse(bend_1pm, speed_mps, of_cv=(), of_cnn=sigma_m)
    assert silent.weighted_disagreement_mps2 == pytest.approx(silent.disagreement_mps2)
    assert stated.weighted_disagreement_mps2 <= silent.weighted_disagreement_mps2


@given(st.floats(-2.0, 2.0), deviations, deviations)
def test_a_difference_of_the_offsets_counts_beyond_an_unusual_deviation(
    aside_m: float, of_cv: tuple[float, ...], of_cnn: tuple[float, ...]
) -> None:
    """The view of less confidence has a share of 1 here: both state the same confidence."""
    found = fuse(0.0, 8.0, of_cv=of_cv, of_cnn=of_cnn, aside_m=aside_m)
    explained_m = max(0.0, 2.0 * math.hypot(of_cv[0], of_cnn[0]) - 0.2)
    assert found.weighted_separation_m == pytest.approx(max(0.0, abs(aside_m) - explained_m))


def test_a_lane_held_by_one_line_and_one_measured_by_both_are_one_road_on_a_wide_lane() -> None:
    """4.5 m wide: with an assumed width of 3.5 ± 0.35 m the centre is 0.5 m off, and its deviation says so."""
    by_one_line, measured = (0.175, *SURE_M[1:]), (0.17, *SURE_M[1:])
    assert fuse(0.0, 6.0, of_cv=by_one_line, of_cnn=measured, aside_m=0.45).weighted_separation_m < 0.2
    assert fuse(0.0, 6.0, of_cv=SURE_M, of_cnn=SURE_M, aside_m=0.45).weighted_separation_m == 0.45


@given(deviations, st.floats(0.0, 60.0))
def test_the_deviation_lies_between_those_of_the_neighbouring_distances(
    sigma_m: tuple[float, ...], ahead_m: float
) -> None:
    near = max((x for x in SIGMA_AHEAD_M if x <= ahead_m), default=0.0)
    far = min((x for x in SIGMA_AHEAD_M if x >= ahead_m), default=SIGMA_AHEAD_M[-1])
    ends = [sigma_m[SIGMA_AHEAD_M.index(x)] for x in (near, far)]
    assert min(ends) - 1e-9 <= at_distance(sigma_m, ahead_m) <= max(ends) + 1e-9
