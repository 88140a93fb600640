"""Things beside a road are drawn where the camera model puts them."""

import numpy as np
import pytest

from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.things import GLASS, Thing, ThingShape, draw_thing
from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


def draw_posed(thing: Thing, pose: tuple[float, float, float]) -> np.ndarray:
    image = np.zeros((240, 320, 3), np.uint8)
    draw_thing(image, CAMERA, thing, pose)
    return image


def pixel(x_m: float, y_m: float, z_m: float) -> np.ndarray:
    return CAMERA.model_copy(update={"height_m": CAMERA.height_m - z_m}).pixel_from_road([(x_m, y_m)])[0]


@pytest.mark.parametrize("above_m", [0.0, 0.4])
def test_a_block_fills_its_projected_front(above_m):
    image = draw_posed(Thing(ThingShape.BLOCK, 0.2, 1.5, 0.9, (255, 255, 255), above_m), (12.0, 1.0, 0.0))
    rows, columns = np.nonzero(image[..., 0] > 128)
    left, right = pixel(11.9, 1.75, above_m), pixel(11.9, 0.25, 0.9)
    assert (columns.min(), columns.max()) == pytest.approx((left[0], right[0]), abs=1)
    assert (rows.max(), rows.min()) == pytest.approx((left[1], right[1]), abs=1)


def test_a_house_shows_the_windows_of_the_side_towards_the_camera():
    house = Thing(ThingShape.HOUSE, 10.0, 6.0, 6.5, (200, 200, 200))
    beside = (draw_posed(house, (16.0, 8.0, 0.0)) == GLASS).all(axis=2)
    rows, columns = np.nonzero(beside)
    assert len(rows) > 20 and columns.max() < CAMERA.cx_px
    assert (
        not (draw_posed(house, (20.0, 0.0, 0.0)) == GLASS).all(axis=2).any()
    )  # its end is towards the camera


def test_a_tree_has_its_height_and_its_foot_on_the_ground():
    image = draw_posed(Thing(ThingShape.TREE, 0.4, 3.0, 5.0, (40, 120, 60)), (20.0, 2.0, 0.0))
    rows = np.flatnonzero(image.any(axis=(1, 2)))
    assert rows.max() == pytest.approx(pixel(20.0, 2.0, 0.0)[1], abs=1.5)
    assert rows.min() == pytest.approx(max(pixel(20.0, 2.0, 5.0)[1], 0), abs=4)


@pytest.mark.parametrize("shape", list(ThingShape))
def test_nothing_is_drawn_of_a_thing_behind_the_camera(shape):
    assert not draw_posed(Thing(shape, 4.0, 4.0, 4.0, (200, 200, 200)), (-8.0, 1.0, 0.0)).any()


def test_a_renderer_draws_the_near_things_of_its_road_and_hides_the_farther_ones():
    road = Road(
        RoadSettings(
            name="straight",
            closed=False,
            lane_width_m=3.5,
            segments=(Segment(length_m=200.0),),
            sections=(Section(name="all", start_m=0.0),),
        )
    )
    behind_m = 4.0 * (50.0 - CAMERA.x_m) / (20.0 - CAMERA.x_m)
    near = ((30.0, 4.0, 0.0), Thing(ThingShape.BLOCK, 1.0, 2.0, 3.0, (0, 0, 255)))
    far = ((60.0, behind_m, 0.0), Thing(ThingShape.BLOCK, 1.0, 2.0, 3.0, (0, 255, 0)))
    distant = ((150.0, -4.0, 0.0), Thing(ThingShape.BLOCK, 1.0, 2.0, 3.0, (0, 255, 0)))

    def red_and_green(*things) -> tuple[bool, bool]:
        image = Renderer(road, CAMERA, seed=1, things=things).render(10.0, 0.0, 0.0, t_s=0.0, station_m=10.0)
        _, green, red = (image[..., i].astype(int) for i in range(3))
        return bool((red - green > 100).any()), bool((green - red > 100).any())

    assert red_and_green(near, far, distant) == (True, False)
    assert red_and_green(far) == (False, True)
    assert red_and_green() == (False, False)
