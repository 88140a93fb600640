"""Edges over the way: their mean doubt, which patches add to and standstill keeps, and the way since lines."""

import math

import pytest

from supervisor.inputs.consistency import EDGES_M, LONG_UNMARKED_M, Edges, EdgeWay
from supervisor.inputs.validation import ValidatedEstimate
from trepid.clothoid import Motion

SPEED_MPS, DT_S = 5.0, 0.04


def estimate_of(confidence: float | None, *, marked: bool | None) -> ValidatedEstimate:
    return ValidatedEstimate("cv", 0.0, 0.0, False, confidence, None, 8.0, None, True, marked=marked)


def drive_edges(
    edges: Edges, estimates: list[ValidatedEstimate], *, way_m: float, from_s: float = 0.0
) -> EdgeWay:
    frames = round(way_m / (SPEED_MPS * DT_S))
    edges.step(estimates, Motion(0.0, 0.0), now_s=from_s)
    return [
        edges.step(estimates, Motion(SPEED_MPS, 0.0), now_s=from_s + n * DT_S) for n in range(1, frames + 1)
    ][-1]


def doubt(edges: Edges, estimates: list[ValidatedEstimate], *, way_m: float, from_s: float = 0.0) -> float:
    return drive_edges(edges, estimates, way_m=way_m, from_s=from_s).doubt


@pytest.mark.parametrize("confidence", [0.2, 0.6, 0.95])
def test_the_mean_doubt_converges_over_the_distance(confidence: float) -> None:
    found = doubt(Edges(), [estimate_of(confidence, marked=False)], way_m=EDGES_M)
    assert found == pytest.approx((1 - confidence) * (1 - math.exp(-1)))


def test_lines_of_any_confidence_have_no_doubt() -> None:
    assert doubt(Edges(), [estimate_of(0.3, marked=True)], way_m=50.0) == 0.0


def test_doubt_decays_over_lines_by_distance_and_not_at_standstill() -> None:
    edges, lines = Edges(), [estimate_of(0.99, marked=True)]
    doubt(edges, [estimate_of(0.5, marked=False)], way_m=60.0)
    before, *standing = [edges.step(lines, Motion(0.0, 0.0), now_s=100.0 + n).doubt for n in range(60)]
    assert before > 0.45
    assert set(standing) == {before}
    assert doubt(edges, lines, way_m=EDGES_M, from_s=200.0) == pytest.approx(before * math.exp(-1))


def test_without_an_estimator_of_marking_the_doubt_is_unchanged() -> None:
    edges = Edges()
    before = doubt(edges, [estimate_of(0.5, marked=False)], way_m=30.0)
    assert doubt(edges, [estimate_of(0.9, marked=None)], way_m=30.0, from_s=10.0) == before


def test_edges_of_unknown_confidence_have_full_doubt() -> None:
    assert doubt(Edges(), [estimate_of(None, marked=False)], way_m=200.0) == pytest.approx(1.0, abs=1e-3)


def test_the_way_without_lines_counts_from_the_last_line() -> None:
    edges = Edges()
    assert drive_edges(edges, [estimate_of(0.9, marked=True)], way_m=5.0).unmarked_m == 0.0
    assert drive_edges(edges, [estimate_of(0.9, marked=False)], way_m=7.0, from_s=10.0).unmarked_m == (
        pytest.approx(7.0)
    )


@pytest.mark.parametrize("marked", [False, None])
def test_a_road_on_which_no_line_has_been_seen_is_unmarked_from_its_start(marked: bool | None) -> None:
    assert drive_edges(Edges(), [estimate_of(0.9, marked=marked)], way_m=1.0).unmarked_m == LONG_UNMARKED_M


def test_the_way_without_lines_does_not_grow_at_standstill_and_is_bounded() -> None:
    edges, unmarked = Edges(), [estimate_of(0.9, marked=False)]
    drive_edges(edges, [estimate_of(0.9, marked=True)], way_m=1.0)
    before = drive_edges(edges, unmarked, way_m=4.0, from_s=10.0)
    standing = [edges.step(unmarked, Motion(0.0, 0.0), now_s=100.0 + n).unmarked_m for n in range(9)]
    assert set(standing) == {before.unmarked_m}
    assert drive_edges(edges, unmarked, way_m=100.0, from_s=200.0).unmarked_m == LONG_UNMARKED_M


def test_lines_take_back_the_way_without_lines_that_they_last() -> None:
    edges = Edges()
    drive_edges(edges, [estimate_of(0.9, marked=True)], way_m=5.0)
    drive_edges(edges, [estimate_of(0.9, marked=False)], way_m=20.0, from_s=10.0)
    lines = [estimate_of(0.9, marked=True)]
    assert drive_edges(edges, lines, way_m=8.0, from_s=20.0).unmarked_m == pytest.approx(12.0)
    assert drive_edges(edges, lines, way_m=20.0, from_s=30.0).unmarked_m == 0.0


@pytest.mark.parametrize(("lines_m", "ends_m"), [(1.0, LONG_UNMARKED_M), (3.0, 0.0)])
def test_lines_that_come_and_go_count_where_they_are_seen_over_most_of_the_way(
    lines_m: float, ends_m: float
) -> None:
    edges = Edges()
    drive_edges(edges, [estimate_of(0.9, marked=True)], way_m=5.0)
    for n in range(1, 40):  # patches of snow at night, or dashes
        drive_edges(edges, [estimate_of(0.9, marked=False)], way_m=2.0, from_s=20.0 * n)
        last = drive_edges(edges, [estimate_of(0.9, marked=True)], way_m=lines_m, from_s=20.0 * n + 10.0)
    assert abs(last.unmarked_m - ends_m) <= lines_m + 1e-9
