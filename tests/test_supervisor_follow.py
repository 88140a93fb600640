"""Following the vehicle ahead: its trail, the gap to it, and what is no vehicle to follow."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supervisor.follow import Follower, Lead, judge_lead
from supervisor.lane import Motion
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, load
from trepid.messages import LeadVehicle
from trepid.vehicle import Vehicle

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
FRONT_M = VEHICLE.wheelbase_m + VEHICLE.front_overhang_m
STEP_S = 0.04


def judged(message: LeadVehicle | None, *, speed_mps: float = 8.0, now_s: float = 0.0) -> Lead:
    return judge_lead(message, Motion(speed_mps, 0.0), now_s=now_s, settings=SETTINGS.sightings)


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
    assert (judged(None).confidence, judged(None).distance_m) == (0, None)


def test_no_vehicle_ahead_is_no_broken_message() -> None:
    assert judged(lead(None, None, None, confidence=0.0)).confidence == 0


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
    assert judged(message).confidence is None
    assert judged(message).distance_m is None


def test_the_distance_shrinks_while_the_message_ages() -> None:
    assert judged(lead(20.0, speed_mps=3.0), now_s=0.2).distance_m == pytest.approx(20.0 - 5.0 * 0.2)


def test_a_lead_of_unknown_speed_is_taken_to_stand() -> None:
    assert judged(lead(speed_mps=None)).speed_mps == 0
    assert judged(lead(speed_mps=-3.0)).speed_mps == 0


def test_the_speed_cap_keeps_the_time_gap_and_brakes_for_a_standing_vehicle() -> None:
    follower, own = Follower(SETTINGS.follow, VEHICLE), SETTINGS.follow
    steady = follower.speed_cap_mps(judged(lead(11.0, speed_mps=8.0)))
    assert steady == pytest.approx((11.0 - own.standstill_gap_m) / own.time_gap_s)
    standing = follower.speed_cap_mps(judged(lead(21.0, speed_mps=0.0)))
    assert standing == pytest.approx(math.sqrt(2 * own.decel_mps2 * (21.0 - own.standstill_gap_m)))
    assert follower.speed_cap_mps(judged(lead(2.0))) == 0
    assert follower.speed_cap_mps(judged(None)) == math.inf


@given(st.floats(0, 60), st.floats(0, 60), st.floats(0, 20))
@settings(max_examples=50, deadline=None)
def test_a_nearer_lead_never_allows_more_speed(one_m: float, other_m: float, speed_mps: float) -> None:
    follower = Follower(SETTINGS.follow, VEHICLE)
    near, far = sorted((one_m, other_m))
    caps = [follower.speed_cap_mps(judged(lead(d, speed_mps=speed_mps), speed_mps=0.0)) for d in (near, far)]
    assert caps[0] <= caps[1]


@pytest.mark.parametrize(
    "message", [lead(confidence=0.3), lead(distance_m=60.0), lead(lateral_m=6.0), lead(distance_m=None)]
)
def test_what_is_unsure_far_or_aside_is_not_followed(message: LeadVehicle) -> None:
    assert Follower(SETTINGS.follow, VEHICLE).step(judged(message), Motion(8.0, 0.0), now_s=0.0) is None


def test_a_lead_seen_for_the_first_time_gives_an_arc_towards_it() -> None:
    path = Follower(SETTINGS.follow, VEHICLE).step(judged(lead(20.0, 1.5)), Motion(8.0, 0.0), now_s=0.0)
    assert path is not None
    assert path.source == "lead"
    assert path.lane.y_m(FRONT_M + 20.0) == pytest.approx(1.5, abs=0.1)
    assert path.lane.heading_rad == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_trail_of_a_lead_on_a_circle_is_the_circle_and_not_the_way_to_its_bumper(side: float) -> None:
    """Both drive the same circle of 40 m; the chord to the lead would cut 2 m to the inside."""
    radius_m, speed_mps, gap_m = 40.0, 5.0, 18.0
    follower, motion = Follower(SETTINGS.follow, VEHICLE), Motion(speed_mps, side * speed_mps / radius_m)
    angle = gap_m / radius_m
    rear = radius_m * math.sin(angle), side * radius_m * (1 - math.cos(angle))
    for n in range(150):
        here = lead(rear[0] - FRONT_M, rear[1], speed_mps, t_s=n * STEP_S)
        path = follower.step(judged(here, speed_mps=speed_mps, now_s=n * STEP_S), motion, now_s=n * STEP_S)
    assert path is not None
    assert path.lane.offset_m == pytest.approx(0.0, abs=0.1)
    assert path.lane.curvature_1pm == pytest.approx(side / radius_m, rel=0.1)
    for x_m in (4.0, 8.0, 12.0, 16.0):
        circle_m = side * (radius_m - math.sqrt(radius_m**2 - x_m**2))
        assert path.lane.y_m(x_m) == pytest.approx(circle_m, abs=0.15)
