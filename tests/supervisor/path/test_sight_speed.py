"""The speed within sight: its inequality for all numbers, its memory, and cars that stop before what is hidden.

The closed loop runs the speed control of the controller on a plant with dead time and drive lag.
"""

import math
from collections import deque
from dataclasses import replace

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from controller.speed_control import SpeedControl
from controller.speed_limits import SpeedSettings, Target
from supervisor.path.sight_speed import CALM, SightSettings, SightSpeed, StoppingWay
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Motion
from trepid.config import CONFIG_DIR, load, read
from trepid.messages import ImageStatistics, Stop
from trepid.scale import scaled_message, scaled_settings

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SIGHT = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).sight
BRAKE_HARD_S = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).modes.brake_hard_s
FRONT_M = VEHICLE.wheelbase_m + VEHICLE.front_overhang_m
FRAME_S = 0.04
STATISTICS = ImageStatistics(
    t_s=0.0,
    brightness=0.5,
    contrast=0.2,
    over_exposed=0.0,
    under_exposed=0.0,
    sharpness=500.0,
    frozen_s=0.0,
    spots=0.0,
)
WAYS = st.builds(StoppingWay, st.floats(0.2, 8.0), st.floats(0.0, 3.0))
ANYTHING = st.one_of(st.none(), st.floats(allow_nan=True, allow_infinity=True))


def sight_speed() -> SightSpeed:
    return SightSpeed(SIGHT, front_m=FRONT_M, drive_lag_s=VEHICLE.accel_lag_s)


def statistics_of(sight_m: float | None, cause: str = "fog", sigma_m: float | None = 0.0) -> ImageStatistics:
    return replace(STATISTICS, sight_m=sight_m, sight_sigma_m=sigma_m, sight_cause=cause)


@given(way=WAYS, free_m=st.floats(1e-6, 1e5))
def test_the_stopping_way_from_the_cap_is_the_free_way(way, free_m):
    assert way.way_m(way.speed_mps(free_m)) == pytest.approx(free_m, rel=1e-9)


@given(way=WAYS, speed_mps=st.floats(1e-3, 100.0))
def test_the_cap_of_a_stopping_way_is_the_speed_that_has_it(way, speed_mps):
    assert way.speed_mps(way.way_m(speed_mps)) == pytest.approx(speed_mps, rel=1e-9)


@given(way=WAYS, free_m=ANYTHING, further_m=st.floats(0.0, 1e6))
def test_more_free_way_never_lowers_the_cap_and_no_number_gives_an_impossible_one(way, free_m, further_m):
    cap_mps = way.speed_mps(free_m)
    assert cap_mps >= 0.0
    if free_m is None or not free_m > 0.0:
        assert cap_mps == 0.0
    else:
        assert way.speed_mps(free_m + further_m) >= cap_mps


@given(way=WAYS, speed_mps=st.floats(0.0, 100.0), faster_mps=st.floats(1e-3, 100.0))
def test_a_faster_car_needs_more_way(way, speed_mps, faster_mps):
    assert way.way_m(speed_mps + faster_mps) > way.way_m(speed_mps)


def test_a_speed_that_is_no_number_needs_every_way():
    assert StoppingWay(1.0, 0.5).way_m(math.nan) == math.inf


@given(sight_m=ANYTHING, sigma_m=ANYTHING, cause=st.sampled_from(["fog", "dark", "crest"]))
def test_every_stated_sight_allows_at_most_what_the_same_sight_without_doubt_allows(sight_m, sigma_m, cause):
    sight = sight_speed().step(statistics_of(sight_m, cause, sigma_m), Motion(5.0, 0.0), age_s=0.0, now_s=0.0)
    if sight.sight_m is None:  # never stated: the car says so
        assert sight.cause == "sight_unknown"
    else:
        sure = sight_speed().step(statistics_of(sight_m, cause, 0.0), Motion(5.0, 0.0), age_s=0.0, now_s=0.0)
        assert 0.0 <= sight.cap_mps <= sure.cap_mps


@given(
    sight_m=st.floats(20.0, 300.0),
    share=st.floats(0.0, 1.0),
    more=st.floats(0.01, 0.5),
    factor=st.floats(1.01, 2.0),
)
def test_a_longer_and_a_surer_sight_allow_more_speed(sight_m, share, more, factor):
    def free_m(metres: float, sigma_m: float) -> float:
        return (
            sight_speed()
            .step(statistics_of(metres, "fog", sigma_m), Motion(5.0, 0.0), age_s=0.0, now_s=0.0)
            .free_m
        )

    assert free_m(factor * sight_m, share * sight_m) > free_m(sight_m, share * sight_m)
    assert free_m(sight_m, (share + more) * sight_m) < free_m(sight_m, share * sight_m)


def test_a_small_deviation_counts_twice_and_a_large_one_leaves_a_share_of_the_sight():
    def end_m(sigma_m: float) -> float:
        return (
            sight_speed()
            .step(statistics_of(100.0, "fog", sigma_m), Motion(5.0, 0.0), age_s=0.0, now_s=0.0)
            .sight_m
        )

    assert end_m(1.0) == pytest.approx(100.0 - 2.0, abs=0.03)
    assert end_m(50.0) == pytest.approx(100.0 / math.e)


@pytest.mark.parametrize("sight_m, sigma_m", [(math.nan, 0.0), (-1.0, 0.0), (30.0, None), (30.0, math.nan)])
def test_an_impossible_sight_after_a_stated_one_never_raises_the_cap(sight_m, sigma_m):
    speed = sight_speed()
    before = speed.step(statistics_of(30.0), Motion(6.0, 0.0), age_s=0.0, now_s=0.0)
    after = speed.step(statistics_of(sight_m, "fog", sigma_m), Motion(6.0, 0.0), age_s=0.0, now_s=FRAME_S)
    assert after.sight_m == pytest.approx(30.0 - 6.0 * FRAME_S)
    assert after.cap_mps < before.cap_mps


def test_a_sight_that_is_no_longer_stated_shrinks_by_the_way_driven_and_then_is_that_of_the_lanes():
    speed, motion = sight_speed(), Motion(6.0, 0.0)
    speed.step(statistics_of(60.0), motion, age_s=0.0, now_s=0.0)
    caps = []
    for n in range(1, 40):
        sight = speed.step(None, motion, age_s=math.inf, now_s=n * FRAME_S)
        caps.append(sight.cap_mps)
    assert caps == sorted(caps, reverse=True)
    assert (sight.sight_m, sight.cause) == (None, "sight_unknown")
    lanes = speed.comfort.speed_mps(SIGHT.unmeasured_m - FRONT_M - SIGHT.margin_m)
    assert caps[-1] == pytest.approx(lanes) and caps[-1] > 0.0


def test_perception_that_never_states_a_sight_gets_a_bounded_speed_and_says_so_without_fear():
    speed = sight_speed()
    sight = speed.step(statistics_of(None, "", None), Motion(8.0, 0.0), age_s=0.0, now_s=0.0)
    assert (sight.sight_m, sight.cause, speed.share(sight, 8.0)) == (None, "sight_unknown", CALM)
    assert speed.comfort.way_m(sight.cap_mps) == pytest.approx(SIGHT.unstated_m - FRONT_M - SIGHT.margin_m)


def test_an_older_frame_shows_less_by_the_way_driven_since():
    now = sight_speed().step(statistics_of(40.0), Motion(10.0, 0.0), age_s=0.0, now_s=1.0)
    old = sight_speed().step(statistics_of(40.0), Motion(10.0, 0.0), age_s=0.2, now_s=1.0)
    assert now.free_m - old.free_m == pytest.approx(2.0)


def test_a_sight_that_nothing_ends_limits_nothing_but_the_reach_of_the_detector_does():
    blind = sight_speed().step(statistics_of(300.0, ""), Motion(20.0, 0.0), age_s=0.0, now_s=0.0)
    watching = sight_speed().step(
        statistics_of(300.0, ""), Motion(20.0, 0.0), age_s=0.0, now_s=0.0, watches=True
    )
    assert blind.cap_mps == math.inf
    stop = sight_speed().emergency
    assert stop.way_m(watching.cap_mps) == pytest.approx(SIGHT.detector.clear_m - FRONT_M - SIGHT.margin_m)


@given(bend_1pm=st.floats(0.0, 0.2), tighter_1pm=st.floats(0.0, 0.2))
def test_a_tighter_bend_never_raises_the_cap(bend_1pm, tighter_1pm):
    caps = [
        sight_speed()
        .step(statistics_of(300.0, ""), Motion(5.0, 0.0), age_s=0.0, now_s=0.0, watches=True, bend_1pm=bend)
        .cap_mps
        for bend in (bend_1pm, bend_1pm + tighter_1pm)
    ]
    assert caps[1] <= caps[0]


def test_the_gap_to_a_leader_replaces_the_sight_that_it_takes_but_not_that_of_a_wall_before_it():
    follows = sight_speed().step(
        statistics_of(18.0, "occluded"), Motion(8.0, 0.0), age_s=0.0, now_s=0.0, leader_m=17.0
    )
    wall = sight_speed().step(
        statistics_of(18.0, "occluded"), Motion(8.0, 0.0), age_s=0.0, now_s=0.0, leader_m=60.0
    )
    foggy = sight_speed().step(
        statistics_of(18.0, "fog"), Motion(8.0, 0.0), age_s=0.0, now_s=0.0, leader_m=17.0
    )
    assert (follows.cap_mps, follows.cause) == (math.inf, "")
    assert wall.cap_mps == foggy.cap_mps < 8.0


@given(
    end_m=st.floats(10.0, 80.0),
    share=st.floats(0.0, 0.15),
    late_s=st.floats(0.0, 0.1),
    more_m=st.floats(0.0, 2.0),
)
def test_a_leader_at_the_end_of_the_sight_is_that_end_however_uncertain_and_old_the_sight_is(
    end_m, share, late_s, more_m
):
    seen = statistics_of(end_m, "occluded", sigma_m=share * end_m)
    leader_m = end_m + more_m - 8.0 * late_s
    follows = sight_speed().step(seen, Motion(8.0, 0.0), age_s=late_s, now_s=0.0, leader_m=leader_m)
    assert (follows.cap_mps, follows.cause) == (math.inf, "")
    behind = sight_speed().step(seen, Motion(8.0, 0.0), age_s=late_s, now_s=0.0, leader_m=1.2 * end_m + 4.0)
    assert behind.cause == "occluded"


@given(sight_m=st.floats(0.0, 300.0), speed_mps=st.floats(0.0, 40.0))
def test_the_input_of_the_rules_is_the_free_way_over_the_stopping_way(sight_m, speed_mps):
    speed = sight_speed()
    sight = speed.step(statistics_of(sight_m), Motion(speed_mps, 0.0), age_s=0.0, now_s=0.0)
    share = speed.share(sight, speed_mps)
    way_m = speed.comfort.way_m(speed_mps)
    if sight.free_m <= 0:
        assert share == 0.0
    elif way_m > 0:
        assert share == pytest.approx(min(sight.free_m / way_m, CALM))
    assert speed.share(sight, None) is None


@given(scale=st.floats(0.05, 1.0), sight_m=st.floats(0.5, 300.0), speed_mps=st.floats(0.0, 30.0))
def test_a_model_car_drives_the_speeds_of_the_large_one_times_its_scale(scale, sight_m, speed_mps):
    def cap_mps(scale: float) -> float:
        settings = scaled_settings(SIGHT, scale)
        speed = SightSpeed(settings, front_m=FRONT_M * scale, drive_lag_s=VEHICLE.accel_lag_s)
        statistics, motion = scaled_message(statistics_of(sight_m), scale), Motion(speed_mps * scale, 0.0)
        return speed.step(statistics, motion, age_s=0.1, now_s=0.0, watches=True).cap_mps

    assert cap_mps(scale) == pytest.approx(cap_mps(1.0) * scale)


def test_the_decelerations_are_those_of_controller_and_limiter():
    speed = SpeedSettings.model_validate(read(CONFIG_DIR / "controller.yaml")["speed"])
    limiter = read(CONFIG_DIR / "limiter.yaml")
    assert SIGHT.comfort.decel_mps2 == speed.comfort.decel_mps2 == limiter["comfort_decel_mps2"]
    assert SIGHT.comfort.jerk_mps3 == speed.comfort.jerk_mps3
    assert SIGHT.firm.decel_mps2 < speed.max_decel_mps2 and SIGHT.firm.jerk_mps3 <= speed.brake_jerk_mps3
    assert SIGHT.emergency.decel_mps2 == speed.emergency.decel_mps2 <= limiter["max_decel_mps2"]
    assert SIGHT.emergency.jerk_mps3 == speed.emergency.jerk_mps3


def test_a_slope_that_the_brake_cannot_hold_is_refused():
    with pytest.raises(ValidationError, match="unknown_slope_mps2"):
        SightSettings.model_validate({**SIGHT.model_dump(), "unknown_slope_mps2": 1.5})


class Car:
    """A car with dead time and drive lag under the speed control of the controller and the speed within sight."""

    STEP_S = 0.02

    def __init__(self, speed_mps: float, cruise_mps: float, *, delay_s: float, grade: float = 0.0) -> None:
        control = SpeedSettings.model_validate(read(CONFIG_DIR / "controller.yaml")["speed"])
        self.control = SpeedControl(control, VEHICLE)
        self.control.accel_mps2 = 0.0
        self.sight, self.cruise_mps = sight_speed(), cruise_mps
        self.x_m, self.speed_mps, self.accel_mps2, self.hill_mps2 = 0.0, speed_mps, 0.0, 9.81 * grade
        self.late = deque([0.0] * round(delay_s / self.STEP_S))
        self.now_s = self.short_s = self.most_mps2 = 0.0
        self.cap_mps, self.brakes_hard, self.braked_hard = cruise_mps, False, False

    def step(self, sight_m: float) -> None:
        """One period; a frame every second one shows ``sight_m``."""
        if round(self.now_s / self.STEP_S) % 2 == 0:
            motion = Motion(self.speed_mps, 0.0)
            sight = self.sight.step(statistics_of(max(sight_m, 0.0)), motion, age_s=0.0, now_s=self.now_s)
            self.short_s = self.short_s + FRAME_S if self.sight.is_too_fast(sight, motion) else 0.0
            self.brakes_hard = self.short_s > BRAKE_HARD_S
            self.braked_hard = self.braked_hard or self.brakes_hard
            self.cap_mps = min(sight.cap_mps, self.cruise_mps)
        if self.brakes_hard:
            demand = self.control.stop(Stop.EMERGENCY, speed_mps=self.speed_mps, dt_s=self.STEP_S)
        else:
            goal = Target(self.cap_mps, None)
            demand = self.control.track(goal, speed_mps=self.speed_mps, dt_s=self.STEP_S)
        self.late.append(demand)
        self.accel_mps2 += (self.late.popleft() - self.accel_mps2) * self.STEP_S / VEHICLE.accel_lag_s
        self.most_mps2 = max(self.most_mps2, -self.accel_mps2)
        faster_mps = max(self.speed_mps + (self.accel_mps2 + self.hill_mps2) * self.STEP_S, 0.0)
        self.x_m += (self.speed_mps + faster_mps) / 2 * self.STEP_S
        self.speed_mps = faster_mps
        self.now_s += self.STEP_S


@settings(max_examples=40, deadline=None)
@given(
    sight_m=st.floats(8.0, 150.0),
    cruise_mps=st.floats(2.0, 30.0),
    delay_s=st.sampled_from([0.02, 0.06, 0.1]),
    grade=st.sampled_from([0.0, 0.02]),
    begins_m=st.floats(0.0, 60.0),
)
def test_a_car_within_its_sight_stops_before_what_stands_at_its_end(
    sight_m, cruise_mps, delay_s, grade, begins_m
):
    """Fog: the sight is constant until the obstacle is nearer; the car comes with a speed that the cap allows."""
    car = Car(0.0, cruise_mps, delay_s=delay_s, grade=grade)
    while car.now_s < 30.0 and car.x_m < begins_m:
        car.step(sight_m)
    wall_m = car.x_m + sight_m
    for _ in range(3000):
        car.step(min(sight_m, wall_m - car.x_m))
    assert car.x_m + FRONT_M < wall_m
    assert car.most_mps2 <= 2.5 and not car.braked_hard


@settings(max_examples=40, deadline=None)
@given(
    speed_mps=st.floats(2.0, 30.0),
    shares=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6),
    delay_s=st.sampled_from([0.02, 0.06, 0.1]),
)
def test_no_sights_that_end_before_a_hidden_wall_let_a_car_pass_it(speed_mps, shares, delay_s):
    """It begins too fast for a comfortable stop; the sights, each for 0.4 s, are any that end before the wall."""
    car = Car(speed_mps, 30.0, delay_s=delay_s)
    wall_m = FRONT_M + SIGHT.margin_m + car.sight.firm.way_m(speed_mps)
    for step in range(4000):
        car.step((wall_m - car.x_m) * shares[step // 20 % len(shares)])
    assert car.x_m + FRONT_M < wall_m
    assert car.most_mps2 <= 4.0
