"""CommonRoad's models as plants, and as independent references for SingleTrackPlant."""

import math

import pytest
from message_rig import SHUTTLE
from plant_rig import command, drive

from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.commonroad import ROLLING_MPS, UNDERSTEER
from sim_harness.world.plants.settings import Chassis, Model, PlantSettings
from sim_harness.world.plants.single_track import SingleTrackPlant
from trepid.config import InputError

pytest.importorskip("vehiclemodels", reason="commonroad-vehicle-models is in the extras [test] and [bench]")

FOREIGN = [Model.COMMONROAD_DRIFT, Model.COMMONROAD_MULTI_BODY]
# Mass, axles and tyres of the same vehicle 2, shortened to the wheelbase of the shuttle.
BMW = dict(
    mass_kg=1093.3,
    front_share=1.4227 / 2.5789,
    yaw_inertia_index=1791.6 / (1093.3 * 1.1562 * 1.4227),
    rear_stiffness_per_rad=21.92,
)


def settle(model, speed_mps, curvature_1pm, seconds=1.2):
    """Plant and state after the steady angle for ``curvature_1pm`` was held."""
    plant = build_plant(PlantSettings(model=model), SHUTTLE)
    start = plant.initial(speed_mps=speed_mps, curvature_1pm=curvature_1pm)
    return plant, drive(plant, start, command(start.acting_demand_rad), seconds)


@pytest.mark.parametrize("model", FOREIGN)
def test_the_understeer_gradients_are_measured_again(model):
    """Left and right bends together, as the tyres of the multi-body model are not quite symmetrical."""
    speed_mps, gradients = 20.0, []
    for side in (1, -1):
        plant, end = settle(model, speed_mps, side * 2.0 / speed_mps**2)
        curvature = plant.yaw_rate_radps(end) / end.speed_mps
        steering = end.road_wheel_angle_rad - math.atan(SHUTTLE.wheelbase_m * curvature)
        gradients.append(steering / (curvature * end.speed_mps**2))
    assert sum(gradients) / 2 == pytest.approx(UNDERSTEER[model], abs=4e-5)
    assert plant.vehicle.understeer_gradient_rad_per_mps2 == UNDERSTEER[model]


@pytest.mark.parametrize("model", FOREIGN)
@pytest.mark.parametrize("speed_mps", [5.0, 15.0])
def test_single_track_with_their_mass_and_tyres_has_their_yaw_rate(model, speed_mps):
    """Yaw rate through a step of the wheel to 2 m/s², to 1 % (drift) and 3 % (multi-body, which rolls)."""
    neutral = SHUTTLE.model_copy(update=dict(understeer_gradient_rad_per_mps2=UNDERSTEER[model]))
    single_track = SingleTrackPlant(neutral, PlantSettings(chassis=Chassis(**BMW)))
    foreign = build_plant(PlantSettings(model=model), SHUTTLE)
    angle_rad = single_track.steady_angle_rad(2.0 / speed_mps**2, speed_mps)
    left, right = single_track.initial(speed_mps=speed_mps), foreign.initial(speed_mps=speed_mps)
    apart = []
    for _ in range(100):
        left, right = (
            plant.step(state, command(angle_rad), 0.01)
            for plant, state in ((single_track, left), (foreign, right))
        )
        apart.append(abs(single_track.yaw_rate_radps(left) - foreign.yaw_rate_radps(right)))
    share = 0.01 if model is Model.COMMONROAD_DRIFT else 0.03
    assert max(apart) <= share * 2.0 / speed_mps


@pytest.mark.parametrize("model", FOREIGN)
def test_the_models_drive_off_from_standstill_turn_and_stop(model):
    plant = build_plant(PlantSettings(model=model), SHUTTLE)
    fast = drive(plant, plant.initial(), command(0.1, 1.5), 1.2)
    assert fast.speed_mps > 3 * ROLLING_MPS - 0.2
    assert fast.yaw_rad > 0.02
    stopped = drive(plant, fast, command(0.1, -6.0), 1.0)
    assert stopped.speed_mps == 0.0
    later = drive(plant, stopped, command(0.1, -6.0), 0.1)
    assert (later.x_m, later.y_m, later.yaw_rad) == (stopped.x_m, stopped.y_m, stopped.yaw_rad)


def test_the_drift_model_slides_on_a_slippery_road():
    plant = build_plant(PlantSettings(model=Model.COMMONROAD_DRIFT, friction=0.3), SHUTTLE)
    end = drive(plant, plant.initial(speed_mps=10.0), command(0.3), 1.5)
    peak = 1.0489 * 0.3 * 9.81
    assert 0.5 * peak <= plant.lateral_accel_mps2(end) <= 1.05 * peak


@pytest.mark.parametrize("model", FOREIGN)
def test_a_banked_road_is_refused(model):
    with pytest.raises(InputError, match="banked road"):
        build_plant(PlantSettings(model=model, bank_rad=0.05), SHUTTLE)
