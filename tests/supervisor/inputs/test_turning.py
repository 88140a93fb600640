"""A turn beyond that of the wheels is measured; what follows the wheels late, or turns less than they, is none."""

import math

import pytest

from supervisor.inputs.turning import SMOOTH_S, TurnExcess
from supervisor.rules.inference import FearRules
from supervisor.rules.proofs import calmest
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Motion
from trepid.config import CONFIG_DIR, load
from trepid.messages import VehicleState

CAR = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
RULES = FearRules.load(CONFIG_DIR / "fear.yaml")
STEP_S = 0.04


def steady_radps(wheel_rad, speed_mps):
    return (
        speed_mps
        * math.tan(wheel_rad)
        / (CAR.wheelbase_m + CAR.understeer_gradient_rad_per_mps2 * speed_mps**2)
    )


def excess_mps2(yaw_of, *, wheel_rad=0.02, speed_mps=20.0, seconds=10 * SMOOTH_S):
    """After ``seconds`` with the yaw rate ``yaw_of(t)``; None: not measured."""
    watch = TurnExcess(CAR)
    for step in range(round(seconds / STEP_S)):
        now_s = step * STEP_S
        yaw_radps = yaw_of(now_s)
        state = VehicleState(
            t_s=now_s,
            speed_mps=speed_mps,
            road_wheel_angle_rad=wheel_rad,
            yaw_rate_radps=yaw_radps,
            driver_override=False,
        )
        found = watch.step(state, Motion(speed_mps, yaw_radps or 0.0), now_s=now_s)
    return found


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_an_offset_that_adds_to_the_turn_is_found_as_lateral_acceleration(side):
    turn = side * steady_radps(0.02, 20.0)
    found = excess_mps2(lambda _: turn + side * 0.05, wheel_rad=side * 0.02)
    assert found == pytest.approx(20.0 * 0.05, rel=1e-3)


def test_a_car_that_turns_as_its_wheels_or_less_has_no_excess():
    turn = steady_radps(0.02, 20.0)
    assert excess_mps2(lambda _: turn) == pytest.approx(0.0, abs=1e-9)
    assert excess_mps2(lambda _: 0.5 * turn) == 0.0


def test_a_turn_that_comes_and_goes_faster_than_the_mean_counts_for_less_than_an_offset():
    turn = steady_radps(0.02, 20.0)
    swinging = excess_mps2(lambda t: turn + 0.05 * math.sin(2 * math.pi * 2.0 * t))
    assert swinging < 0.3 * excess_mps2(lambda _: turn + 0.05)


def test_a_yaw_rate_that_is_not_measured_is_no_excess_and_ends_the_former_one():
    turn = steady_radps(0.02, 20.0)
    assert excess_mps2(lambda t: turn + 0.05 if t < 4.5 else None) == 0.0


def test_a_cut_demand_is_doubted_where_the_yaw_rate_takes_it_and_saturated_elsewhere():
    cut = calmest(RULES) | {"saturated": 2.0, "speed": 20.0}
    assert RULES.evaluate(cut).cause == "saturated"
    assert RULES.evaluate(cut | {"turn_excess": 1.0}).cause == "doubted_state"
    assert RULES.evaluate(cut | {"turn_excess": 1.0}).fear == RULES.evaluate(cut).fear
