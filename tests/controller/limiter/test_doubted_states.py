"""A doubted speed or wheel angle costs the drive and not the steering."""

from dataclasses import replace

import pytest

from controller.limiter import build
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, VehicleState

CAR = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
MEASURED = VehicleState(
    t_s=0.0, speed_mps=5.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
)
DOUBTS = {
    "speed": dict(speed_mps=None, doubted=("speed_mps",)),
    "wheel angle": dict(road_wheel_angle_rad=None, doubted=("road_wheel_angle_rad",)),
    "both": dict(speed_mps=None, road_wheel_angle_rad=None, doubted=("road_wheel_angle_rad", "speed_mps")),
}


def drive_limiter(changes, *, measured_s=0.1, duration_s=1.0, wanted_rad=0.05):
    """Outputs of the limiter under a demand to steer and to accelerate; the state changes at ``measured_s``."""
    limiter, outputs = build(CAR), []
    for k in range(round(duration_s / 0.01)):
        now_s = 0.01 * k
        seen = replace(MEASURED, t_s=now_s, **(changes if now_s >= measured_s else {}))
        order = Command(t_s=now_s, road_wheel_angle_rad=wanted_rad, speed_mps=6.0, accel_mps2=1.0)
        outputs.append(limiter.step(order, now_s, seen, now_s=now_s))
    return limiter, outputs


@pytest.mark.parametrize("name", DOUBTS)
def test_commands_go_on_steering_and_the_car_brakes(name):
    limiter, outputs = drive_limiter(DOUBTS[name])
    assert outputs[-1].road_wheel_angle_rad == pytest.approx(0.05)
    assert all(output.accel_mps2 <= -1.0 for output in outputs[10:])
    assert not limiter.handed_over


@pytest.mark.parametrize("name", ["speed", "both"])
def test_without_a_speed_the_stop_follows(name):
    limiter, outputs = drive_limiter(DOUBTS[name])
    assert limiter.stopping
    assert outputs[-1].accel_mps2 == pytest.approx(-3.5)


@pytest.mark.parametrize("name", DOUBTS)
def test_a_car_whose_wheels_were_never_seen_is_not_steered(name):
    limiter, _ = drive_limiter(DOUBTS[name], measured_s=0.0)
    assert not limiter.has_seen_wheel
