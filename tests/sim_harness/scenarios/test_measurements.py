"""Faults of the sensors: each form says what it says, and only within its time."""

import pytest
from pydantic import ValidationError

from sim_harness.scenarios.faults import Sensors, WrongMeasurement
from trepid.messages import VehicleState


def state(k):
    return VehicleState(
        t_s=0.1 * k,
        speed_mps=5.0 + k,
        road_wheel_angle_rad=0.01 * k,
        yaw_rate_radps=0.1 * k,
        driver_override=False,
    )


def report_states(form, quantity="speed", **others):
    """Speeds, wheel angles and yaw rates from 0 to 0.9 s under a fault from 0.35 to 0.75 s."""
    fault = WrongMeasurement(
        kind="wrong_measurement", quantity=quantity, form=form, from_s=0.35, to_s=0.75, **others
    )
    sensors = Sensors([fault, object()])
    return [sensors.step(state(k), elapsed_s=0.1 * k) for k in range(10)]


@pytest.mark.parametrize(
    ("form", "others", "expected"),
    [
        ("stuck", {}, [9.0, 9.0, 9.0, 9.0]),
        ("offset", {"by": 2.0}, [11.0, 12.0, 13.0, 14.0]),
        ("sign", {}, [-9.0, -10.0, -11.0, -12.0]),
        ("factor", {"by": 3.6}, [32.4, 36.0, 39.6, 43.2]),
        ("swapped", {"other": "yaw_rate"}, [0.4, 0.5, 0.6, 0.7]),
    ],
)
def test_each_form_changes_the_value_in_its_time_and_not_outside(form, others, expected):
    speeds = [one.speed_mps for one in report_states(form, **others)]
    assert speeds[4:8] == pytest.approx(expected)
    assert speeds[:4] + speeds[8:] == [5.0, 6.0, 7.0, 8.0, 13.0, 14.0]


def test_an_absent_quantity_is_named():
    states = report_states("absent", "yaw_rate")
    assert [one.yaw_rate_radps is None for one in states] == [False] * 4 + [True] * 4 + [False] * 2
    assert states[5].doubted == ("yaw_rate_radps",)


@pytest.mark.parametrize(
    ("form", "others"),
    [("offset", {}), ("sign", {"by": 1.0}), ("swapped", {}), ("swapped", {"other": "speed"})],
)
def test_a_form_without_what_it_needs_is_refused(form, others):
    with pytest.raises(ValidationError):
        report_states(form, **others)
