"""Plants on the plane of the road under them: its grade pulls along, its bank across."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command

CAR = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
OWN = (Model.KINEMATIC, Model.SINGLE_TRACK)
STEP_S = 0.01


def drive(angle_rad: float, accel_mps2: float) -> Command:
    return Command(t_s=0.0, road_wheel_angle_rad=angle_rad, speed_mps=10.0, accel_mps2=accel_mps2)


def run(plant, state, command: Command, duration_s: float):
    for _ in range(round(duration_s / STEP_S)):
        state = plant.step(state, command, STEP_S)
    return state


@pytest.mark.parametrize("model", OWN)
@given(grade=st.floats(-0.15, 0.15))
@settings(max_examples=10, deadline=None)
def test_coasting_on_an_even_grade_changes_the_speed_by_the_pull_of_the_weight(model, grade):
    plant = build_plant(PlantSettings(model=model), CAR)
    plant.stand_on(grade, 0.0)
    end = run(plant, plant.initial(speed_mps=15.0), drive(0.0, 0.0), 3.0)
    pull_mps2 = -GRAVITY_MPS2 * grade / math.hypot(1.0, grade)
    assert end.speed_mps == pytest.approx(15.0 + 3.0 * pull_mps2, abs=1e-9)
    assert end.x_m == pytest.approx(15.0 * 3.0 + pull_mps2 * 3.0**2 / 2, abs=1e-6)
    assert plant.longitudinal_accel_mps2(end) == pytest.approx(pull_mps2)


@pytest.mark.parametrize("model", [Model.COMMONROAD_DRIFT, Model.COMMONROAD_MULTI_BODY, Model.HIGHWAY_ENV])
def test_models_of_other_packages_feel_the_grade(model):
    pytest.importorskip("highway_env" if model is Model.HIGHWAY_ENV else "vehiclemodels")
    ends_mps = []
    for grade in (0.0, 0.08):
        plant = build_plant(PlantSettings(model=model), CAR)
        plant.stand_on(grade, 0.0)
        ends_mps.append(run(plant, plant.initial(speed_mps=15.0), drive(0.0, 0.0), 1.0).speed_mps)
    assert ends_mps[1] - ends_mps[0] == pytest.approx(-GRAVITY_MPS2 * math.sin(math.atan(0.08)), abs=0.05)


def test_the_brakes_reach_their_limit_on_top_of_the_weight():
    """Uphill a car stops shorter than its brakes alone allow, downhill later."""
    stops_m = []
    for grade in (0.12, 0.0, -0.12):
        plant = build_plant(PlantSettings(), CAR)
        plant.stand_on(grade, 0.0)
        stops_m.append(run(plant, plant.initial(speed_mps=10.0), drive(0.0, -9.0), 4.0).x_m)
    brakes_mps2, lag_s = CAR.max_decel_mps2, CAR.accel_lag_s
    for stop_m, grade in zip(stops_m, (0.12, 0.0, -0.12), strict=True):
        decel_mps2 = brakes_mps2 + GRAVITY_MPS2 * math.sin(math.atan(grade))
        stop_s = (10.0 + brakes_mps2 * lag_s) / decel_mps2  # once the lag of the brakes is over
        way_m = 10.0 * stop_s - decel_mps2 * stop_s**2 / 2 + brakes_mps2 * lag_s * (stop_s - lag_s)
        assert stop_m == pytest.approx(way_m, abs=1e-3)
    assert stops_m[0] < stops_m[1] < stops_m[2]


@pytest.mark.parametrize("model", OWN)
def test_a_car_on_a_bank_drives_as_one_whose_settings_have_the_bank(model):
    given_bank = build_plant(PlantSettings(model=model, bank_rad=0.06), CAR)
    taken = build_plant(PlantSettings(model=model), CAR)
    run(taken, taken.initial(speed_mps=9.0), drive(0.02, 0.1), 0.5)  # level before
    taken.stand_on(0.0, 0.06)
    ends = [run(plant, plant.initial(speed_mps=10.0), drive(0.02, 0.1), 2.0) for plant in (given_bank, taken)]
    assert ends[0] == ends[1]


@pytest.mark.parametrize("model", OWN)
def test_a_bank_to_the_left_is_the_mirror_image_of_one_to_the_right(model):
    ends = []
    for side in (1, -1):
        plant = build_plant(PlantSettings(model=model), CAR)
        plant.stand_on(0.03, side * 0.06)
        ends.append(run(plant, plant.initial(speed_mps=10.0), drive(0.0, 0.0), 2.0))
    assert ends[0].y_m == pytest.approx(-ends[1].y_m)
    assert ends[0].y_m < -0.05
    assert ends[0].speed_mps == pytest.approx(ends[1].speed_mps)
