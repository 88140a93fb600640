"""Small movements: the slope of a measurement over what should move it, and whom a witness believes."""

import math
from collections import deque

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, VehicleState
from vehicle.measurement.check import build
from vehicle.measurement.settings import load_measurement
from vehicle.measurement.slope import Slope
from vehicle.measurement.steering import Bicycle

CAR = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
LIMITS = load_measurement().slope
PERIOD_S, FILTER_S = 0.01, 0.15
NOISE_RAD = 0.0005


def compare_slopes(
    true_slope, *, offset=0.0, seconds=10.0, seed=0, amplitude=0.002, witnessed_slope=1.0
) -> Slope:
    """y = true_slope·x + offset + noise; the witness is w = witnessed_slope·x with noise of its own."""
    found, generator = Slope(LIMITS, filter_s=FILTER_S), np.random.default_rng(seed)
    for k in range(round(seconds / PERIOD_S)):
        x = amplitude * math.sin(2 * math.pi * 0.5 * k * PERIOD_S)
        noise, other = NOISE_RAD * generator.standard_normal(2)
        found.step(x, true_slope * x + offset + noise, witnessed_slope * x + other, PERIOD_S)
    return found


@given(st.floats(-3.0, -0.5) | st.floats(3.0, 6.0), st.floats(-0.1, 0.1), st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_the_interval_holds_the_true_slope_whatever_the_offset(true_slope, offset, seed):
    least, most = compare_slopes(true_slope, offset=offset, seed=seed).interval
    assert least <= true_slope <= most
    assert most - least < 0.5


def test_the_interval_grows_with_the_noise_and_shrinks_with_time():
    short, long = (compare_slopes(-1.0, seconds=seconds).interval for seconds in (4.0, 8.0))
    small, large = (compare_slopes(-1.0, amplitude=amplitude).interval for amplitude in (0.0005, 0.002))
    assert long[1] - long[0] < short[1] - short[0]
    assert large[1] - large[0] < small[1] - small[0]


@pytest.mark.parametrize(
    "found",
    [
        compare_slopes(-1.0, seconds=3.0),
        compare_slopes(-1.0, amplitude=0.5 * LIMITS.moved_rad),
        compare_slopes(-1.0, witnessed_slope=-1.0),
        Slope(LIMITS, filter_s=FILTER_S),
    ],
    ids=["few values", "no movement", "a witness of the measurement", "nothing"],
)
def test_without_movement_or_values_or_an_opinion_of_the_witness_there_is_no_slope(found):
    assert found.interval is None


@pytest.mark.parametrize("frequency_hz", [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize("speed_mps", [5.0, 15.0])
def test_a_car_that_steers_against_wind_and_ruts_is_believed(speed_mps, frequency_hz):
    """ψ' = g·(δ + d): the wheel only answers the disturbance d, by heading and place, late and with a lag."""
    check, bicycle, generator = build(CAR), Bicycle(CAR), np.random.default_rng(1)
    heading_rad = place_m = wheel_rad = 0.0
    orders = deque([0.0] * round(0.15 / PERIOD_S))
    for k in range(1500):
        now_s = k * PERIOD_S
        pushed_rad = 0.002 * math.sin(2 * math.pi * frequency_hz * now_s)
        yaw_radps = bicycle.yaw_rate_radps(wheel_rad + pushed_rad, speed_mps)
        speed, angle, rate = generator.standard_normal(3)
        seen = VehicleState(
            t_s=now_s,
            speed_mps=speed_mps * (1.0 + 0.002 * speed),
            road_wheel_angle_rad=wheel_rad + 0.0005 * angle,
            yaw_rate_radps=yaw_radps + 0.002 * rate,
            driver_override=False,
        )
        assert check.step(seen, now_s=now_s).state.doubted == ()
        heading_rad += yaw_radps * PERIOD_S
        place_m += speed_mps * heading_rad * PERIOD_S
        orders.append(-(0.8 * heading_rad + 1.5 * place_m / speed_mps) / bicycle.per_rad(speed_mps))
        order_rad = orders.popleft()
        check.add_command(
            Command(t_s=now_s, road_wheel_angle_rad=order_rad, speed_mps=speed_mps, accel_mps2=0.0)
        )
        wheel_rad += PERIOD_S / CAR.steering_lag_s * (order_rad - wheel_rad)
