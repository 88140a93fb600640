"""highway-env's vehicle as a plant: an independent linear single track."""

import pytest
from message_rig import SHUTTLE
from plant_rig import command, drive

from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import Model, PlantSettings
from sim_harness.world.plants.single_track import SingleTrackPlant
from trepid.config import InputError

pytest.importorskip("highway_env", reason="highway-env is in the extra [bench]")


@pytest.mark.parametrize("speed_mps", [5.0, 15.0])
@pytest.mark.parametrize("load_kg", [0.0, 300.0])
def test_single_track_and_highway_env_drive_the_same_path_while_tyres_are_linear(speed_mps, load_kg):
    """A step of the wheel at 0.5 m/s²; highway-env holds the mean wheel angle over each step."""
    settings = PlantSettings(model=Model.HIGHWAY_ENV, load_kg=load_kg)
    single_track, foreign = SingleTrackPlant(SHUTTLE, settings), build_plant(settings, SHUTTLE)
    angle_rad = single_track.steady_angle_rad(0.5 / speed_mps**2, speed_mps)
    ends = [
        drive(plant, plant.initial(speed_mps=speed_mps), command(angle_rad), 3.0)
        for plant in (single_track, foreign)
    ]
    assert ends[0].x_m == pytest.approx(ends[1].x_m, abs=0.01)
    assert ends[0].y_m == pytest.approx(ends[1].y_m, abs=0.01)
    rates = [plant.yaw_rate_radps(end) for plant, end in zip((single_track, foreign), ends, strict=True)]
    assert rates[0] == pytest.approx(rates[1], rel=0.005)


def test_the_plant_drives_off_from_standstill_and_stops():
    plant = build_plant(PlantSettings(model=Model.HIGHWAY_ENV), SHUTTLE)
    fast = drive(plant, plant.initial(), command(0.1, 1.5), 2.0)
    assert fast.speed_mps > 2.0
    stopped = drive(plant, fast, command(0.1, -6.0), 1.0)
    assert stopped.speed_mps == 0.0


@pytest.mark.parametrize("change", [{"bank_rad": 0.05}, {"friction": 0.5}])
def test_bank_and_friction_are_refused(change):
    with pytest.raises(InputError, match="neither a banked road nor its friction"):
        build_plant(PlantSettings(model=Model.HIGHWAY_ENV, **change), SHUTTLE)
