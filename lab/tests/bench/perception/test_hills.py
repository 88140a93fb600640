"""The benchmark of hills: its measures against closed forms, its cases within their ranges."""

import math

import numpy as np
import pytest

from lab.bench.perception.hills import (
    Drive,
    crest_case,
    lane_ahead_m,
    summary,
    true_lane_ahead_m,
)
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.road import Road, Segment
from trepid.messages import SteeringEstimate

ARC = (Segment(length_m=200.0, curvature_1pm=0.01),)


def estimate_of(**fields: float) -> SteeringEstimate:
    return SteeringEstimate(t_s=0.0, estimator="cv", confidence=1.0, reason="", **fields)


def test_a_true_lane_state_gives_the_true_place_of_the_lane_ahead():
    road = Road(load_road("straight").settings.model_copy(update={"segments": ARC}))
    station_m, offset_m, heading_rad = 30.0, 0.4, 0.03
    x_m, y_m = road.position(station_m, offset_m)
    pose = (x_m, y_m, road.heading_at(station_m) + heading_rad)
    estimate = estimate_of(
        lateral_offset_m=offset_m,
        heading_error_rad=heading_rad,
        curvature_1pm=0.01,
        curvature_rate_1pm2=0.0,
        lookahead_m=8.0,
    )
    assert lane_ahead_m(estimate, 15.0) == pytest.approx(
        true_lane_ahead_m(road, station_m, pose, 15.0), abs=0.04
    )


def test_without_a_lane_there_is_no_place_ahead():
    assert lane_ahead_m(estimate_of(lookahead_m=8.0), 15.0) is None


def test_the_place_ahead_on_a_straight_road_is_a_straight_line():
    road = load_road("straight")
    assert true_lane_ahead_m(road, 20.0, (20.0, 0.5, 0.1), 15.0) == pytest.approx(
        -0.5 / math.cos(0.1) - 15.0 * math.tan(0.1), abs=1e-6
    )


@pytest.mark.parametrize("number", range(6))
def test_the_top_of_a_crest_hides_the_car_behind_it_at_first(number):
    scenario = crest_case(np.random.default_rng(number))
    road = scenario.build_road()
    car_m = scenario.traffic[0].station_m
    stations = np.linspace(0.0, car_m, 400)
    heights_m = road.heights_at(stations)
    line_m = np.linspace(heights_m[0] + 1.2, float(road.heights_at(car_m)) + 1.4, 400)
    assert (heights_m > line_m).any()
    assert car_m < road.length_m


def test_the_error_on_hills_is_stated_as_a_multiple_of_that_on_flat_roads():
    looks = {
        (name, hilly): {"frames": 2, "errors_m": [0.2, -0.2] if hilly else [0.1, -0.1]}
        for name in ("cv", "cnn")
        for hilly in (False, True)
    }
    driven = [(Drive("look", 0, 1, False, *which), row) for which, row in looks.items()]
    driven.append(
        (Drive("stop", 0, 1), {"collisions": 0, "departures": 0, "max_decel_mps2": 2.0, "set_mps": 8.0})
    )
    table = summary(driven)
    assert table["lane 15 m ahead"]["cv, hills"]["times_flat"] == 2.0
    assert table["stops behind a crest"]["all"]["collisions"] == 0
