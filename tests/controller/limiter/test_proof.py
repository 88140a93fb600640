"""Ten million random calls, and the filter of UN R79 for all demands within the limits (make proof)."""

import math

import numpy as np
import pytest
from limiter_rig import SHIPPED, limiter, state
from message_rig import SHUTTLE, command, vehicle
from scipy.optimize import linprog
from scipy.signal import butter, sosfilt
from scipy.sparse import diags_array, vstack

import controller.limiter.limiter
from controller.limiter.limits import narrow

CALLS, PARTS = 10_000_000, 50
CARS = (
    SHUTTLE,
    vehicle(understeer_gradient_rad_per_mps2=0.0),
    vehicle(understeer_gradient_rad_per_mps2=-0.00356),
    vehicle(wheelbase_m=0.3, accel_lag_s=0.0, steering_delay_s=0.0, steering_lag_s=0.0),
)
NUMBERS = 9  # drawn for a call


def check_narrowing(outer, inner):
    """The limiter's own narrowing, watched."""
    low, high = narrow(outer, inner)
    assert outer[0] <= low <= high <= outer[1]
    return low, high


def random_calls(seed, calls):
    """Commands, arrivals, states and times: mostly plausible, often extreme, at times absurd."""
    generator = np.random.default_rng(seed)
    drawn = generator.standard_normal((calls, NUMBERS)) * 10.0 ** generator.uniform(
        -2.0, 1.5, (calls, NUMBERS)
    )
    absurd = generator.random((calls, NUMBERS)) < 0.005
    drawn[absurd] = generator.choice([math.nan, math.inf, -math.inf, 1e300], absurd.sum())
    chances = generator.random((calls, 4))
    now_s = 0.0
    for numbers, (lost, blind, hands, pause) in zip(drawn.tolist(), chances.tolist(), strict=True):
        wanted, rate, goal, accel, speed, wheel, yaw, late, torque = numbers
        now_s += 0.2 * pause**8
        requested = command(
            now_s, road_wheel_angle_rad=wanted, road_wheel_rate_radps=rate, speed_mps=goal, accel_mps2=accel
        )
        known = state(
            now_s,
            speed_mps=3.0 * speed,
            road_wheel_angle_rad=0.2 * wheel,
            yaw_rate_radps=None if late > 0.0 else yaw,
            driver_override=hands < 0.01,
            driver_torque_nm=None if hands < 0.9 else torque,
        )
        yield (
            None if lost < 0.02 else requested,
            now_s - 0.02 * abs(late),
            None if blind < 0.02 else known,
            now_s,
        )


@pytest.mark.proof
@pytest.mark.parametrize("part", range(PARTS))
def test_the_feasible_interval_is_never_empty_for_any_input(monkeypatch, part):
    """A part takes about ten seconds; ``-k "[7]"`` runs one, ``--lf`` those that failed."""
    monkeypatch.setattr(controller.limiter.limiter, "narrow", check_narrowing)
    hold_for_any_call(part, CALLS // PARTS)


def test_the_feasible_interval_is_not_empty_in_a_few_thousand_calls(monkeypatch):
    monkeypatch.setattr(controller.limiter.limiter, "narrow", check_narrowing)
    hold_for_any_call(12345, 4000)


def hold_for_any_call(seed, calls):
    """Every output is finite and bounded, and the wheel moves no faster than it can."""
    car = CARS[seed % len(CARS)]
    one, last_rad, last_s = limiter(SHIPPED, car), None, None
    fastest = car.max_road_wheel_rate_radps
    for requested, received_s, known, now_s in random_calls(seed, calls):
        out = one.step(requested, received_s, known, now_s=now_s)
        angle_rad = out.road_wheel_angle_rad
        assert abs(angle_rad) <= car.max_road_wheel_angle_rad
        assert -SHIPPED.max_decel_mps2 <= out.accel_mps2 <= SHIPPED.max_accel_mps2
        assert math.isfinite(out.speed_mps)
        if last_rad is not None and not one.handed_over:
            reach_rad = fastest * min(now_s - last_s, SHIPPED.max_step_s)
            assert abs(angle_rad - last_rad) <= reach_rad + 1e-12
        measured = one.handed_over or last_rad is not None or angle_rad != 0.0
        last_rad, last_s = (angle_rad if measured else None), now_s


def worst_r79_jerk(lateral_mps2, jerk_mps3, *, rate_hz=50, seconds=6.0):
    """Largest jerk after the filter of UN R79 that any a_y(t) within both limits can make: a linear programme."""
    count, window = round(seconds * rate_hz), round(0.5 * rate_hz)
    impulse = np.eye(1, count)[0]
    response = sosfilt(butter(4, 0.5, fs=rate_hz, output="sos"), impulse)[::-1]
    weights = response.copy()
    weights[: count - window] -= response[window:]
    steps = diags_array([-1.0, 1.0], offsets=[0, 1], shape=(count - 1, count))
    found = linprog(
        -2.0 * weights,
        A_ub=vstack([steps, -steps]),
        b_ub=np.full(2 * (count - 1), jerk_mps3 / rate_hz),
        bounds=[(-lateral_mps2, lateral_mps2)] * count,
        method="highs",
    )
    assert found.status == 0
    return -found.fun


def test_no_demand_within_the_shares_can_breach_the_filter_of_un_r79():
    lateral_mps2 = SHIPPED.lateral_accel_share * SHIPPED.lateral_accel_mps2
    jerk_mps3 = SHIPPED.lateral_jerk_share * SHIPPED.lateral_jerk_mps3
    assert jerk_mps3 < worst_r79_jerk(lateral_mps2, jerk_mps3) < SHIPPED.lateral_jerk_mps3
    assert worst_r79_jerk(SHIPPED.lateral_accel_mps2, SHIPPED.lateral_jerk_mps3) > SHIPPED.lateral_jerk_mps3
