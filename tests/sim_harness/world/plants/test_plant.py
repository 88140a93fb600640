"""Every plant behind the one interface, and the controller on the plants of Trepid."""

import math
from dataclasses import replace

import numpy as np
import pytest
from closed_loop_rig import drive as closed_loop
from closed_loop_rig import generous, worst_m
from message_rig import SHUTTLE
from plant_rig import command, drive
from s_road_rig import s_clothoid

from controller.laws.lateral import LawName
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.kinematic import KinematicPlant
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid import plugins
from trepid.config import InputError

NEEDS = {
    Model.COMMONROAD_DRIFT: "vehiclemodels",
    Model.COMMONROAD_MULTI_BODY: "vehiclemodels",
    Model.HIGHWAY_ENV: "highway_env",
}


@pytest.fixture(params=list(Model))
def plant(request):
    """Each plant that is installed, in its default settings."""
    if request.param in NEEDS:
        pytest.importorskip(NEEDS[request.param], reason=f"{request.param} needs the extra [bench]")
    return build_plant(PlantSettings(model=request.param), SHUTTLE)


def test_every_plant_rolls_straight_at_constant_speed(plant):
    end = drive(plant, plant.initial(1.0, 2.0, math.pi / 2, 10.0), command(), 1.0)
    assert (end.x_m, end.y_m) == (pytest.approx(1.0, abs=0.02), pytest.approx(12.0, abs=0.05))
    assert end.speed_mps == pytest.approx(10.0, abs=0.05)
    assert plant.lateral_accel_mps2(end) == pytest.approx(0.0, abs=0.02)


def test_every_plant_settles_on_the_curvature_of_the_steady_angle(plant):
    """To 3 %: the tyres of single track and multi-body are not quite linear."""
    start = plant.initial(speed_mps=10.0, curvature_1pm=0.02)
    assert start.acting_demand_rad == plant.steady_angle_rad(0.02, 10.0)
    end = drive(plant, start, command(start.acting_demand_rad), 1.0)
    assert plant.yaw_rate_radps(end) == pytest.approx(0.2, rel=0.03)
    assert plant.lateral_accel_mps2(end) == pytest.approx(2.0, rel=0.03)


def test_every_plant_turns_left_for_a_positive_angle_and_mirrors_it(plant):
    left, right = (drive(plant, plant.initial(speed_mps=5.0), command(a), 1.0) for a in (0.1, -0.1))
    assert left.y_m > 0.1
    assert right.y_m == pytest.approx(-left.y_m, rel=0.03)  # the multi-body model is slightly asymmetrical
    assert right.yaw_rad == pytest.approx(-left.yaw_rad, rel=0.03)


def test_every_plant_is_deterministic_and_does_not_modify_the_given_state(plant):
    start = plant.initial(speed_mps=8.0)
    first, second = (drive(plant, start, command(0.1, 0.5), 0.3) for _ in range(2))
    assert first == second
    assert start == plant.initial(speed_mps=8.0)


def test_every_plant_refuses_a_demand_that_is_not_finite(plant):
    with pytest.raises(ValueError, match="finite"):
        plant.step(plant.initial(), replace(command(), accel_mps2=math.inf), 0.01)


@pytest.mark.parametrize("model", [Model.KINEMATIC, Model.SINGLE_TRACK])
def test_settings_override_fields_of_the_vehicle_file(model):
    real = build_plant(PlantSettings(model=model, vehicle={"wheelbase_m": 2.5}), SHUTTLE)
    assert real.vehicle.wheelbase_m == 2.5
    assert real.steady_angle_rad(0.1, 0.0) == pytest.approx(math.atan(0.25))
    with pytest.raises(InputError, match="wheelbase_m: Input should be greater than 0"):
        build_plant(PlantSettings(model=model, vehicle={"wheelbase_m": -1.0}), SHUTTLE)
    with pytest.raises(InputError, match="wheelbas_m"):
        build_plant(PlantSettings(model=model, vehicle={"wheelbas_m": 1.0}), SHUTTLE)


REAR_SLIP = 1.0 / (PlantSettings().chassis.rear_stiffness_per_rad * GRAVITY_MPS2)
TYRED = SHUTTLE.model_copy(update=dict(rear_slip_gradient_rad_per_mps2=REAR_SLIP))


@pytest.mark.parametrize(
    ("law", "model", "known", "speed_mps", "bound_m"),
    [
        (LawName.FEEDFORWARD, Model.KINEMATIC, SHUTTLE, 5.0, 0.02),
        (LawName.FEEDFORWARD, Model.KINEMATIC, SHUTTLE, 20.0, 0.02),
        (LawName.FEEDFORWARD, Model.SINGLE_TRACK, TYRED, 5.0, 0.03),
        (LawName.FEEDFORWARD, Model.SINGLE_TRACK, TYRED, 20.0, 0.07),
        (LawName.LQI, Model.KINEMATIC, SHUTTLE, 20.0, 0.01),
        (LawName.LQI, Model.SINGLE_TRACK, TYRED, 5.0, 0.02),
        (LawName.LQI, Model.SINGLE_TRACK, TYRED, 20.0, 0.03),
    ],
)
def test_the_laws_follow_an_s_clothoid_at_2_mps2(law, model, known, speed_mps, bound_m):
    assert _s_worst_m(law, model, known, speed_mps) <= bound_m


def test_without_the_rear_slip_gradient_the_path_is_missed_on_tyres():
    """Lateral error with a vehicle file without ``rear_slip_gradient_rad_per_mps2``."""
    assert _s_worst_m(LawName.FEEDFORWARD, Model.SINGLE_TRACK, SHUTTLE, 20.0) > 0.2


def _s_worst_m(law, model, known, speed_mps):
    plant, calm = build_plant(PlantSettings(model=model), SHUTTLE), generous(2.6)
    samples = closed_loop(
        s_clothoid(speed_mps),
        start=plant.initial(speed_mps=speed_mps),
        cap_mps=speed_mps,
        duration_s=13.0,
        plant=plant,
        known_vehicle=known,
        settings=calm.model_copy(update=dict(lateral=calm.lateral.model_copy(update=dict(law=law)))),
    )
    return worst_m(samples)


class NoisyPlant(KinematicPlant):
    """A plant of another package with a random grip."""

    def begin(self, seed: int) -> None:
        self.grip = np.random.default_rng(seed).uniform()


def test_a_plant_of_another_package_begins_with_the_seed_of_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plugins, "part", lambda *_: NoisyPlant)
    settings = PlantSettings().model_copy(update={"model": "noisy"})
    built = [build_plant(settings, SHUTTLE, seed=seed) for seed in (3, 3, 4)]
    same, again, other = (plant.grip for plant in built if isinstance(plant, NoisyPlant))
    assert same == again != other
