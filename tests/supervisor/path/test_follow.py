"""Following the vehicle ahead: its trail, the gap to it, and vehicles that are not followed."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supervisor.path.follow import Follower, Following, Lead, judge_lead
from supervisor.path.fusion import Path
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane, Motion
from trepid.config import CONFIG_DIR, load
from trepid.messages import LeadVehicle

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
FRONT_M = VEHICLE.wheelbase_m + VEHICLE.front_overhang_m
STEP_S = 0.04
STRAIGHT = Lane(0.0, 0.0, 0.0, 0.0)
TENTHS = st.integers(0, 120).map(lambda n: n / 10)


def judge(message: LeadVehicle | None, *, speed_mps: float = 8.0, now_s: float = 0.0) -> Lead:
    return judge_lead(message, Motion(speed_mps, 0.0), now_s=now_s, settings=SETTINGS.validation)


def lead(
    distance_m: float | None = 20.0,
    lateral_m: float | None = 0.0,
    speed_mps: float | None = 8.0,
    confidence: float = 0.9,
    t_s: float = 0.0,
) -> LeadVehicle:
    return LeadVehicle(
        t_s=t_s, distance_m=distance_m, lateral_m=lateral_m, speed_mps=speed_mps, confidence=confidence
    )


def test_without_a_detector_there_is_no_vehicle_ahead_and_no_harm() -> None:
    assert (judge(None).confidence, judge(None).distance_m) == (0, None)


def test_no_vehicle_ahead_is_no_broken_message() -> None:
    assert judge(lead(None, None, None, confidence=0.0)).confidence == 0


@pytest.mark.parametrize(
    "message",
    [
        lead(distance_m=None),
        lead(distance_m=math.nan),
        lead(distance_m=1e300),
        lead(lateral_m=math.inf),
        lead(confidence=math.nan),
        lead(confidence=2.0),
        lead(t_s=-1.0),
        lead(t_s=math.nan),
    ],
)
def test_a_broken_or_stale_lead_is_unknown(message: LeadVehicle) -> None:
    assert judge(message).confidence is None
    assert judge(message).distance_m is None


def test_the_distance_shrinks_while_the_message_ages() -> None:
    assert judge(lead(20.0, speed_mps=3.0), now_s=0.2).distance_m == pytest.approx(20.0 - 5.0 * 0.2)


def test_a_lead_of_unknown_speed_is_taken_to_stand() -> None:
    assert judge(lead(speed_mps=None)).speed_mps == 0
    assert judge(lead(speed_mps=-3.0)).speed_mps == 0


def test_the_speed_cap_keeps_the_time_gap_and_brakes_for_a_standing_vehicle() -> None:
    follower, own = Follower(SETTINGS.follow, VEHICLE), SETTINGS.follow
    steady = follower.speed_cap_mps(judge(lead(11.0, speed_mps=8.0)))
    assert steady == pytest.approx((11.0 - own.standstill_gap_m) / own.time_gap_s)
    standing = follower.speed_cap_mps(judge(lead(21.0, speed_mps=0.0)))
    assert standing == pytest.approx(math.sqrt(2 * own.decel_mps2 * (21.0 - own.standstill_gap_m)))
    assert follower.speed_cap_mps(judge(lead(2.0))) == 0
    assert follower.speed_cap_mps(judge(None)) == math.inf


def test_the_last_decimetres_behind_a_vehicle_are_not_crept() -> None:
    follower, own = Follower(SETTINGS.follow, VEHICLE), SETTINGS.follow
    end_m = own.standstill_gap_m + own.standstill_slack_m
    assert follower.speed_cap_mps(judge(lead(end_m - 0.01, speed_mps=0.0), speed_mps=0.0)) == 0
    before_mps = follower.speed_cap_mps(judge(lead(end_m + 0.01, speed_mps=0.0), speed_mps=0.0))
    assert before_mps == pytest.approx((own.standstill_slack_m + 0.01) / own.time_gap_s)


@given(st.floats(0, 60), st.floats(0, 60), st.floats(0, 20))
@settings(max_examples=50, deadline=None)
def test_a_nearer_lead_never_allows_more_speed(one_m: float, other_m: float, speed_mps: float) -> None:
    follower = Follower(SETTINGS.follow, VEHICLE)
    near, far = sorted((one_m, other_m))
    caps = [follower.speed_cap_mps(judge(lead(d, speed_mps=speed_mps), speed_mps=0.0)) for d in (near, far)]
    assert caps[0] <= caps[1]


def follow(
    follower: Follower,
    places: list[tuple[float, float]],
    *,
    speed_mps: float,
    yaw_rate_radps: float = 0.0,
    road: Lane | None = None,
    first: int = 0,
    lead_mps: float | None = None,
) -> Following:
    """Steps of 0.04 s with the lead's rear at ``places`` relative to our axle; the last answer."""
    motion = Motion(speed_mps, yaw_rate_radps)
    for n, (x_m, y_m) in enumerate(places, start=first):
        now_s = n * STEP_S
        here = Lead(
            age_s=0.0,
            confidence=0.9,
            distance_m=x_m - FRONT_M,
            lateral_m=y_m,
            speed_mps=speed_mps if lead_mps is None else lead_mps,
        )
        seen = None if road is None else Path(now_s, road, 20.0, "cv")
        answer = follower.step(here, seen, motion, now_s=now_s)
    return answer


def follower_on_a_straight(speed_mps: float = 5.0, gap_m: float = 12.0) -> Follower:
    """A follower after 4 s behind a lead straight ahead, with the lane detected."""
    follower = Follower(SETTINGS.follow, VEHICLE)
    follow(follower, [(FRONT_M + gap_m, 0.0)] * 100, speed_mps=speed_mps, road=STRAIGHT)
    return follower


@pytest.mark.parametrize(
    "message", [lead(confidence=0.3), lead(distance_m=60.0), lead(lateral_m=20.0), lead(distance_m=None)]
)
def test_a_lead_that_is_uncertain_far_or_aside_is_not_followed(message: LeadVehicle) -> None:
    follower = Follower(SETTINGS.follow, VEHICLE)
    assert not follower.step(judge(message), None, Motion(8.0, 0.0), now_s=0.0).usable


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_trail_of_a_lead_on_a_circle_is_the_circle_and_not_the_way_to_its_bumper(side: float) -> None:
    """Both drive the same circle of 40 m; the chord to the lead would cut 2 m to the inside."""
    radius_m, speed_mps, gap_m = 40.0, 5.0, 18.0
    angle = gap_m / radius_m
    rear = radius_m * math.sin(angle), side * radius_m * (1 - math.cos(angle))
    follower = Follower(SETTINGS.follow, VEHICLE)
    circle = Lane(0.0, 0.0, side / radius_m, 0.0)
    turning = side * speed_mps / radius_m
    follow(follower, [rear] * 100, speed_mps=speed_mps, yaw_rate_radps=turning, road=circle)
    answer = follow(follower, [rear] * 100, speed_mps=speed_mps, yaw_rate_radps=turning, first=100)
    assert answer.usable
    assert answer.path is not None
    assert answer.path.source == "lead"
    lane = answer.path.lane
    assert lane.offset_m == pytest.approx(0.0, abs=0.1)
    assert lane.curvature_1pm == pytest.approx(side / radius_m, rel=0.1)
    for x_m in (4.0, 8.0, 12.0):
        circle_m = side * (radius_m - math.sqrt(radius_m**2 - x_m**2))
        assert lane.y_m(x_m) == pytest.approx(circle_m, abs=0.15)


def leaving(side: float, *, speed_mps: float = 5.0, gap_m: float = 12.0) -> list[tuple[float, float]]:
    """A lead that drifts 6 m off the road within 4 s: the least jerk of ``change_lane``."""
    places = []
    for n in range(100):
        tau = n * STEP_S / 4.0
        places.append((FRONT_M + gap_m, side * 6.0 * (10 * tau**3 - 15 * tau**4 + 6 * tau**5)))
    return places


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_leader_that_leaves_the_road_is_followed_no_farther(side: float) -> None:
    follower = follower_on_a_straight()
    last = 100
    for place in leaving(side):
        answer = follow(follower, [place], speed_mps=5.0, first=last)
        last += 1
        if not answer.usable:
            break
    assert not answer.usable
    assert abs(place[1]) < 6.0, "given up before it stands in the ditch"
    assert answer.path is not None, "what is left of the trail is there to stop on"
    for x_m in (0.0, 4.0, 8.0):
        assert abs(answer.path.lane.y_m(x_m)) < 0.3


def test_a_vehicle_that_cuts_in_is_followed_once_it_drives_where_the_road_is() -> None:
    follower = follower_on_a_straight()
    aside = follow(follower, [(FRONT_M + 8.0, 3.5)] * 50, speed_mps=5.0, first=100)
    assert not aside.usable
    assert follow(follower, [(FRONT_M + 8.0, 0.05)] * 10, speed_mps=5.0, first=150).usable


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_vehicle_that_comes_in_from_aside_does_not_bend_the_trail(side: float) -> None:
    follower = follower_on_a_straight()
    comes_in = [(FRONT_M + 8.0, side * (3.0 - place)) for _, place in leaving(1.0)][:70]
    for n, place in enumerate(comes_in, start=100):
        answer = follow(follower, [place], speed_mps=2.0, lead_mps=2.0, first=n)
        assert answer.path is not None
        assert max(abs(answer.path.lane.y_m(x_m)) for x_m in (0.0, 4.0, 8.0)) < 0.1


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_leader_that_left_the_road_is_not_followed_again_until_the_road_is_detected(side: float) -> None:
    follower = follower_on_a_straight(speed_mps=3.0)
    gone = [(FRONT_M + 12.0, side * 0.05 * n) for n in range(60)] + [(FRONT_M + 12.0, side * 1.0)] * 40
    assert not follow(follower, gone, speed_mps=3.0, first=100).usable
    there = (FRONT_M + 12.0, side * 0.3)
    assert follow(follower, [there] * 5, speed_mps=3.0, first=200, road=STRAIGHT).usable


def test_a_single_outlier_removes_nothing_from_the_trail() -> None:
    follower, calm = follower_on_a_straight(), follower_on_a_straight()
    straight = (FRONT_M + 12.0, 0.0)
    wild = follow(follower, [(FRONT_M + 12.0, 2.0), straight], speed_mps=5.0, first=100)
    assert wild.usable
    assert wild.path is not None
    assert wild.path.lookahead_m == follow(calm, [straight] * 2, speed_mps=5.0, first=100).path.lookahead_m  # type: ignore[union-attr]


def test_a_leader_that_stops_is_stopped_behind_on_its_trail() -> None:
    follower = follower_on_a_straight()
    answer = follow(follower, [(FRONT_M + 3.5, 0.0)] * 100, speed_mps=0.0, first=100)
    assert answer.usable
    standing = Lead(age_s=0.0, confidence=0.9, distance_m=3.0, speed_mps=0.0)
    assert follower.speed_cap_mps(standing) == 0


def test_a_leader_that_is_missed_for_a_moment_still_is_there() -> None:
    follower = follower_on_a_straight()
    answer = follower.step(judge(None), None, Motion(5.0, 0.0), now_s=100 * STEP_S)
    assert answer.usable
    assert follower.speed_cap_mps(judge(None)) < math.inf
    late = 100 * STEP_S + SETTINGS.follow.hold_s + 0.1
    assert not follower.step(judge(None), None, Motion(5.0, 0.0), now_s=late).usable
    assert follower.speed_cap_mps(judge(None)) == math.inf


def test_following_ends_after_its_longest_time() -> None:
    follower = follower_on_a_straight()
    steps = math.ceil(SETTINGS.follow.max_follow_s / STEP_S) + 2
    answer = follow(follower, [(FRONT_M + 12.0, 0.0)] * steps, speed_mps=5.0, first=100)
    assert not answer.usable


def test_the_mirrored_lead_gives_the_mirrored_path() -> None:
    noise = [0.05 * math.sin(7.0 * n) for n in range(150)]
    answers = []
    for side in (1.0, -1.0):
        places = [(20.0 + 0.01 * n, side * (0.3 + w)) for n, w in enumerate(noise)]
        follower = Follower(SETTINGS.follow, VEHICLE)
        answers.append(follow(follower, places, speed_mps=4.0, yaw_rate_radps=side * 0.02).path)
    left, right = answers
    assert left is not None
    assert right is not None
    assert left.lane[:4] == pytest.approx(tuple(-value for value in right.lane[:4]), abs=1e-9)


@given(TENTHS, TENTHS, st.floats(0, 40))
def test_near_means_that_two_gently_braking_vehicles_would_stop_within_the_minimum_gap(
    own_mps: float, lead_mps: float, gap_m: float
) -> None:
    follow = SETTINGS.follow
    end_m = gap_m + (lead_mps**2 - own_mps**2) / (2 * follow.decel_mps2)
    if abs(end_m - follow.touch_m) < 1e-6:
        return
    ahead = Lead(confidence=0.9, distance_m=gap_m, speed_mps=lead_mps)
    near = Follower(follow, VEHICLE).is_near(ahead, Motion(own_mps, 0.0))
    assert near == (end_m < follow.touch_m and own_mps > lead_mps)


def test_no_vehicle_or_an_uncertain_one_is_not_near() -> None:
    follower, fast = Follower(SETTINGS.follow, VEHICLE), Motion(8.0, 0.0)
    assert not follower.is_near(judge(None), fast)
    assert not follower.is_near(Lead(confidence=0.4, distance_m=2.0), fast)
    assert not follower.is_near(Lead(confidence=0.9, distance_m=2.0), None)
    assert follower.is_near(Lead(confidence=0.9, distance_m=2.0), fast)
