"""The speed for people, cyclists and animals, against closed forms and against all their possible steps."""

import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from supervisor_rig import SETTINGS

from supervisor.inputs.road_users import NO_DETECTOR, RoadUser, WatchedUsers
from supervisor.path.fusion import Path
from supervisor.path.giving_way import (
    CLEAR,
    Encounter,
    GivingWay,
    Way,
    encounter,
    needs_more,
    passes_first,
    permitted_speed_mps,
    stop_within,
)
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane, Motion
from trepid.config import CONFIG_DIR, load

S = SETTINGS.giving_way
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
NOSE_M = VEHICLE.wheelbase_m + VEHICLE.front_overhang_m
STRAIGHT = Lane(0.0, 0.0, 0.0, 0.0)
PATH = Path(0.0, STRAIGHT, 20.0, "cv")

kinds = st.sampled_from(["person", "cyclist", "animal", "a kind of a later version"])
users = st.builds(
    RoadUser,
    kind=kinds,
    x_m=st.floats(-5, 80),
    y_m=st.floats(-15, 15),
    x_mps=st.floats(-6, 6),
    y_mps=st.floats(-4, 4),
    confidence=st.floats(0, 1),
)
encounters = st.builds(
    Encounter,
    kind=kinds,
    free_m=st.floats(-3, 80),
    gap_m=st.floats(-2, 12),
    closing_mps=st.floats(-4, 4),
    along_mps=st.floats(-6, 6),
    step_mps=st.floats(0.5, 3),
    car_m=st.floats(0, 8),
)
walkers = st.builds(
    Encounter._replace,
    encounters,
    free_m=st.floats(0.01, 80),
    gap_m=st.floats(0.01, 12),
    closing_mps=st.floats(S.moving_mps, 6),
)
speeds = st.floats(0, 30)


def person(x_m: float, y_m: float, *, towards_mps: float = 0.0, kind: str = "person") -> RoadUser:
    """One beside a straight lane that walks towards it."""
    return RoadUser(kind, x_m, y_m, 0.0, -math.copysign(towards_mps, y_m), 0.9)


def way(*present: RoadUser, speed_mps: float = 8.0, lane: Lane = STRAIGHT) -> Way:
    """The way of a car at that speed that meets these for the first time."""
    giving = GivingWay(S, VEHICLE)
    return giving.step(
        WatchedUsers(0.0, present), PATH._replace(lane=lane), Motion(speed_mps, 0.0), now_s=0.0
    )


def test_without_people_or_a_detector_of_them_there_is_no_limit() -> None:
    assert way() == CLEAR
    giving = GivingWay(S, VEHICLE)
    assert giving.step(NO_DETECTOR, PATH, Motion(8.0, 0.0), now_s=0.0) == CLEAR


@given(
    free_m=st.floats(0.01, 200),
    decel_mps2=st.floats(0.1, 4),
    reaction_s=st.floats(0.01, 2),
    w=st.floats(0, 5),
)
def test_the_speed_of_a_stop_solves_its_equation(
    free_m: float, decel_mps2: float, reaction_s: float, w: float
) -> None:
    v = stop_within(free_m, decel_mps2, reaction_s, approach_mps=w)
    needed_m = v * reaction_s + v**2 / (2 * decel_mps2) + w * (reaction_s + v / decel_mps2)
    if v > 0:
        assert needed_m == pytest.approx(free_m, rel=1e-6)
    else:
        assert free_m <= w * reaction_s


@given(user=users, speed_mps=speeds)
def test_who_is_in_the_strip_is_never_reached_by_a_car_that_keeps_the_cap(
    user: RoadUser, speed_mps: float
) -> None:
    """From the cap the car stops gap_m before one who stays, after the reaction time and with comfort."""
    one = encounter(user, STRAIGHT, S, VEHICLE)
    assume(one.gap_m <= 0 and one.kind != "cyclist")
    v = permitted_speed_mps(one, speed_mps, S)
    assert v * S.reaction_s + v**2 / (2 * S.decel_mps2) <= max(one.free_m - S.gap_m, 0.0) + 1e-9


@given(one=encounters, speed_mps=speeds)
def test_a_step_out_at_any_time_finds_the_car_able_to_stop_before_it_or_past(
    one: Encounter, speed_mps: float
) -> None:
    """A worst-case step; the car, at its cap, drives on or brakes with its strongest deceleration."""
    v = min(speed_mps, permitted_speed_mps(one, speed_mps, S))
    assume(one.gap_m > 0 and one.free_m > 0 and v > S.passing_mps)
    stops_m = v * S.reaction_s + v**2 / (2 * S.strongest_decel_mps2)
    steps_in_s = one.gap_m / max(one.closing_mps, one.step_mps)
    assert stops_m <= one.free_m + 1e-9 or one.free_m <= v * steps_in_s + 1e-9


@given(one=encounters, speed_mps=speeds, nearer=st.floats(0, 10))
def test_a_nearer_faster_or_closer_one_never_permits_more(
    one: Encounter, speed_mps: float, nearer: float
) -> None:
    assume(one.free_m - nearer > 0 and not (one.kind == "cyclist" and one.along_mps >= S.moving_mps))
    # beyond the place that the car passes before a step out the rule is another one
    assume(not passes_first(one._replace(gap_m=one.gap_m, free_m=one.free_m - nearer), speed_mps, S))
    before = permitted_speed_mps(one, speed_mps, S)
    for worse in (
        one._replace(free_m=one.free_m - nearer),
        one._replace(gap_m=one.gap_m - nearer),
        one._replace(closing_mps=one.closing_mps + nearer),
        one._replace(along_mps=one.along_mps - nearer),
    ):
        assert permitted_speed_mps(worse, speed_mps, S) <= before + 1e-9


@given(present=st.lists(users, max_size=4), more=users, speed_mps=speeds)
def test_one_more_road_user_never_permits_more(
    present: list[RoadUser], more: RoadUser, speed_mps: float
) -> None:
    assert way(*present, more, speed_mps=speed_mps).cap_mps <= way(*present, speed_mps=speed_mps).cap_mps


@given(present=st.lists(users, min_size=1, max_size=3), speed_mps=speeds, lane=st.floats(-0.02, 0.02))
def test_left_and_right_are_alike(present: list[RoadUser], speed_mps: float, lane: float) -> None:
    mirrored = [u._replace(y_m=-u.y_m, y_mps=-(u.y_mps or 0.0)) for u in present]
    bend = Lane(0.2, 0.01, lane, 0.0)
    other = Lane(-0.2, -0.01, -lane, 0.0)
    assert way(*mirrored, speed_mps=speed_mps, lane=other) == way(*present, speed_mps=speed_mps, lane=bend)


@given(present=st.lists(users, max_size=4), speed_mps=speeds)
def test_the_cap_is_a_speed_for_every_input(present: list[RoadUser], speed_mps: float) -> None:
    found = way(*present, speed_mps=speed_mps)
    assert found.cap_mps >= 0 and found.time_s >= 0
    assert (found.kind == "") == (found.ahead_m is None) == math.isinf(found.cap_mps)


@given(one=walkers, speed_mps=speeds)
def test_before_one_that_walks_in_the_whole_car_passes_or_it_can_stop(
    one: Encounter, speed_mps: float
) -> None:
    """At its cap the car stops before one that walks on, or its rear is past when that one is in the strip."""
    v = min(speed_mps, permitted_speed_mps(one, speed_mps, S))
    stops_m = v * S.reaction_s + v**2 / (2 * S.decel_mps2)
    arrives_s = one.gap_m / max(one.closing_mps, one.step_mps)
    gone = one.free_m + one.car_m <= v * arrives_s + 1e-9
    assert gone or stops_m <= max(one.free_m, v * arrives_s) + 1e-9


def test_the_strip_follows_the_bend_of_the_lane() -> None:
    """On a circle of 50 m the centre of the lane is 4 m to the side 20 m ahead."""
    bend = Lane(0.0, 0.0, 1 / 50, 0.0)
    assert encounter(person(20.0, 4.0), bend, S, VEHICLE).gap_m < 0
    assert encounter(person(20.0, 0.0), bend, S, VEHICLE).gap_m == pytest.approx(
        4.0 - VEHICLE.track_m / 2 - S.person.margin_m - 20 * S.margin_per_m
    )


def test_a_car_beside_the_centre_sweeps_from_its_place_to_the_centre() -> None:
    """A lane whose centre is 1 m to the right: near, the car is where it is; far, it is back at the centre."""
    aside = Lane(1.0, 0.0, 0.0, 0.0)
    near, far = (encounter(person(x_m, 0.0), aside, S, VEHICLE) for x_m in (0.5, 20.0))
    assert near.gap_m < far.gap_m


@pytest.mark.parametrize(("x_mps", "y_mps"), [(0.0, 0.0), (None, None), (0.2, -1.5)])
def test_a_cyclist_that_does_not_ride_along_may_set_off_like_a_person(
    x_mps: float | None, y_mps: float | None
) -> None:
    one = encounter(RoadUser("cyclist", 12.0, 3.5, x_mps, y_mps, 0.9), STRAIGHT, S, VEHICLE)
    assert one.step_mps == S.person.step_mps > S.cyclist.step_mps


@pytest.mark.parametrize("x_mps", [5.0, -5.0])
def test_a_cyclist_that_rides_along_the_lane_swerves_only(x_mps: float) -> None:
    one = encounter(RoadUser("cyclist", 12.0, 3.5, x_mps, 0.0, 0.9), STRAIGHT, S, VEHICLE)
    assert one.step_mps == S.cyclist.step_mps


def test_a_cyclist_ahead_is_followed_at_its_speed_and_not_overtaken() -> None:
    rider = RoadUser("cyclist", 40.0, -1.5, 5.0, 0.0, 0.9)
    behind = encounter(rider, STRAIGHT, S, VEHICLE)
    assert behind.gap_m < 0, "a metre beside the car is too little room to overtake"
    free_m = behind.free_m - S.cyclist_gap_m
    assert permitted_speed_mps(behind, 10.0, S) == pytest.approx(
        min(free_m / S.time_gap_s, math.sqrt(25 + 2 * S.decel_mps2 * free_m))
    )
    steady_m = NOSE_M + S.cyclist_gap_m + 5.0 * S.time_gap_s
    assert way(rider._replace(x_m=steady_m), speed_mps=5.0).cap_mps == pytest.approx(5.0)
    assert encounter(rider._replace(y_m=-4.0), STRAIGHT, S, VEHICLE).gap_m > 0


def test_the_nearer_a_bystander_to_the_edge_the_slower_the_car_passes() -> None:
    caps = [way(person(NOSE_M + 3.0, y_m)).cap_mps for y_m in (1.3, 2.5, 3.5, 4.5)]
    assert caps == sorted(caps) and caps[0] == S.passing_mps and caps[-1] > 8.0


def test_who_walks_towards_the_lane_is_waited_for_and_who_stands_is_passed_slowly() -> None:
    at_m = NOSE_M + 2.5
    assert way(person(at_m, 2.0), speed_mps=1.0).cap_mps == S.passing_mps
    assert way(person(at_m, 2.0, towards_mps=1.4), speed_mps=1.0).cap_mps < 1.0


def test_a_hard_brake_comes_only_when_comfort_does_not_suffice() -> None:
    stop_m = 8.0 * S.brake_s + 8.0**2 / (2 * S.hard_decel_mps2) + S.touch_m
    assert not way(person(NOSE_M + stop_m + 0.1, 0.0)).hard
    assert way(person(NOSE_M + stop_m - 0.1, 0.0)).hard
    assert not way(person(NOSE_M + stop_m - 0.1, 2.5)).hard, "one that stands aside is not in the way"
    assert not way(person(NOSE_M + 1.0, 0.0), speed_mps=0.0).hard


@given(one=encounters, speed_mps=speeds)
def test_a_stronger_brake_is_never_needed_where_a_weaker_one_suffices(
    one: Encounter, speed_mps: float
) -> None:
    weak, strong = (needs_more(one, speed_mps, a, S) for a in (S.decel_mps2, S.hard_decel_mps2))
    assert weak or not strong


def test_the_car_goes_on_when_the_way_has_been_free_for_a_while() -> None:
    giving, standing = GivingWay(S, VEHICLE), Motion(0.0, 0.0)
    in_way, aside = WatchedUsers(0.0, (person(NOSE_M + 1.0, 0.0),)), WatchedUsers(0.0, ())
    seen = [giving.step(in_way, PATH, standing, now_s=n * 0.04) for n in range(25)]
    assert {one.cap_mps for one in seen} == {0.0}
    missed = giving.step(aside, PATH, standing, now_s=1.0)
    assert missed.cap_mps == 0.0 and missed.kind == "person"
    caps = [giving.step(aside, PATH, standing, now_s=1.04 + n * 0.04).cap_mps for n in range(30)]
    free = caps.index(math.inf)
    assert free * 0.04 == pytest.approx(S.free_s, abs=0.08)
    assert set(caps[:free]) == {0.0} and set(caps[free:]) == {math.inf}


def test_the_cap_has_a_cause_only_where_a_road_user_sets_it() -> None:
    slow = way(person(NOSE_M + 8.0, 0.0), speed_mps=2.0)
    assert slow.sets(slow.cap_mps) and not slow.sets(slow.cap_mps - 0.1) and not CLEAR.sets(math.inf)


def test_an_unsure_detection_does_not_limit_the_speed() -> None:
    ghost = person(NOSE_M + 5.0, 0.0)._replace(confidence=S.min_confidence - 0.01)
    assert way(ghost) == CLEAR


def test_the_path_is_moved_to_the_time_of_the_step() -> None:
    """A path of 1 s ago, driven at 8 m/s, has its bend 8 m nearer."""
    giving = GivingWay(S, VEHICLE)
    lane = Lane(0.0, 0.0, 0.0, 0.002)
    old = giving.step(
        WatchedUsers(0.0, (person(20.0, 3.0),)), PATH._replace(lane=lane), Motion(8.0, 0.0), now_s=1.0
    )
    moved = lane.after(Motion(8.0, 0.0), 1.0)
    assert old == way(person(20.0, 3.0), lane=moved)
