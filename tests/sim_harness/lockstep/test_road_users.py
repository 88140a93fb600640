"""People, cyclists and animals: closed forms of their motion, its mirror image, and contacts as collisions."""

import math

import plant_rig
import pytest
from hypothesis import given
from hypothesis import settings as within
from hypothesis import strategies as st

from sim_harness.lockstep.road_users import RoadUsersAround, Walker
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.road_users import RoadUser
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.world.render.scene.people import FIGURES, Shape
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load

TICK_S = 0.01
STRAIGHT = load_scenario("straight").build_road()  # 3.5 m wide
CIRCUIT = load_scenario("circuit").build_road()


def walker(road=STRAIGHT, *, nose_m=0.0, elapsed_s=0.0, **fields):
    return Walker(RoadUser.model_validate(fields), road, nose_m=nose_m, elapsed_s=elapsed_s)


def car_in(scenario):
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    return SimulatedVehicle(scenario, scenario.build_road(), vehicle, None, load_simulator(), seed=0)


def cross(**fields):
    return {"kind": "cross", "after_s": 0.0, "speed_mps": 1.4, **fields}


def walk_on(one, seconds, *, gap_m=1e3):
    """The walker after ``seconds``, and when it was last under way."""
    last_s = 0.0
    for k in range(round(seconds / TICK_S)):
        one.step(k * TICK_S, TICK_S, gap_m)
        last_s = (k + 1) * TICK_S if one.manoeuvre else last_s
    return one, last_s


@given(
    from_m=st.floats(-6, 6),
    to_m=st.floats(-6, 6),
    speed=st.floats(0.8, 3),
    rate=st.floats(0.8, 3),
    lean=st.floats(-0.6, 0.6),
)
@within(max_examples=40, deadline=None)
def test_crossing_a_width_takes_its_path_over_the_speed_plus_half_the_time_to_reach_it(
    from_m, to_m, speed, rate, lean
):
    path_m = abs(to_m - from_m) / math.cos(lean)
    if path_m < speed**2 / (2 * rate):
        return
    phase = cross(to_offset_m=to_m, speed_mps=speed, rate_mps2=rate, lean_rad=lean)
    one, last_s = walk_on(walker(station_m=50.0, offset_m=from_m, phases=[phase]), 25)
    assert last_s == pytest.approx(path_m / speed + speed / (2 * rate), abs=2 * TICK_S)
    assert (one.offset_m, one.speed_mps) == (to_m, 0.0)
    assert one.station_m - 50.0 == pytest.approx(path_m * math.sin(lean), abs=2 * TICK_S * speed)


@pytest.mark.parametrize("road", [STRAIGHT, CIRCUIT])
@pytest.mark.parametrize("facing_rad", [0.0, 0.7, math.pi])
def test_a_road_user_is_at_its_place_at_t_0_and_was_before_where_its_speed_takes_it_there(road, facing_rad):
    fields = dict(station_m=20.0, offset_m=-2.0, speed_mps=1.5, facing_rad=facing_rad)
    early = walker(road, elapsed_s=-2.0, **fields)
    for k in range(-200, 0):
        early.step(k * TICK_S, TICK_S, 1e3)
    assert early.pose == walker(road, **fields).pose


def test_a_road_user_along_the_road_moves_v_t_and_keeps_its_offset():
    one, _ = walk_on(walker(CIRCUIT, station_m=0.0, offset_m=-1.0, speed_mps=4.0), 5)
    assert one.offset_m == -1.0
    inner = walker(CIRCUIT, station_m=0.0, offset_m=-1.0, speed_mps=4.0)
    length_m = sum(
        math.dist(CIRCUIT.position(s, -1.0), CIRCUIT.position(s + 0.01, -1.0))
        for s in (k * 0.01 for k in range(round(100 * (one.station_m - inner.station_m))))
    )
    assert length_m == pytest.approx(20.0, abs=0.03)


def test_the_mirror_image_of_a_crossing_is_the_crossing_of_the_mirror_image():
    def places(side):
        there = cross(to_offset_m=side * 0.4, lean_rad=0.3)
        back = cross(to_offset_m=side * -3.0, after_s=1.0, speed_mps=2.0)
        one = walker(station_m=30.0, offset_m=side * -3.0, facing_rad=side * 1.0, phases=[there, back])
        found = []
        for k in range(900):
            one.step(k * TICK_S, TICK_S, 1e3)
            x_m, y_m, yaw_rad = one.pose
            found.append((x_m, side * y_m, side * yaw_rad, one.speed_mps))
        return found

    assert places(1) == places(-1)


def test_phases_begin_at_their_time_their_gap_and_the_end_of_the_phase_before():
    timed = walker(station_m=0.0, offset_m=-3.0, phases=[cross(after_s=None, at_s=2.0)])
    assert walk_on(timed, 2.0)[0].manoeuvre is None
    timed.step(2.0, TICK_S, 1e3)
    assert timed.manoeuvre == "cross"
    near = walker(station_m=0.0, offset_m=-3.0, phases=[cross(after_s=None, at_gap_m=20.0)])
    near.step(0.0, TICK_S, 20.1)
    assert near.manoeuvre is None
    near.step(TICK_S, TICK_S, 20.0)
    assert near.manoeuvre == "cross"
    stops = [cross(to_offset_m=-2.0, rate_mps2=100.0, speed_mps=1.0), cross(after_s=3.0, to_offset_m=-3.0)]
    halted, last_s = walk_on(walker(station_m=0.0, offset_m=-3.0, phases=stops), 3.9)
    assert (halted.offset_m, halted.manoeuvre) == (-2.0, None)
    assert last_s == pytest.approx(1.0, abs=2 * TICK_S)
    halted.step(4.02, TICK_S, 1e3)
    assert halted.manoeuvre == "cross"


def test_a_cyclist_turns_into_the_lane_rides_on_and_changes_pace():
    phases = [
        cross(to_offset_m=0.0, speed_mps=4.0, lean_rad=1.2, rate_mps2=100.0, then_mps=4.0),
        {"kind": "change_pace", "after_s": 1.0, "to_mps": 2.0},
    ]
    one, _ = walk_on(walker(station_m=0.0, offset_m=-2.0, speed_mps=4.0, shape="cyclist", phases=phases), 6)
    assert (one.offset_m, one.speed_mps) == (0.0, 2.0)
    assert one.pose[2] == STRAIGHT.heading_at(one.station_m)


def test_the_gap_of_a_trigger_is_counted_along_the_shorter_way_of_a_closed_road():
    user = RoadUser(station_m=5.0, offset_m=-3.0, phases=[cross(after_s=None, at_gap_m=12.0)])
    around = RoadUsersAround([user], CIRCUIT, nose_m=0.0)
    around.step(0.0, TICK_S, nose_m=CIRCUIT.length_m - 10.0)
    assert around.places().manoeuvres == ()
    around.step(TICK_S, TICK_S, nose_m=CIRCUIT.length_m - 6.9)
    assert around.places().manoeuvres == ("cross",)


@pytest.mark.parametrize("shape", [*Shape])
@pytest.mark.parametrize(("aside_m", "collisions"), [(0.05, 1), (-0.05, 0)])
def test_the_car_collides_when_its_outline_meets_that_of_a_road_user(shape, aside_m, collisions):
    """Along the road its half width stands beside the half width of the car, which drives on after a contact."""
    half_m = (FIGURES[shape].width_m + 1.4) / 2
    user = dict(gap_m=5.0, offset_m=-(half_m - aside_m), shape=shape)
    base = dict(description="", tags=["traffic"], road="straight", duration_s=10.0, start={"speed_mps": 5.0})
    simulated = car_in(Scenario.model_validate(base | {"road_users": [user]}))
    for k in range(801):
        state, truth = simulated.step(plant_rig.command(0.0, 0.0), 0.0, now_s=k * TICK_S)
    assert truth.collisions == collisions
    assert state.speed_mps == pytest.approx(5.0, abs=0.1)
    assert truth.user_y_m == pytest.approx((-(half_m - aside_m),))


def test_a_road_user_needs_one_place_and_a_phase_one_trigger():
    with pytest.raises(ValueError, match="give one of gap_m, station_m"):
        RoadUser.model_validate({})
    with pytest.raises(ValueError, match="give one of at_s, at_gap_m, after_s"):
        RoadUser.model_validate({"gap_m": 3.0, "phases": [cross(at_s=1.0)]})
