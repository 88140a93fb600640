"""A doubted speed or wheel angle costs the drive and not the steering."""

from dataclasses import replace

import pytest

from controller.limiter import Limits, build
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


def test_without_a_wheel_angle_no_driver_is_found_and_a_deviation_counts_from_its_return():
    limiter, _ = drive_limiter(DOUBTS["wheel angle"])
    found = []
    for k in range(100, 200):
        now_s = 0.01 * k
        seen = replace(MEASURED, t_s=now_s, road_wheel_angle_rad=0.4)
        order = Command(t_s=now_s, road_wheel_angle_rad=0.0, speed_mps=5.0, accel_mps2=0.0)
        limiter.step(order, now_s, seen, now_s=now_s)
        found.append(limiter.handed_over)
    after_s = load(CONFIG_DIR / "limiter.yaml", Limits).override.angle_after_s
    assert found.index(True) == pytest.approx(after_s / 0.01, abs=1)


def test_under_a_driver_without_a_wheel_angle_the_last_output_is_held():
    limiter, outputs = drive_limiter(DOUBTS["wheel angle"] | dict(driver_override=True))
    assert limiter.handed_over
    assert outputs[-1].road_wheel_angle_rad == outputs[10].road_wheel_angle_rad > 0.0


def test_without_a_speed_the_steering_is_that_of_the_last_one():
    """At the last speed 5 m/s a demand of 0.5 rad is cut to the limit of lateral acceleration."""
    _, outputs = drive_limiter(DOUBTS["speed"], duration_s=3.0, wanted_rad=0.5)
    _, measured = drive_limiter({}, duration_s=3.0, wanted_rad=0.5)
    assert outputs[-1].road_wheel_angle_rad == pytest.approx(measured[-1].road_wheel_angle_rad, rel=0.1)
