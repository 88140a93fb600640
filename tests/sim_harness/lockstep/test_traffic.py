"""Other vehicles: they move by the closed forms, and the sensor measures their positions."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.lockstep.traffic import Actor, Traffic, lane_centre_m, least_jerk, speed_and_distance
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.scenarios.traffic import BODIES, TrafficVehicle

TICK_S = 0.01
STRAIGHT = load_scenario("straight").build_road()  # 3.5 m wide
CIRCUIT = load_scenario("circuit").build_road()
CAR = BODIES["car"]


def actor(road=STRAIGHT, *, nose_m=0.0, elapsed_s=0.0, **fields):
    return Actor(TrafficVehicle.model_validate(fields), road, nose_m=nose_m, elapsed_s=elapsed_s)


def phase(kind, **fields):
    return {"kind": kind, **fields}


def run(one, seconds, *, from_s=0.0, gap_m=None):
    for k in range(round(seconds / TICK_S)):
        one.step(from_s + k * TICK_S, TICK_S, gap_m)
    return one


def test_a_vehicle_begins_with_its_near_end_at_the_gap():
    assert actor(gap_m=12.0, nose_m=30.0).station_m + CAR.rear_m == pytest.approx(42.0)
    assert actor(gap_m=12.0, nose_m=30.0, oncoming=True).station_m - CAR.front_m == pytest.approx(42.0)
    assert actor(station_m=80.0, nose_m=30.0).station_m == 80.0


def test_braking_to_standstill_takes_v_over_a_seconds_and_v2_over_2a_metres():
    leader = actor(
        station_m=0.0, speed_mps=12.0, phases=[phase("change_speed", at_s=1, to_mps=0, rate_mps2=4)]
    )
    run(leader, 1.0)
    assert leader.station_m == pytest.approx(12.0)
    run(leader, 2.99, from_s=1.0)
    assert leader.manoeuvres == ["change_speed"]
    run(leader, 5.0, from_s=3.99)
    assert (leader.speed_mps, leader.manoeuvres) == (0.0, [])
    assert leader.station_m == pytest.approx(12.0 + 12.0**2 / (2 * 4))


@given(
    v0=st.floats(0, 30),
    v1=st.floats(0, 30),
    rate=st.floats(0.1, 9),
    total=st.floats(0.1, 10),
    cut=st.floats(0, 1),
)
@settings(max_examples=60, deadline=None)
def test_a_ramp_of_speed_is_the_same_in_one_step_or_two(v0, v1, rate, total, cut):
    at_once, distance_m = speed_and_distance(v0, v1, rate, total)
    between, first_m = speed_and_distance(v0, v1, rate, cut * total)
    after, second_m = speed_and_distance(between, v1, rate, total - cut * total)
    assert after == pytest.approx(at_once, abs=1e-9)
    assert first_m + second_m == pytest.approx(distance_m, abs=1e-7)


def test_a_lane_change_ends_on_the_next_lane_along_the_road_and_is_half_over_at_half_time():
    one = actor(station_m=0.0, speed_mps=10.0, phases=[phase("change_lane", at_s=0, to_lane=1, over_s=4)])
    run(one, 2.0)
    assert one.offset_m == pytest.approx(3.5 / 2)
    assert one.pose[2] == pytest.approx(math.atan2(3.5 / 4 * 30 / 16, 10.0))  # the slope at τ = 1/2 is 30/16
    run(one, 2.0, from_s=2.0)
    assert one.pose == pytest.approx((40.0, 3.5, 0.0))
    assert one.manoeuvres == []


def test_lanes_are_where_the_road_has_them_or_as_wide_as_ours():
    lanes = "[{width_m: 3.0, marking: {stroke: solid}}, {width_m: 4.0, marking: {stroke: solid}}]"
    road = load_scenario(
        "straight", {"appearance.far_left.stroke": "none", "appearance.left_lanes": lanes}
    ).build_road()
    assert [lane_centre_m(road, lane, 50.0) for lane in (-1, 0, 1, 2, 3)] == [-3.5, 0.0, 3.25, 6.75, 10.5]


def test_least_jerk_starts_and_ends_at_rest_and_its_slope_is_its_derivative():
    assert [least_jerk(t) for t in (-1, 0, 1, 2)] == [(0, 0), (0, 0), (1, 0), (1, 0)]
    for t in (0.1, 0.4, 0.8):
        numeric = (least_jerk(t + 1e-6)[0] - least_jerk(t - 1e-6)[0]) / 2e-6
        assert least_jerk(t)[1] == pytest.approx(numeric, rel=1e-6)


@pytest.mark.parametrize(("side", "sign"), [("left", 1), ("right", -1)])
def test_a_turn_off_is_an_arc_and_then_a_straight(side, sign):
    """A quarter circle of 10 m ends at (10, ±10); after it, 4 m straight sideways."""
    one = actor(station_m=50.0, speed_mps=5.0, phases=[phase("turn_off", at_s=0, side=side, radius_m=10)])
    run(one, (10 * math.pi / 2 + 4) / 5.0)
    over_m = one.pose[1] * sign - 10.0  # the last tick is not a whole one
    assert over_m == pytest.approx(4.0, abs=5.0 * TICK_S)
    assert one.pose[0] == pytest.approx(60.0)
    assert one.pose[2] == pytest.approx(sign * math.pi / 2)


def test_a_vehicle_that_has_turned_off_is_no_longer_in_our_lane_and_at_last_gone():
    turning = {"station_m": 50.0, "speed_mps": 5.0, "phases": [phase("turn_off", at_s=1, side="right")]}
    traffic = Traffic([TrafficVehicle.model_validate(turning)], STRAIGHT, nose_m=0.0)
    ahead = []
    for k in range(2000):
        ahead.append(traffic.ahead(0.0) is not None)
        traffic.step(k * TICK_S, TICK_S, nose_m=0.0)
    assert ahead[0] and ahead == sorted(ahead, reverse=True) and not ahead[600]
    assert traffic.actors[0].ends() is None


@pytest.mark.parametrize(
    ("trigger", "begins_m"),
    [({"at_s": 2.0}, 10.0), ({"at_station_m": 15.0}, 15.0), ({"at_gap_m": 8.0}, 12.0)],
)
def test_a_phase_begins_at_its_time_its_place_or_its_gap(trigger, begins_m):
    fields = {"station_m": 0.0, "speed_mps": 5.0, "phases": [phase("change_speed", to_mps=0, **trigger)]}
    one = actor(**fields)
    for k in range(1000):
        one.step(k * TICK_S, TICK_S, 20.0 - one.station_m)
        if one.speed_mps < 5.0:
            break
    assert one.station_m == pytest.approx(begins_m, abs=0.06)


def test_a_gap_may_also_be_reached_from_below_by_an_overtaking_vehicle():
    one = actor(station_m=0.0, speed_mps=5.0, phases=[phase("change_lane", at_gap_m=5.0, to_lane=0)])
    one.step(0.0, TICK_S, -10.0)
    one.step(TICK_S, TICK_S, 4.9)
    assert one.manoeuvres == []
    one.step(2 * TICK_S, TICK_S, 5.1)
    assert one.manoeuvres == ["change_lane"]


def test_phases_begin_one_after_the_other():
    stop, go = phase("change_speed", at_s=3, to_mps=0), phase("change_speed", at_s=1, to_mps=9)
    one = actor(station_m=0.0, speed_mps=5.0, phases=[stop, go])
    run(one, 2.9)
    assert one.speed_mps == 5.0
    run(one, 6.0, from_s=2.9)
    assert one.speed_mps == 9.0


def test_before_the_run_it_rolls_to_the_place_where_it_is_at_its_beginning():
    one = actor(gap_m=20.0, speed_mps=6.0, elapsed_s=-2.0)
    begun_m = actor(gap_m=20.0).station_m
    assert one.station_m == pytest.approx(begun_m - 12.0)
    run(one, 2.0, from_s=-2.0)
    assert one.station_m == begun_m


def test_on_the_next_lane_of_a_bend_it_drives_its_speed():
    """The way in the plane, summed over a lap, is speed times time."""
    one = actor(CIRCUIT, station_m=0.0, lane=1, speed_mps=10.0)
    way_m, before = 0.0, one.pose
    for k in range(3000):
        one.step(k * TICK_S, TICK_S, None)
        way_m, before = way_m + math.dist(before[:2], one.pose[:2]), one.pose
    assert way_m == pytest.approx(300.0, rel=1e-3)


def test_one_that_comes_towards_us_moves_back_along_the_road_and_heads_that_way():
    one = run(actor(station_m=100.0, lane=1, speed_mps=8.0, oncoming=True), 2.0)
    assert one.pose[:2] == pytest.approx((84.0, 3.5))
    assert abs(one.pose[2]) == pytest.approx(math.pi)


@pytest.mark.parametrize(
    ("offset_m", "seen"),
    [(0.0, True), (2.3, True), (2.4, False), (-2.3, True), (-2.4, False), (3.5, False)],
)
def test_a_vehicle_that_reaches_30_cm_into_the_lane_is_ahead(offset_m, seen):
    """Half a lane is 1.75 m and half a car 0.89 m: the border is at 1.75 - 0.3 + 0.89 = 2.34 m."""
    parked = TrafficVehicle(gap_m=30.0, offset_m=offset_m)
    assert (Traffic([parked], STRAIGHT, nose_m=0.0).ahead(0.0) is not None) == seen


def test_ahead_is_the_nearest_and_none_that_is_behind():
    vehicles = [TrafficVehicle(gap_m=gap_m) for gap_m in (40.0, 15.0, -25.0)]
    actor_ahead, gap_m = Traffic(vehicles, STRAIGHT, nose_m=0.0).ahead(0.0)
    assert gap_m == pytest.approx(15.0)
    assert actor_ahead.station_m == pytest.approx(15.0 - CAR.rear_m)


def test_on_a_closed_road_the_gap_is_the_short_way_round():
    traffic = Traffic([TrafficVehicle(station_m=10.0)], CIRCUIT, nose_m=0.0)
    _, gap_m = traffic.ahead(3 * CIRCUIT.length_m - 20.0)
    assert gap_m == pytest.approx(30.0 + CAR.rear_m)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({}, "give one of gap_m, station_m"),
        ({"gap_m": 1.0, "station_m": 1.0}, "give one of gap_m, station_m"),
        ({"gap_m": 1.0, "phases": [phase("change_lane")]}, "give one of at_s, at_station_m, at_gap_m"),
        ({"gap_m": 1.0, "phases": [phase("change_lane", at_s=1, at_gap_m=3)]}, "give one of at_s"),
    ],
)
def test_a_vehicle_without_one_place_or_a_phase_without_one_trigger_is_refused(fields, message):
    with pytest.raises(ValueError, match=message):
        TrafficVehicle.model_validate(fields)
