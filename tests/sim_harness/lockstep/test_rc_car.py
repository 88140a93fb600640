"""A car of another scale: the same drive in a smaller world, and refusals where a part does not fit it."""

import os
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import controller.controller
import perception.estimators
import supervisor.supervisor
from controller.controller import ControllerSettings
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CAR, CONFIG_DIR, InputError, load, use_car
from trepid.messages import Frame, VehicleState
from trepid.scale import scaled_settings


@pytest.fixture
def rc_car() -> Iterator[None]:
    before = os.environ.get(CAR)
    use_car(CONFIG_DIR / "cars" / "rc-car")
    yield
    os.environ.pop(CAR, None)
    if before is not None:
        os.environ[CAR] = before


@pytest.mark.suite
@pytest.mark.usefixtures("rc_car")
def test_the_rc_car_drives_the_first_bend_of_its_track_without_departure() -> None:
    scenario = load_scenario("circuit")
    result = run(scenario.shorten(14.0), seed=0)
    assert result.metrics.departures == 0
    assert result.metrics.distance_m > 3.0
    assert result.metrics.max_lateral_error_m < 0.08
    assert 1.5 < result.metrics.max_lateral_accel_mps2 < 3.0  # of its own world: gravity does not scale


@pytest.mark.suite
@pytest.mark.usefixtures("rc_car")
def test_the_rc_car_reaches_three_metres_a_second_in_the_hall() -> None:
    result = run(load_scenario("hall").shorten(12.0), seed=0)
    assert result.metrics.departures == 0
    assert float(np.max(result.trace["speed_mps"])) > 2.9
    assert result.metrics.max_lateral_error_m < 0.05


@pytest.mark.usefixtures("rc_car")
def test_the_rc_car_stops_within_metres_of_its_own_world() -> None:
    """1 m/s² of comfort from 3 m/s is a stop of 3 s; a similar road car at 20 m/s would take 20 s."""
    assert load(CONFIG_DIR / "controller.yaml", ControllerSettings).speed.comfort.decel_mps2 == pytest.approx(
        6.6
    )
    command = controller.controller.build()
    start = VehicleState(
        t_s=0.0, speed_mps=3.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )
    for number in range(50):
        given = command.step(None, replace(start, t_s=0.02 * number), now_s=0.02 * number)
    assert given.accel_mps2 == pytest.approx(-1.0, abs=0.05)


@pytest.mark.usefixtures("rc_car")
def test_a_stop_harder_than_four_metres_per_second_squared_is_refused_at_its_place(tmp_path) -> None:
    folder = tmp_path / "car"
    shutil.copytree(CONFIG_DIR / "cars" / "rc-car", folder)
    file = folder / "controller.yaml"
    file.write_text(file.read_text().replace("emergency: {decel_mps2: 3.0", "emergency: {decel_mps2: 5.0"))
    use_car(folder)
    with pytest.raises(InputError, match=r"controller\.yaml:\d+:\d+: .*5 m/s² is above 4"):
        controller.controller.build()


@pytest.fixture
def low_rc_car(rc_car: None, tmp_path: Path) -> None:
    """The RC car with its camera 8 cm above the floor: its lanes look like one of 9 m, which no road has."""
    folder = tmp_path / "low"
    shutil.copytree(CONFIG_DIR / "cars" / "rc-car", folder)
    file = folder / "camera.yaml"
    file.write_text(file.read_text().replace("height_m: 0.10", "height_m: 0.08"))
    use_car(folder)


@pytest.mark.usefixtures("low_rc_car")
def test_the_network_of_public_roads_is_refused_where_no_lane_of_its_training_looks_like_those_of_the_car() -> (
    None
):
    assert list(perception.estimators.misfits()) == ["cnn"]
    with pytest.raises(InputError, match=r"of 0\.5 m seen from 0\.08 m look like 9\.06 m .* to 7\.5 m"):
        perception.estimators.build("cnn")


@pytest.mark.usefixtures("low_rc_car")
def test_a_scenario_with_the_network_ends_in_one_line_and_exit_code_2(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from trepid.cli import main

    monkeypatch.setattr("sys.argv", ["trepid", "sim", "run", "straight"])
    assert main() == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.usefixtures("rc_car")
def test_other_vehicles_are_refused_on_the_track() -> None:
    with pytest.raises(InputError, match="other vehicles are those of public roads"):
        load_scenario("circuit", {"traffic": "[{gap_m: 1}]"})


def test_equal_images_give_equal_lanes_up_to_the_scale() -> None:
    """The estimator measures a road of half the size, from half the height, as half the offset."""
    vehicle, camera = load(CONFIG_DIR / "vehicle.yaml", Vehicle), load(CONFIG_DIR / "camera.yaml", Camera)
    half = scaled_settings(vehicle, 0.5)
    entry = perception.estimators.entry_of("cv")
    large = entry.build(camera, vehicle)
    small = entry.build(scaled_settings(camera, 0.5), half)
    road = load_road("straight")
    renderer = Renderer(road, camera, seed=0)
    for number in range(5):
        t_s = 0.04 * number
        frame = Frame(t_s=t_s, image=renderer.render(10.0 + 8 * t_s, 0.3, 0.0, t_s=t_s))
        seen = large.step(frame, _state(t_s, 8.0), now_s=t_s)
        half_seen = small.step(frame, _state(t_s, 4.0), now_s=t_s)
    assert seen.lateral_offset_m is not None
    assert half_seen.lateral_offset_m == pytest.approx(seen.lateral_offset_m / 2, rel=1e-6)
    assert half_seen.road_wheel_angle_rad == pytest.approx(seen.road_wheel_angle_rad, rel=1e-6)
    assert half_seen.confidence == pytest.approx(seen.confidence, rel=1e-6)


def test_a_model_road_is_drawn_as_the_road_that_is_larger_by_its_scale() -> None:
    """A camera sees the same picture of a track and of the road enlarged from it."""
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    large = load_road("circuit")  # lanes of 3.3 m
    track = type(large)(scaled_settings(large.settings, 0.25, given_only=True))
    assert track.settings.scale == pytest.approx(0.25)
    there = Renderer(large, camera, seed=0).render(10.0, 0.3, 0.0, t_s=0.0, station_m=10.0)
    here = Renderer(track, scaled_settings(camera, 0.25), seed=0).render(
        2.5, 0.075, 0.0, t_s=0.0, station_m=2.5
    )
    assert np.mean(np.abs(here.astype(int) - there.astype(int))) < 1.0


@pytest.mark.parametrize("car", [None, "shuttle", "rc-car", "duckiebot", "mini"])
@pytest.mark.usefixtures("rc_car")
def test_every_estimator_fits_the_cars_that_are_ready_whose_lanes_look_like_those_of_roads(
    car: str | None,
) -> None:
    os.environ.pop(CAR)
    if car is not None:
        use_car(CONFIG_DIR / "cars" / car)
    assert perception.estimators.misfits() == {}


def test_the_default_car_has_the_plain_supervisor_and_controller() -> None:
    assert type(supervisor.supervisor.build()) is supervisor.supervisor.Supervisor
    assert type(controller.controller.build()) is controller.controller.Controller


@pytest.mark.usefixtures("rc_car")
def test_the_set_speed_is_in_metres_of_the_car() -> None:
    scenario = Scenario.model_validate(
        load_scenario("circuit").model_dump() | {"sight": "truth", "speed_mps": 0.4, "duration_s": 10.0}
    )
    result = run(scenario, seed=0)
    assert 0.35 < float(np.max(result.trace["speed_mps"])) < 0.45


def _state(t_s: float, speed_mps: float) -> VehicleState:
    return VehicleState(
        t_s=t_s, speed_mps=speed_mps, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )
