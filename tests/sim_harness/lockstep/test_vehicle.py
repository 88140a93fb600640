"""The simulated vehicle on its road: referee, vehicle ahead, sensors, clock."""

import math

import plant_rig
import pytest

from sim_harness.lockstep.referee import locate, wheel_outside
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.state import PlantState
from sim_harness.world.render.scene.vehicles import Body
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load

SHUTTLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
QUIET = load_simulator().model_copy(
    update=dict(speed_noise_ratio=0.0, road_wheel_angle_noise_rad=0.0, yaw_rate_noise_radps=0.0)
)


class PassOn:
    """A limiter without limits that brakes without a command, and never hands over to a driver."""

    handed_over = False

    def step(self, command, received_s, state, *, now_s):
        return command or drive(0.0, -6.0)

    def report(self, state):
        return state


def drive(angle_rad=0.0, accel_mps2=1.5):
    return plant_rig.command(angle_rad, accel_mps2)


def scenario_of(**fields):
    base = dict(description="", tags=["nominal"], road="straight", duration_s=10.0)
    return Scenario.model_validate(base | fields)


def vehicle_on(scenario, settings=QUIET, seed=0):
    return SimulatedVehicle(scenario, scenario.build_road(), SHUTTLE, PassOn(), settings, seed=seed)


def run(simulated, command, seconds, from_s=0.0):
    for k in range(round(seconds / 0.01) + 1):
        state, truth = simulated.step(command, 0.0, now_s=from_s + k * 0.01)
    return state, truth


def outside(road, offset_m, heading_rad=0.0, station_m=100.0):
    x_m, y_m = road.position(station_m, offset_m)
    pose = PlantState(x_m=x_m, y_m=y_m, yaw_rad=road.heading_at(station_m) + heading_rad)
    return wheel_outside(road, SHUTTLE, pose, locate(road, pose, station_m))


def test_a_wheel_is_outside_when_its_outer_edge_passes_the_lane_edge():
    road = load_scenario("straight").build_road()  # 3.5 m wide; the car is 1.4 m
    for side in (1, -1):
        assert not outside(road, side * 1.04)
        assert outside(road, side * 1.06)


def test_the_front_wheels_count_as_the_rear_ones_do():
    """The outer front wheel touches the edge where L·sin ψ + t/2·cos ψ = w/2."""
    road, reach_m = load_scenario("straight").build_road(), math.hypot(1.75, 0.7)
    edge_rad = math.asin(1.75 / reach_m) - math.atan2(0.7, 1.75)
    for side in (1, -1):
        assert not outside(road, 0.0, side * (edge_rad - 0.01))
        assert outside(road, 0.0, side * (edge_rad + 0.01))


def test_the_place_on_a_closed_road_runs_on_over_laps():
    road = load_scenario("circuit").build_road()
    near_m = road.length_m - 0.05
    x_m, y_m = road.position(0.1, 0.3)
    place = locate(road, PlantState(x_m=x_m, y_m=y_m, yaw_rad=road.heading_at(0.1) + 4 * math.pi), near_m)
    assert place.station_m == pytest.approx(road.length_m + 0.1)
    assert place.offset_m == pytest.approx(0.3)
    assert place.heading_error_rad == pytest.approx(0.0, abs=1e-9)


def test_the_car_starts_at_the_place_of_the_scenario():
    simulated = vehicle_on(scenario_of(start={"station_m": 40.0, "offset_m": -0.3, "heading_rad": 0.1}))
    state, truth = simulated.step(None, None, now_s=7.0)
    assert (state.t_s, truth.t_s, state.speed_mps) == (7.0, 7.0, 0.0)
    assert truth.station_m == pytest.approx(40.0)
    assert truth.lateral_offset_m == pytest.approx(-0.3)
    assert truth.heading_error_rad == pytest.approx(0.1)


@pytest.mark.parametrize("side", [1, -1])
def test_each_departure_is_one_intervention_that_puts_the_car_back_with_its_speed(side):
    simulated = vehicle_on(scenario_of())
    before = None
    for k in range(1000):
        state, truth = simulated.step(drive(0.05 * side), 0.0, now_s=k * 0.01)
        if truth.interventions:
            break
        before = state, truth
    assert (truth.departures, truth.interventions) == (1, 1)
    assert abs(before[1].lateral_offset_m) > 0.5
    assert truth.lateral_offset_m == pytest.approx(0.0, abs=1e-9)
    assert truth.heading_error_rad == pytest.approx(0.0, abs=1e-9)
    assert truth.station_m == pytest.approx(before[1].station_m, abs=0.1)
    assert state.speed_mps == pytest.approx(before[0].speed_mps, abs=0.02)


def test_on_a_wide_lane_the_car_is_put_back_beyond_one_metre_without_a_departure():
    simulated = vehicle_on(scenario_of(lane_width_m=5.0, start={"offset_m": 0.99, "heading_rad": 0.02}))
    _, truth = run(simulated, drive(), 1.5)
    assert (truth.departures, truth.interventions) == (0, 1)


def test_a_collision_counts_once_and_stops_the_car_at_the_speed_of_the_other():
    simulated = vehicle_on(scenario_of(traffic=[{"gap_m": 3.0}]))
    _, truth = run(simulated, drive(), 5.0)
    assert truth.collisions == 1
    assert truth.speed_mps == pytest.approx(0.0, abs=0.02)
    assert truth.lead_gap_m == pytest.approx(0.0, abs=0.05)


def test_the_gap_is_between_the_bumpers_and_the_sensor_agrees():
    simulated = vehicle_on(scenario_of(traffic=[{"gap_m": 12.0, "speed_mps": 3.0}]))
    _, truth = run(simulated, drive(0.0, -1.0), 2.0)
    assert truth.lead_gap_m == pytest.approx(12.0 + 3.0 * 2.0)
    seen = simulated.sense_lead()
    assert (seen.distance_m, seen.lateral_m) == (pytest.approx(truth.lead_gap_m), pytest.approx(0.0))
    nose_m = SHUTTLE.wheelbase_m + SHUTTLE.front_overhang_m
    assert truth.lead_x_m == pytest.approx(truth.x_m + nose_m + truth.lead_gap_m - Body().rear_m)
    assert vehicle_on(scenario_of()).sense_lead() is None


def test_the_route_ends_after_its_length():
    simulated = vehicle_on(scenario_of(distance_m=5.0))
    assert not run(simulated, drive(), 2.0)[1].finished
    assert run(simulated, drive(), 1.0, from_s=2.01)[1].finished


def test_a_late_call_catches_up_under_what_was_applied_before():
    often, late = vehicle_on(scenario_of()), vehicle_on(scenario_of())
    _, expected = run(often, drive(0.02), 1.0)
    late.step(drive(0.02), 0.0, now_s=0.0)
    _, found = late.step(drive(-0.5, -6.0), 0.0, now_s=1.0)
    assert (found.x_m, found.y_m) == (expected.x_m, expected.y_m)


def test_without_commands_the_car_stands_exactly():
    simulated = vehicle_on(scenario_of(), settings=load_simulator())
    state, truth = run(simulated, None, 1.0)
    assert (state.speed_mps, truth.x_m, truth.y_m) == (0.0, 0.0, 0.0)


def test_sensors_are_noisy_by_seed():
    states = [run(vehicle_on(scenario_of(), load_simulator(), seed), drive(), 1.0)[0] for seed in (1, 1, 2)]
    assert states[0] == states[1] != states[2]
    true_mps = run(vehicle_on(scenario_of()), drive(), 1.0)[0].speed_mps
    assert states[0].speed_mps != true_mps
    assert states[0].speed_mps == pytest.approx(true_mps, rel=0.02)


def test_the_plant_of_a_scenario_may_differ_from_the_nominal_vehicle():
    soft = scenario_of(plant={"vehicle": {"max_accel_mps2": 0.5}})
    assert run(vehicle_on(soft), drive(), 1.0)[0].speed_mps < 0.5


def drive_past(simulated, command, seconds):
    """Every truth on the way."""
    return [simulated.step(command, 0.0, now_s=k * 0.01)[1] for k in range(round(seconds / 0.01) + 1)]


def test_with_traffic_and_no_vehicle_ahead_the_sensor_reports_none():
    seen = vehicle_on(scenario_of(traffic=[{"gap_m": 30.0, "lane": 1}])).sense_lead()
    assert (seen.confidence, seen.distance_m) == (0.0, None)
    far = vehicle_on(scenario_of(traffic=[{"gap_m": QUIET.lead_range_m + 1}])).sense_lead()
    assert far.confidence == 0.0


def test_an_oncoming_vehicle_has_a_negative_speed_for_the_sensor():
    seen = vehicle_on(scenario_of(traffic=[{"gap_m": 30.0, "speed_mps": 9.0, "oncoming": True}])).sense_lead()
    assert (seen.distance_m, seen.speed_mps) == (pytest.approx(30.0), pytest.approx(-9.0))


def test_the_truth_carries_every_vehicle_in_the_order_of_the_scenario():
    parked = {"station_m": 60.0, "offset_m": -3.0}
    simulated = vehicle_on(scenario_of(traffic=[{"gap_m": 12.0, "speed_mps": 3.0}, parked]))
    _, truth = run(simulated, drive(0.0, -1.0), 1.0)
    assert truth.traffic_x_m == pytest.approx(
        (SHUTTLE.wheelbase_m + 0.55 + 15.0 - Body().rear_m, 60.0), abs=0.5
    )
    assert truth.traffic_x_m[0] == truth.lead_x_m
    assert truth.traffic_y_m == pytest.approx((0.0, -3.0))
    assert truth.traffic_speed_mps == (3.0, 0.0)


@pytest.mark.parametrize("traffic", [{"gap_m": 4.0, "oncoming": True}, {"gap_m": 4.0, "shape": "truck"}])
def test_a_collision_with_any_vehicle_stops_the_car_and_counts_once(traffic):
    truths = drive_past(vehicle_on(scenario_of(traffic=[traffic])), drive(), 6.0)
    assert truths[-1].collisions == 1
    assert truths[-1].speed_mps == pytest.approx(0.0, abs=0.02)


def test_a_car_hit_from_behind_keeps_its_speed():
    chaser = {"station_m": -12.0, "speed_mps": 9.0}
    truths = drive_past(vehicle_on(scenario_of(traffic=[chaser])), drive(0.0, 0.5), 4.0)
    assert truths[-1].collisions == 1
    assert truths[-1].speed_mps == pytest.approx(0.5 * 4.0, abs=0.3)


def test_a_start_at_speed_is_driven_by_a_driver_up_to_the_hand_over():
    simulated = vehicle_on(scenario_of(start={"station_m": 90.0, "speed_mps": 10.0, "drift_mps": 0.4}))
    ticks = round(QUIET.run_up_s / 0.01)
    both = [simulated.step(drive(), 0.0, now_s=50.0 + k * 0.01) for k in range(ticks + 1)]
    assert [state.driver_override for state, _ in both] == [True] * ticks + [False]
    assert {round(state.speed_mps, 9) for state, _ in both} == {10.0}
    first, last = both[0][1], both[-1][1]
    assert (first.elapsed_s, last.elapsed_s) == (pytest.approx(-QUIET.run_up_s), 0.0)
    assert first.station_m == pytest.approx(90.0 - 10.0 * QUIET.run_up_s)
    assert (last.station_m, last.lateral_offset_m) == (pytest.approx(90.0), pytest.approx(0.0))
    assert 10.0 * math.sin(last.heading_error_rad) == pytest.approx(0.4)


def test_while_the_car_waits_only_the_clock_advances():
    simulated = vehicle_on(scenario_of(traffic=[{"gap_m": 12.0, "speed_mps": 3.0}]))
    before, after = (simulated.wait(now_s=t)[1] for t in (5.0, 9.0))
    assert (before.t_s, after.t_s) == (5.0, 9.0)
    assert before.lead_gap_m == after.lead_gap_m == pytest.approx(12.0)
    begun = simulated.step(None, None, now_s=10.0)[1]
    assert (begun.t_s, begun.elapsed_s) == (10.0, 0.0)


def test_without_a_limiter_a_command_takes_effect_as_it_is():
    scenario = scenario_of()
    bare = SimulatedVehicle(scenario, scenario.build_road(), SHUTTLE, None, QUIET, seed=0)
    limited = vehicle_on(scenario)
    command = drive(0.1, 1.0)
    assert run(bare, command, 2.0) == run(limited, command, 2.0)


@pytest.mark.parametrize("grade", [-0.08, 0.05])
def test_on_a_hill_the_weight_accelerates_the_vehicle_along_the_road(grade):
    """Without a demand it is -g·sin(atan(grade)) once the lag of the drive is over."""
    moving = dict(start=dict(speed_mps=10.0), elevation=[dict(at_m=0.0, grade=grade)])
    _, truth = run(vehicle_on(scenario_of(**moving)), drive(0.0, 0.0), 7.0)  # 4 s of them are the run-up
    pull_mps2 = -GRAVITY_MPS2 * grade / math.hypot(1.0, grade)
    assert truth.longitudinal_accel_mps2 == pytest.approx(pull_mps2, abs=1e-3)
    assert (truth.speed_mps - 10.0) * grade < 0.0


def test_on_a_hill_a_vehicle_at_rest_stays_there_with_its_brakes_and_rolls_downhill_without():
    downhill = dict(elevation=[dict(at_m=0.0, grade=-0.08)])
    held, free = (run(vehicle_on(scenario_of(**downhill)), drive(0.0, a), 2.0)[1] for a in (-1.0, 0.0))
    uphill = run(vehicle_on(scenario_of(elevation=[dict(at_m=0.0, grade=0.08)])), drive(0.0, 0.0), 2.0)[1]
    assert held.speed_mps == uphill.speed_mps == 0.0
    assert free.speed_mps > 1.0


def test_the_range_sensor_sees_no_vehicle_behind_a_crest_or_a_wall():
    """Over a crest of 400 m radius, from 0.6 m to a car's middle at 0.74 m: √(2·400)·(√0.6 + √0.74) = 46.2 m."""
    crest = dict(
        elevation=[dict(at_m=0.0, grade=0.25), dict(at_m=200.0, grade=-0.25)], start=dict(station_m=50.0)
    )
    for gap_m, seen in ((40.0, True), (55.0, False)):
        lead = vehicle_on(scenario_of(traffic=[{"gap_m": gap_m}], **crest)).sense_lead()
        assert (lead.distance_m is not None) is seen
    bend = dict(
        segments=[dict(length_m=150.0, curvature_1pm=1 / 40)],
        walls=[dict(side="left", from_m=0.0, to_m=150.0, distance_m=0.5)],
    )
    for walls, seen in ((bend["walls"], False), ([], True)):
        lead = vehicle_on(scenario_of(traffic=[{"gap_m": 40.0}], **{**bend, "walls": walls})).sense_lead()
        assert (lead.distance_m is not None) is seen
