"""The drift of the rear axle and the lag of the tyres, against closed forms."""

import math

import numpy as np
import pytest
from controller_rig import SETTINGS
from hypothesis import given
from hypothesis import strategies as st
from message_rig import SHUTTLE, state, vehicle

from controller.model.tyres import Turning, Tyres
from controller.prediction import Predictor
from trepid.clothoid import Lane

REAR = 0.0051  # 20 per rad and weight
CAR = vehicle(rear_slip_gradient_rad_per_mps2=REAR, steering_delay_s=0.0, steering_lag_s=0.0)
DELAY_S = SETTINGS.lateral.command_delay_s


def settle(tyres, wheel_rad, speed_mps, seconds=3.0, steps=300):
    turning = Turning(0.0, 0.0)
    for _ in range(steps):
        turning = tyres.after(turning, wheel_rad, wheel_rad, speed_mps, seconds / steps)
    return turning


@pytest.mark.parametrize("speed_mps", [0.3, 1.0, 5.0, 20.0, 30.0])
@pytest.mark.parametrize("wheel_rad", [0.002, -0.03])
def test_the_tyres_settle_on_the_steady_turn_with_the_drift_of_the_rear_axle(speed_mps, wheel_rad):
    tyres = Tyres(CAR)
    turning = settle(tyres, wheel_rad, speed_mps)
    steady_1pm = tyres.steady_1pm(wheel_rad, speed_mps)
    assert turning.yaw_1pm == pytest.approx(steady_1pm, rel=2e-3)
    assert turning.drift_rad == pytest.approx(-REAR * speed_mps**2 * steady_1pm, rel=2e-3)
    assert tyres.path_1pm(turning, speed_mps) == pytest.approx(steady_1pm, rel=2e-3)


def test_without_a_known_slip_there_is_no_drift_and_no_lag():
    tyres = Tyres(SHUTTLE.model_copy(update=dict(rear_slip_gradient_rad_per_mps2=0.0)))
    assert tyres.lag_s(20.0) == 0.0
    assert tyres.after(Turning(0.3, 0.0), 0.0, 0.01, 20.0, 0.01) == (tyres.steady_1pm(0.01, 20.0), 0.0)


@given(st.floats(-0.3, 0.3), st.floats(-0.2, 0.2), st.floats(-0.1, 0.1), st.floats(0.0, 40.0))
def test_the_tyres_are_mirror_symmetric(wheel_rad, yaw_1pm, drift_rad, speed_mps):
    tyres = Tyres(CAR)
    left = tyres.after(Turning(yaw_1pm, drift_rad), wheel_rad, wheel_rad, speed_mps, 0.02)
    right = tyres.after(Turning(-yaw_1pm, -drift_rad), -wheel_rad, -wheel_rad, speed_mps, 0.02)
    assert (left.yaw_1pm, left.drift_rad) == (-right.yaw_1pm, -right.drift_rad)


def test_the_prediction_moves_along_the_course():
    """On a circle the rear axle keeps its distance from the lane though the nose points inside."""
    speed_mps, bend_1pm = 10.0, 0.02
    ahead = Predictor(CAR, command_delay_s=DELAY_S, memory_s=1.0)
    drift_rad = -REAR * speed_mps**2 * bend_1pm
    for n in range(30):
        t_s = 0.01 * n
        wheel_rad = math.atan(CAR.wheelbase_m * bend_1pm)
        wheel_rad += CAR.understeer_gradient_rad_per_mps2 * speed_mps**2 * bend_1pm
        measured = state(
            t_s, speed_mps=speed_mps, road_wheel_angle_rad=wheel_rad, yaw_rate_radps=speed_mps * bend_1pm
        )
        ahead.add_state(measured, speed_mps)
        ahead.add_command(wheel_rad, now_s=t_s)
    lane, valid_s = ahead.at_last_state(Lane(0.0, -drift_rad, bend_1pm, 0.0, 20.0), valid_s=0.0)
    assert lane.offset_m == pytest.approx(0.0, abs=1e-4)
    acting = ahead.when_steering_acts(lane, valid_s=valid_s, now_s=0.29)
    assert acting.lane.heading_rad == pytest.approx(0.0, abs=1e-4)
    assert acting.curvature_1pm == pytest.approx(bend_1pm, rel=0.01)
    assert acting.steady_1pm == pytest.approx(bend_1pm, rel=1e-6)


def test_the_lag_peaks_where_understeer_takes_over():
    """T = L·(F + R)·v/(L + K·v²) is largest at the characteristic speed √(L/K)."""
    tyres, speeds = Tyres(CAR), np.linspace(1.0, 60.0, 600)
    peak = speeds[np.argmax([tyres.lag_s(v) for v in speeds])]
    assert peak == pytest.approx(math.sqrt(CAR.wheelbase_m / CAR.understeer_gradient_rad_per_mps2), abs=0.2)
