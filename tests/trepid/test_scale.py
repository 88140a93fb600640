"""The power of the metre in a unit, and the change of messages and settings between worlds of two sizes."""

import math
from pathlib import Path

import pytest
from message_rig import estimate
from ruamel.yaml import YAML

from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CAR, CONFIG_DIR, load, use_car
from trepid.messages import Command, VehicleState
from trepid.scale import REFERENCE_LANE_M, power_of_metre, scale_data, scaled_message, scaled_settings

ESTIMATE = estimate(
    lateral_offset_m=0.4,
    heading_error_rad=0.1,
    curvature_1pm=0.05,
    curvature_rate_1pm2=0.01,
    road_wheel_angle_rad=0.2,
    lane_width_m=None,
    left_boundary_px=((1.0, 2.0),),
    ahead_sigma_m=(0.1, 0.2),
)


@pytest.mark.parametrize(
    ("name", "power"),
    [
        ("lateral_offset_m", 1),
        ("speed_mps", 1),
        ("jerk_mps3", 1),
        ("curvature_1pm", -1),
        ("curvature_rate_1pm2", -2),
        ("bandwidth_radpm", -1),
        ("understeer_gradient_rad_per_mps2", -1),
        ("offset_noise_m_per_sqrt_m", 0.5),
        ("curvature_rate_noise_1pm2_per_sqrt_m", -2.5),
        ("offset_noise_m_per_sqrt_s", 1),
        ("heading_error_rad", 0),
        ("yaw_rate_radps", 0),
        ("gain_1ps", 0),
        ("left_boundary_px", 0),
        ("vehicles_per_100m", 0),
        ("trust", 0),
    ],
)
def test_the_unit_at_the_end_of_a_name_gives_the_power_of_the_metre(name: str, power: float) -> None:
    assert power_of_metre(name) == power


def test_a_scale_of_one_returns_the_message_itself() -> None:
    assert scaled_message(ESTIMATE, 1.0) is ESTIMATE


def test_lengths_and_curvatures_of_a_message_change_and_angles_pixels_and_absence_stay() -> None:
    small = scaled_message(ESTIMATE, 0.5)
    assert (small.lateral_offset_m, small.lookahead_m) == (0.2, 4.0)
    assert (small.curvature_1pm, small.curvature_rate_1pm2) == (0.1, 0.04)
    assert (small.heading_error_rad, small.road_wheel_angle_rad) == (0.1, 0.2)
    assert small.lane_width_m is None
    assert small.left_boundary_px == ((1.0, 2.0),)
    assert small.ahead_sigma_m == (0.05, 0.1)


def test_speed_and_acceleration_of_a_command_change_and_its_wheel_angle_stays() -> None:
    command = Command(t_s=0.0, road_wheel_angle_rad=0.1, speed_mps=8.0, accel_mps2=-1.0)
    small = scaled_message(command, 0.25)
    assert (small.speed_mps, small.accel_mps2, small.road_wheel_angle_rad) == (2.0, -0.25, 0.1)


def test_an_unknown_speed_stays_unknown() -> None:
    state = VehicleState(
        t_s=0.0, speed_mps=None, road_wheel_angle_rad=None, yaw_rate_radps=None, driver_override=False
    )
    assert scaled_message(state, 3.0).speed_mps is None


def test_a_camera_sees_the_same_pixel_of_a_world_of_another_size() -> None:
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    small = scaled_settings(camera, 0.15)
    assert small.pixel_from_road([(0.15 * 6.0, 0.15 * 1.0)]) == pytest.approx(
        camera.pixel_from_road([(6.0, 1.0)])
    )


def test_the_understeer_of_a_vehicle_is_the_same_angle_in_the_reference_world() -> None:
    """K_us·a, an angle, is the same for accelerations a in either world."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle).model_copy(update={"lane_width_m": 0.5})
    large = vehicle.in_reference_world
    ratio = REFERENCE_LANE_M / 0.5
    assert large.wheelbase_m == pytest.approx(vehicle.wheelbase_m * ratio)
    assert large.understeer_gradient_rad_per_mps2 * ratio == pytest.approx(
        vehicle.understeer_gradient_rad_per_mps2
    )
    assert large.scale == pytest.approx(1.0)


def test_the_default_vehicle_has_a_scale_of_exactly_one() -> None:
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    assert vehicle.scale == 1.0
    assert vehicle.in_reference_world is vehicle


def test_a_car_states_settings_in_its_own_metres(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``perception.yaml`` holds in the reference world: the width of the car's tape is enlarged to it."""
    monkeypatch.setenv(CAR, "")
    (tmp_path / "vehicle.yaml").write_text("lane_width_m: 0.33\n")
    (tmp_path / "perception.yaml").write_text("markings: {width_m: 0.02, sigma_px: 0.5}\n")
    default = load(CONFIG_DIR / "perception.yaml", LaneCvSettings)
    use_car(tmp_path)
    settings = load(CONFIG_DIR / "perception.yaml", LaneCvSettings)
    assert math.isclose(settings.markings.width_m, 0.2)
    assert settings.markings.sigma_px == 0.5
    assert settings.markings.half_range_m == default.markings.half_range_m


def test_the_limits_of_a_car_are_those_of_its_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``camera.yaml`` describes the car itself and is not scaled."""
    monkeypatch.setenv(CAR, "")
    (tmp_path / "vehicle.yaml").write_text("lane_width_m: 0.33\n")
    (tmp_path / "camera.yaml").write_text("height_m: 0.1\n")
    use_car(tmp_path)
    assert load(CONFIG_DIR / "camera.yaml", Camera).height_m == 0.1


def test_what_an_alias_names_again_is_scaled_once() -> None:
    data = YAML().load(
        "a: &a {gap_m: 1.0, speeds_mps: &s [1.0, 2.0]}\nb: *a\nspeeds_mps: *s\nc: {gap_m: 3.0}\n"
    )
    scale_data(data, 2.0)
    assert data["a"] == data["b"] == {"gap_m": 2.0, "speeds_mps": [2.0, 4.0]}
    assert data["speeds_mps"] == [2.0, 4.0] and data["c"] == {"gap_m": 6.0}
