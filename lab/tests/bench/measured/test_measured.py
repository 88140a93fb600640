"""Wrong measurements: what of a fault can be observed, by closed forms, and what the tables count."""

import math

import pytest

from lab.bench.measured.bench import Errors, MeasuredDrive, driven_row, is_observable, summary
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.faults import WrongMeasurement
from trepid.messages import VehicleState

NOISE = load_simulator()


def error_of(quantity, form, true, **fields):
    """The greatest error of a fault from 1 s on, over 3 s of the true yaw rate ``true(t)``."""
    task = MeasuredDrive("simulator", quantity, form, "straight", 5.0, 1)
    fault = WrongMeasurement(
        kind="wrong_measurement", quantity=quantity, form=form, from_s=1.0, **{"by": None, **fields}
    )
    errors = Errors(task, fault, NOISE)
    for k in range(300):
        state = VehicleState(
            t_s=0.01 * k,
            speed_mps=5.0,
            road_wheel_angle_rad=0.0,
            yaw_rate_radps=true(0.01 * k),
            driver_override=False,
        )
        errors(state, 0.01 * k)
    return errors.greatest


def test_the_error_of_an_offset_is_its_height_over_the_noise():
    height = error_of("yaw_rate", "offset", lambda t_s: 0.1 * t_s, by=-0.03)
    assert height == pytest.approx(0.03 / NOISE.yaw_rate_noise_radps)


def test_the_error_of_a_sign_is_twice_the_root_mean_square_of_the_signal_in_its_greatest_second():
    amplitude = 0.004
    found = error_of(
        "yaw_rate", "sign", lambda t_s: amplitude * (t_s >= 2.0) * math.sin(2.0 * math.pi * 3 * t_s)
    )
    assert found == pytest.approx(2.0 * amplitude / math.sqrt(2.0) / NOISE.yaw_rate_noise_radps, rel=0.02)


def test_a_sensor_without_a_signal_that_is_swapped_or_has_the_wrong_sign_shows_no_error():
    assert error_of("yaw_rate", "sign", lambda t_s: 0.0) == 0.0
    assert error_of("wheel_angle", "swapped", lambda t_s: 0.0, other="yaw_rate") == 0.0


def test_an_absent_value_is_observable_and_an_error_below_the_noise_is_not():
    assert error_of("yaw_rate", "absent", lambda t_s: 0.0) is None
    assert [is_observable({"error_of_noise": error}) for error in (None, 0.0, 0.99, 1.01)] == [
        *(True, False, False, True)
    ]


def row(error, named_s, departures=0):
    task = MeasuredDrive("can", "yaw_rate", "sign", "straight", 5.0, 1)
    scores = dict(lateral_error_m=0.1, departures=departures, error_of_noise=error, named_s=named_s)
    return {**task._asdict(), **scores, "caused_s": None, "last_mps": 5.0}


def test_what_cannot_be_observed_is_counted_apart_and_its_departures_are_counted_all_the_same():
    found = summary([row(3.0, 0.5), row(2.0, None), row(0.5, None, departures=1), row(None, 0.1)])
    counts = found["all"]["all"]
    assert (counts["drives"], counts["observable"], counts["with a wheel outside"]) == (4, 3, 1)
    assert counts["named [%]"] == pytest.approx(66.7)
    assert found["all"]["not observable: error < noise"]["drives"] == 1
    assert found["not named"] == ["can: yaw_rate sign, straight, 5 m/s"]


def test_a_yaw_rate_with_an_offset_is_named_at_once_and_the_car_stays_in_its_lane():
    found = driven_row(MeasuredDrive("can", "yaw_rate", "offset", "straight", 15.0, 1))
    assert (found["departures"], found["named_s"]) == (0, 0.0)
    assert found["error_of_noise"] == pytest.approx(0.15 / NOISE.yaw_rate_noise_radps, rel=0.01)
