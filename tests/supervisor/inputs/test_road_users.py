"""People, cyclists and animals after validation."""

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from supervisor_rig import SETTINGS

from supervisor.inputs.road_users import NO_DETECTOR, WatchedUsers, judge_road_users
from trepid.clothoid import Motion
from trepid.messages import RoadUsers

LIMITS = SETTINGS.validation
WALKER = RoadUsers(
    t_s=0.0,
    kinds=("person",),
    x_m=(20.0,),
    y_m=(-3.0,),
    x_mps=(0.0,),
    y_mps=(1.5,),
    confidences=(0.9,),
    detects=("person",),
)


def judge(message: RoadUsers | None, motion: Motion | None = None, *, age_s: float = 0.0) -> WatchedUsers:
    return judge_road_users(message, motion, now_s=age_s, settings=LIMITS)


def test_without_a_detector_nobody_is_known_and_nothing_is_detected() -> None:
    assert judge(None) == NO_DETECTOR
    assert judge(None).detects == ()


@pytest.mark.parametrize(
    "broken",
    [
        {"x_m": (math.nan,)},
        {"y_m": (math.inf,)},
        {"y_m": (1e4,)},
        {"x_mps": (math.inf,)},
        {"x_mps": (math.nan,)},  # one axis of a velocity alone
        {"confidences": (1.2,)},
        {"confidences": (math.nan,)},
        {"kinds": ("person", "person")},
        {"t_s": math.nan},
        {"t_s": 1.0},
        {"t_s": -1.0},
    ],
)
def test_a_broken_or_stale_message_is_not_a_free_road(broken: dict[str, object]) -> None:
    assert judge(replace(WALKER, **broken)).users is None  # type: ignore[arg-type]


def test_a_message_that_cannot_be_decoded_is_broken() -> None:
    for message in (None, WALKER):
        assert judge_road_users(message, None, now_s=0.0, settings=LIMITS, malformed=True).users is None


def test_an_unknown_velocity_is_valid_and_stays_unknown() -> None:
    users = judge(replace(WALKER, x_mps=(math.nan,), y_mps=(math.nan,)), age_s=0.1).users
    assert users is not None and (users[0].x_mps, users[0].y_mps) == (None, None)
    assert (users[0].x_m, users[0].y_m) == (20.0, -3.0)


def test_over_the_age_of_the_message_the_person_walks_and_the_car_drives() -> None:
    users = judge(WALKER, Motion(8.0, 0.0), age_s=0.1).users
    assert users is not None
    assert (users[0].x_m, users[0].y_m) == pytest.approx((20.0 - 0.8, -3.0 + 0.15))


@given(
    x_m=st.floats(5, 50),
    y_m=st.floats(-8, 8),
    yaw_rate_radps=st.floats(-0.5, 0.5),
    age_s=st.floats(0, 0.3),
)
def test_a_turn_of_the_car_keeps_the_distance_of_a_standing_person(
    x_m: float, y_m: float, yaw_rate_radps: float, age_s: float
) -> None:
    """A rotation about the rear axle keeps the distance, and the person turns the other way."""
    standing = replace(WALKER, x_m=(x_m,), y_m=(y_m,), y_mps=(0.0,))
    users = judge(standing, Motion(0.0, yaw_rate_radps), age_s=age_s).users
    assert users is not None
    assert math.hypot(users[0].x_m, users[0].y_m) == pytest.approx(math.hypot(x_m, y_m))
    turned_rad = math.atan2(users[0].y_m, users[0].x_m) - math.atan2(y_m, x_m)
    assert turned_rad == pytest.approx(-yaw_rate_radps * age_s, abs=1e-9)
