"""From sticks to the driver's demand."""

import pytest
from vehicle_driver_rig import SETTINGS

from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from vehicle.driver.node import Driver
from vehicle.driver.sticks import Sticks

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
HELD = Sticks(dead_man=True)


@pytest.fixture
def driver() -> Driver:
    """A driver whose dead man's switch has been seen released."""
    made = Driver(SETTINGS, VEHICLE)
    made.step(Sticks(), 1.0, now_s=0.0)
    return made


def test_driving_is_allowed_only_while_the_dead_mans_switch_is_held(driver) -> None:
    assert driver.step(HELD, 1.0, now_s=0.1).allowed
    assert not driver.step(Sticks(), 1.0, now_s=0.2).allowed


def test_a_switch_that_was_never_seen_released_allows_nothing() -> None:
    driver = Driver(SETTINGS, VEHICLE)
    assert not driver.step(HELD, 1.0, now_s=0.0).allowed
    driver.step(Sticks(), 1.0, now_s=0.1)
    assert driver.step(HELD, 1.0, now_s=0.2).allowed


def test_a_device_that_is_gone_allows_nothing_until_the_switch_is_released_again(driver) -> None:
    gone = driver.step(None, 1.0, now_s=0.1)
    assert not gone.connected
    assert not gone.allowed
    assert not driver.step(HELD, 1.0, now_s=0.2).allowed


def test_a_stop_lasts_until_the_switch_is_released(driver) -> None:
    assert not driver.step(HELD._replace(stop=True), 1.0, now_s=0.1).allowed
    assert not driver.step(HELD, 1.0, now_s=0.2).allowed
    driver.step(Sticks(), 1.0, now_s=0.3)
    assert driver.step(HELD, 1.0, now_s=0.4).allowed


def test_a_stick_beyond_its_threshold_overrides_until_it_was_centred_for_the_release_time(driver) -> None:
    assert not driver.step(HELD._replace(steering=SETTINGS.override_above), 1.0, now_s=0.1).override
    taken = driver.step(HELD._replace(steering=0.5), 1.0, now_s=0.2)
    assert taken.override
    assert taken.road_wheel_angle_rad == pytest.approx(0.5 * VEHICLE.max_road_wheel_angle_rad)
    assert driver.step(HELD, 1.0, now_s=0.2 + SETTINGS.release_s - 0.01).override
    assert not driver.step(HELD, 1.0, now_s=0.2 + SETTINGS.release_s).override


@pytest.mark.parametrize("steering", [0.0, 0.1])
def test_the_throttle_alone_leaves_the_steering_to_the_controller(driver, steering) -> None:
    taken = driver.step(HELD._replace(throttle=-0.5, steering=steering), 1.0, now_s=0.1)
    assert taken.override
    assert taken.road_wheel_angle_rad is None
    assert taken.accel_mps2 == -0.5 * SETTINGS.brake_mps2


def test_a_steering_stick_steers_until_it_was_centred_for_the_release_time(driver) -> None:
    braking = HELD._replace(throttle=-0.5)
    driver.step(braking._replace(steering=0.5), 1.0, now_s=0.1)
    still = driver.step(braking, 1.0, now_s=0.1 + SETTINGS.release_s - 0.01)
    assert still.road_wheel_angle_rad == 0.0
    assert driver.step(braking, 1.0, now_s=0.1 + SETTINGS.release_s).road_wheel_angle_rad is None


def test_a_released_switch_ends_an_override_of_the_steering(driver) -> None:
    driver.step(HELD._replace(steering=0.5), 1.0, now_s=0.1)
    driver.step(Sticks(), 1.0, now_s=0.2)
    assert driver.step(HELD._replace(throttle=-0.5), 1.0, now_s=0.3).road_wheel_angle_rad is None


def test_by_hand_a_centred_steering_stick_drives_straight_on(driver) -> None:
    taken = driver.step(HELD._replace(hand=True, throttle=0.5), 1.0, now_s=0.1)
    assert taken.road_wheel_angle_rad == 0.0


def test_steering_alone_holds_the_speed(driver) -> None:
    taken = driver.step(HELD._replace(steering=0.5), 1.3, now_s=0.1)
    assert (taken.accel_mps2, taken.speed_mps) == (0.0, 1.3)


def test_by_hand_a_centred_throttle_brakes_to_standstill(driver) -> None:
    driver.step(HELD._replace(hand=True), 1.0, now_s=0.1)
    taken = driver.step(HELD, 1.0, now_s=0.2)
    assert taken.override
    assert taken.speed_mps == 0.0
    assert taken.accel_mps2 == pytest.approx(-2.0)


def test_a_second_press_of_the_hand_button_returns_the_car_to_the_controller(driver) -> None:
    for now_s, pressed in enumerate((True, True, False, True, False)):
        last = driver.step(HELD._replace(hand=pressed), 1.0, now_s=float(now_s))
    assert not last.override


def test_the_throttle_demands_a_speed_within_the_bounds_of_acceleration(driver) -> None:
    assert driver.step(HELD._replace(throttle=1.0), 0.0, now_s=0.1).accel_mps2 == SETTINGS.accel_mps2
    assert driver.step(HELD._replace(throttle=1.0), 2.0, now_s=0.2).accel_mps2 == 0.0
    assert driver.step(HELD._replace(throttle=-1.0), 2.0, now_s=0.3).accel_mps2 == -SETTINGS.brake_mps2


def test_an_unknown_speed_brakes(driver) -> None:
    taken = driver.step(HELD._replace(throttle=1.0), None, now_s=0.1)
    assert (taken.accel_mps2, taken.speed_mps) == (-SETTINGS.brake_mps2, 0.0)


def test_the_record_button_toggles(driver) -> None:
    pressed = [True, True, False, True, False]
    wants = [driver.step(Sticks(record=down), 0.0, now_s=float(i)).record for i, down in enumerate(pressed)]
    assert wants == [True, True, True, False, False]
