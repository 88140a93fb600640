"""The calibration of an RC car."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError
from rc_rig import STEERING, THROTTLE

from vehicle.actuators.rc.pulses import Steering, Throttle

MIRRORED = STEERING | {"left_us": 1100.0, "right_us": 1850.0, "right_rad": 0.4}


@pytest.mark.parametrize("values", [STEERING, MIRRORED])
def test_centre_and_ends_are_met_and_the_sign_is_that_of_the_ends(values) -> None:
    steering = Steering(**values)
    assert steering.pulse_us(0.0) == values["centre_us"]
    assert steering.pulse_us(values["left_rad"]) == values["left_us"]
    assert steering.pulse_us(-values["right_rad"]) == values["right_us"]


@given(st.floats(-0.45, 0.4))
def test_the_angle_of_a_pulse_is_the_angle_that_asked_for_it(angle_rad) -> None:
    steering = Steering(**(MIRRORED | {"right_rad": 0.45}))
    assert steering.angle_rad(steering.pulse_us(angle_rad)) == pytest.approx(angle_rad, abs=1e-9)


@given(st.floats(allow_nan=False))
def test_no_angle_and_no_speed_gives_a_pulse_beyond_the_hard_ends(value) -> None:
    steering, throttle = Steering(**STEERING), Throttle(**THROTTLE)
    assert steering.least_us <= steering.pulse_us(value) <= steering.most_us
    assert throttle.neutral_us <= throttle.pulse_us(value) <= throttle.most_us


def test_no_speed_is_exactly_neutral_and_the_least_speed_leaves_the_dead_band() -> None:
    throttle = Throttle(**THROTTLE)
    assert throttle.pulse_us(0.0) == throttle.neutral_us
    assert throttle.pulse_us(1e-9) == pytest.approx(1530.0)
    assert throttle.pulse_us(0.5) == pytest.approx(1550.0)


def test_a_reversed_throttle_drives_below_neutral() -> None:
    throttle = Throttle(**(THROTTLE | {"speeds": [[1.0, 1450.0]]}))
    assert throttle.pulse_us(0.5) == 1475.0
    assert throttle.speed_mps(1475.0) == 0.5
    assert throttle.speed_mps(1600.0) == 0.0


@pytest.mark.parametrize(
    "model, values, field",
    [
        (Steering, STEERING | {"centre_us": 1950.0}, "centre_us"),
        (Steering, STEERING | {"left_us": 2100.0}, "left_us"),
        (Steering, STEERING | {"left_rad": math.nan}, "left_rad"),
        (Throttle, THROTTLE | {"speeds": [[1.0, 1570.0], [2.0, 1560.0]]}, "speeds"),
        (Throttle, THROTTLE | {"speeds": [[2.0, 1570.0], [1.0, 1580.0]]}, "speeds"),
        (Throttle, THROTTLE | {"speeds": [[1.0, 1720.0]]}, "speeds"),
        (Throttle, THROTTLE | {"speeds": [[0.0, 1520.0]]}, "speeds"),
        (Throttle, THROTTLE | {"speeds": []}, "speeds"),
        (Throttle, THROTTLE | {"brake_us": 1600.0}, "brake_us"),  # full drive instead of the brake
        (Throttle, THROTTLE | {"speeds": [[1.0, 1450.0]], "brake_us": 1420.0}, "brake_us"),
    ],
)
def test_a_calibration_that_contradicts_itself_is_refused(model, values, field) -> None:
    with pytest.raises(ValidationError) as refused:
        model(**values)
    error = refused.value.errors()[0]
    assert field in (*error["loc"], *error.get("ctx", {}).get("path", ()))
