"""The lead detector on rendered vehicles."""

import message_rig
import pytest

from perception.lead.finder import build
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
NOSE_M = VEHICLE.wheelbase_m + VEHICLE.front_overhang_m
PERIOD_S = 0.04


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return Renderer(load_road("straight"), CAMERA, seed=5)


@pytest.mark.parametrize("gap_m", [5.0, 10.0, 18.0])
@pytest.mark.parametrize("aside_m", [-0.5, 0.5])
def test_a_rendered_car_is_found_where_it_is(renderer: Renderer, gap_m: float, aside_m: float) -> None:
    road, finder, station_m = renderer.road, build(), 30.0
    for n in range(8):
        t_s = n * PERIOD_S
        rear_m = station_m + NOSE_M + gap_m - Body().rear_m
        pose = (*road.position(rear_m, aside_m), road.heading_at(rear_m))
        here = (*road.position(station_m, 0.0), road.heading_at(station_m))
        image = renderer.render(*here, t_s=t_s, station_m=station_m, lead=pose)
        answer = finder.step(
            Frame(t_s=t_s, image=image), message_rig.state(t_s, speed_mps=0.0), [], now_s=t_s
        )
    assert answer.confidence > 0.6
    assert answer.distance_m == pytest.approx(gap_m, rel=0.15, abs=0.6)
    assert answer.lateral_m == pytest.approx(aside_m, abs=0.35)


def test_an_empty_rendered_road_has_no_vehicle(renderer: Renderer) -> None:
    road, finder = renderer.road, build()
    for n in range(20):
        station_m, t_s = 30.0 + 2.0 * n, n * PERIOD_S
        here = (*road.position(station_m, 0.0), road.heading_at(station_m))
        image = renderer.render(*here, t_s=t_s, station_m=station_m)
        assert finder.step(Frame(t_s=t_s, image=image), message_rig.state(t_s), [], now_s=t_s).confidence == 0
