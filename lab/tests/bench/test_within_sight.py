"""The benchmark of vehicles beyond the sight: its cases, and its figures from rows."""

import pytest

from lab.bench.within_sight import KINDS, SET_MPS, case, clear, loss_percent, summary
from sim_harness.lockstep.closed_loop import run


def row(**changes):
    found = {"collisions": 0, "max_decel_mps2": 1.0, "departures": 0, "mean_speed_mps": 5.0}
    return found | changes


@pytest.mark.parametrize("kind", KINDS)
def test_every_case_can_be_driven_and_equal_numbers_give_equal_cases(kind):
    for number in range(8):
        drawn = case(3, kind, number, rendered=False)
        assert drawn.scenario.problem() is None
        assert drawn == case(3, kind, number, rendered=False)
        assert SET_MPS[0] <= drawn.scenario.speed_mps <= SET_MPS[1]


def test_rendered_and_modelled_cases_are_the_same_drives():
    rendered, modelled = (case(3, "fog", 1, rendered=images).scenario for images in (True, False))
    assert (rendered.traffic, rendered.speed_mps) == (modelled.traffic, modelled.speed_mps)


def test_the_figures_count_collisions_and_steep_stops_and_a_crash_is_a_collision():
    cases = [case(3, "fog", number, rendered=False) for number in range(4)]
    rows = [row(), row(collisions=1), row(collisions=None, max_decel_mps2=None), row(max_decel_mps2=4.2)]
    (found,) = summary(zip(cases, rows, strict=True))["vehicles beyond the sight"].values()
    assert (found["cases"], found["collisions"], found["beyond_4_mps2"]) == (4, 2, 1)
    assert found["greatest_decel_mps2"] == 4.2


def test_the_loss_is_the_share_of_the_set_speed_that_is_missing():
    slow = clear(0, rendered=False)
    assert loss_percent(slow, row(mean_speed_mps=slow.scenario.speed_mps * 0.9)) == pytest.approx(10.0)
    assert loss_percent(slow, row(mean_speed_mps=None)) is None


def test_a_car_stops_before_a_standing_car_that_fog_hides():
    drawn = case(7, "fog", 0, rendered=False)
    (other,) = drawn.scenario.traffic
    found = run(drawn.scenario, seed=drawn.seed).row()
    assert other.speed_mps == 0.0
    assert found["collisions"] == 0 and found["max_decel_mps2"] < 4.0
    assert found["distance_m"] < other.gap_m
