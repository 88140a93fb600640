"""The sensor of road users: exact places against geometry, lines of sight, and the errors of a detector."""

import math
from dataclasses import replace

import numpy as np
import plant_rig
import pytest
from hypothesis import given
from hypothesis import settings as within
from hypothesis import strategies as st

from sim_harness.lockstep.closed_loop import build_parts, run
from sim_harness.lockstep.contact import Outline, Solid, seen_share
from sim_harness.lockstep.road_user_model import RoadUserModel, build_road_user_model
from sim_harness.lockstep.road_user_sensor import build_road_user_sensor
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.road_users import UserSensor
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.sight_truth import SightDistance
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import RoadUsers

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


def scenario_of(*users, **fields):
    base = dict(description="", tags=["traffic"], road="straight", duration_s=10.0, sight="truth")
    return Scenario.model_validate(base | {"road_users": users, **fields})


def car_in(scenario):
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    return SimulatedVehicle(scenario, scenario.build_road(), vehicle, None, load_simulator(), seed=0)


def sense(*users, kind=UserSensor.TRUTH, **fields):
    return build_road_user_sensor(kind, seed=0).step(car_in(scenario_of(*users, **fields)))


@pytest.mark.parametrize("heading_rad", [0.0, 0.2, -0.2])
def test_a_road_user_is_measured_where_it_stands_in_the_axes_of_the_car(heading_rad):
    seen = sense(
        {"station_m": 30.0, "offset_m": 2.0, "speed_mps": 1.5, "facing_rad": 1.0},
        {"station_m": 45.0, "offset_m": -3.0, "shape": "cyclist", "speed_mps": 4.0},
        {"station_m": 25.0, "offset_m": -1.0, "shape": "deer"},
        start={"station_m": 10.0, "heading_rad": heading_rad},
    )
    assert seen.kinds == ("person", "cyclist", "animal")
    turn = np.exp(-1j * heading_rad)
    places = np.array([20 + 2j, 35 - 3j, 15 - 1j]) * turn
    velocities = np.array([1.5 * np.exp(1j), 4.0, 0.0]) * turn
    assert np.array(seen.x_m) + 1j * np.array(seen.y_m) == pytest.approx(places)
    assert np.array(seen.x_mps) + 1j * np.array(seen.y_mps) == pytest.approx(velocities)


def test_what_is_behind_the_rear_axle_or_out_of_range_is_not_seen_but_the_sensor_speaks():
    range_m = load_simulator().road_user_range_m
    far, near = {"station_m": 100.0 + range_m + 0.1}, {"station_m": 100.0 + range_m - 0.1}
    behind = {"station_m": 99.0, "offset_m": -2.0}
    seen = sense(far, behind, start={"station_m": 100.0})
    assert (seen.kinds, seen.detects) == ((), ("person", "cyclist", "animal"))
    assert sense(near, start={"station_m": 100.0}).kinds == ("person",)


def test_without_road_users_the_sensor_does_not_run():
    assert sense() is None


@pytest.mark.parametrize("cause", ["fog", "dark"])
def test_a_modelled_detector_finds_nobody_beyond_the_sight_in_fog_or_darkness(cause):
    car = car_in(scenario_of({"station_m": 25.0}))

    def finds(kind, sight):
        sensor = build_road_user_sensor(kind, seed=0)
        return [bool(sensor.step(car, sight).kinds) for _ in car_steps(car)]

    assert not any(finds(UserSensor.MODELLED, SightDistance(20.0, cause)))
    assert any(finds(UserSensor.MODELLED, SightDistance(30.0, cause)))
    assert any(finds(UserSensor.MODELLED, SightDistance(20.0, "occluded")))
    assert all(finds(UserSensor.TRUTH, SightDistance(20.0, cause)))


def car_steps(car):
    """One second of a standing car at the rate of the camera."""
    for _ in range(25):
        car.step(plant_rig.command(0.0, 0.0), 0.0, now_s=car.now_s + 0.04)
        yield


def solid(x_m, y_m, yaw_rad=0.0, *, length_m=4.0, width_m=1.8, height_m=1.5):
    return Solid(Outline(x_m, y_m, yaw_rad, -length_m / 2, length_m / 2, width_m), height_m)


def person(x_m, y_m, height_m=1.8):
    return solid(x_m, y_m, length_m=0.5, width_m=0.5, height_m=height_m)


@given(
    x=st.floats(5, 30),
    y=st.floats(-4, 4),
    at=st.floats(0.2, 0.8),
    aside=st.floats(-2, 2),
    yaw=st.floats(-3, 3),
)
@within(max_examples=60, deadline=None)
def test_the_seen_share_is_mirrored_and_never_larger_with_one_more_vehicle(x, y, at, aside, yaw):
    eye = (0.0, 0.0, 1.45)
    car = solid(x * at, y * at + aside, yaw)
    mirrored = solid(x * at, -y * at - aside, -yaw)
    share = seen_share(eye, person(x, y), [car])
    assert share == pytest.approx(seen_share(eye, person(x, -y), [mirrored]), abs=0.2)
    assert seen_share(eye, person(x, y), [car, solid(x / 2, y)]) <= share <= 1.0
    assert seen_share(eye, person(x, y), []) == 1.0


def test_over_a_car_lower_than_the_eye_the_upper_body_is_seen():
    """From 2 m over a roof of 1 m, 5 to 7 m away, the line to a person 10 m away is free above its 0.57 m."""
    eye, roof_m = (0.0, 0.0, 2.0), 1.0
    car = solid(6.0, 0.0, length_m=2.0, height_m=roof_m)
    above_m = 2.0 - (2.0 - roof_m) * 10.0 / 7.0
    share = seen_share(eye, person(10.0, 0.0), [car])
    assert share == sum(up * 1.8 > above_m for up in (0.1, 0.3, 0.5, 0.7, 0.9)) / 5
    assert seen_share(eye, person(10.0, 0.0, height_m=0.5), [car]) == 0.0


def test_a_child_behind_a_parked_car_is_seen_once_it_has_stepped_out():
    parked = [{"gap_m": 15.0, "offset_m": -2.8}, {"gap_m": 21.0, "offset_m": -2.8}]
    child = {"gap_m": 20.0, "shape": "child"}
    assert sense({**child, "offset_m": -2.8}, traffic=parked).kinds == ()
    assert sense({**child, "offset_m": -2.8}).kinds == ("person",)
    assert sense({**child, "offset_m": -1.0}, traffic=parked).kinds == ("person",)


def exact_model(**changes):
    settings = build_road_user_model(CAMERA, seed=0)._settings
    quiet = dict(foot_sigma_px=0.0, side_sigma_px=0.0, velocity_sigma_mps=0.0, seen=(1.0,) * 5)
    prompt = dict(found_after_s=0.0, velocity_after_s=0.0, velocity_lag_s=1e-6)
    return RoadUserModel(settings.model_copy(update={**quiet, **prompt, **changes}), CAMERA, seed=1)


def message(t_s, x_m=15.0, y_m=1.0, kinds=("person",)):
    n = len(kinds)
    return RoadUsers(
        t_s=t_s,
        kinds=kinds,
        x_m=(x_m,) * n,
        y_m=(y_m,) * n,
        x_mps=(1.0,) * n,
        y_mps=(-2.0,) * n,
        confidences=(1.0,) * n,
        detects=("person",),
    )


def test_a_model_without_errors_passes_the_truth_on():
    model = exact_model()
    model.step(message(0.0), (0,))
    found, truth = model.step(message(0.04), (0,)), message(0.04)
    for name in ("x_m", "y_m", "x_mps", "y_mps"):
        assert getattr(found, name) == pytest.approx(getattr(truth, name))
    assert replace(found, x_m=(), y_m=(), x_mps=(), y_mps=()) == replace(
        truth, x_m=(), y_m=(), x_mps=(), y_mps=()
    )


@pytest.mark.parametrize("x_m", [8.0, 14.0, 26.0])
def test_the_error_of_the_feet_grows_with_the_square_of_the_distance(x_m):
    model = exact_model(foot_sigma_px=0.3, memory_s=1e-3)
    away_m = x_m - CAMERA.x_m
    found = [model.step(message(k * 0.04, x_m, 0.0), (0,)).x_m[0] for k in range(800)]
    sigma_m = 0.3 * away_m**2 / (CAMERA.fy_px * CAMERA.height_m)
    assert np.std(found) == pytest.approx(sigma_m, rel=0.12)
    assert np.mean(found) == pytest.approx(x_m, abs=0.2 * sigma_m + 0.02 * x_m)


def test_a_person_that_comes_into_sight_is_reported_later_and_its_velocity_later_still():
    model = exact_model(found_after_s=0.2, velocity_after_s=0.4)
    reports = [model.step(message(k * 0.04), (0,)) for k in range(30)]
    first = next(k for k, report in enumerate(reports) if report.kinds)
    known = next(k for k, report in enumerate(reports) if report.kinds and not math.isnan(report.x_mps[0]))
    assert (first, known) == (5, 15)
    assert model.step(message(1.2, kinds=()), ()).kinds == ()
    assert model.step(message(1.24), (0,)).kinds == ()


@pytest.mark.parametrize("share", [0.5, 0.9])
def test_the_model_sees_a_person_for_the_given_share_of_the_time(share):
    model = exact_model(seen=(share,) * 5)
    reports = [bool(model.step(message(k * 0.04), (0,)).kinds) for k in range(20_000)]
    assert np.mean(reports) == pytest.approx(share, abs=0.05)


def test_beyond_the_reach_and_beside_the_image_nothing_is_found():
    assert exact_model().step(message(0.0, x_m=60.0), (0,)).kinds == ()
    half = CAMERA.cx_px / CAMERA.fx_px
    outside = message(0.0, x_m=CAMERA.x_m + 5.0, y_m=5.0 * half + 0.1)
    inside = message(0.0, x_m=CAMERA.x_m + 5.0, y_m=5.0 * half - 0.1)
    assert exact_model().step(outside, (0,)).kinds == ()
    assert exact_model().step(inside, (0,)).kinds == ("person",)


@pytest.mark.parametrize("sensor", ["truth", "modelled"])
def test_the_supervisor_of_a_run_gets_the_road_users(sensor):
    scenario = scenario_of({"gap_m": 12.0, "offset_m": -4.0}, road_user_sensor=sensor, duration_s=1.0)
    heard = []
    result = run(
        scenario, parts=build_parts(scenario, seed=0), witness=lambda now: heard.append(now.road_users)
    )
    nearest_m = math.hypot(12.0 - 0.3, 4.0 - 0.7 - 0.25)
    assert nearest_m / math.sqrt(2) <= result.row()["min_road_user_gap_m"] <= nearest_m
    assert heard[-1].kinds == ("person",)
    assert heard[-1].y_m == pytest.approx((-4.0,), abs=1.0)
