"""People, cyclists and animals stand in the picture where the camera sees them, as tall as they are."""

from dataclasses import replace

import numpy as np
import pytest

from sim_harness.lockstep.camera import people
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.people import FIGURES, Shape, draw_figure, figure_outline
from sim_harness.world.render.scene.vehicles import Body, draw_lead
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.disturbances import Disturbance
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera).resize(960, 720)
GREY = 120
ROAD = load_road("straight")
WALK = replace(FIGURES[Shape.ADULT], speed_mps=1.4)


def draw_person(figure, pose, *, camera=CAMERA):
    image = np.full((camera.height_px, camera.width_px, 3), GREY, np.uint8)
    draw_figure(image, camera, figure, pose)
    return image


def body_of(image):
    """Pixels that the figure covers: coloured, or lighter, or darker than the shadow on grey."""
    spread = image.max(axis=2).astype(int) - image.min(axis=2)
    return (spread > 12) | (image.max(axis=2) > GREY + 20)


def pixel_of(x_m, y_m, z_m, camera=CAMERA):
    eye = np.array([x_m, y_m, z_m]) - (camera.x_m, camera.y_m, camera.height_m)
    right, down, ahead = camera.optical_from_vehicle @ eye
    return camera.cx_px + camera.fx_px * right / ahead, camera.cy_px + camera.fy_px * down / ahead


@pytest.mark.parametrize("shape", [*Shape])
@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, np.pi / 2, -2.5])
@pytest.mark.parametrize(("x_m", "y_m"), [(8.0, 0.0), (15.0, 2.0), (25.0, -4.0)])
def test_the_outline_reaches_from_the_ground_to_the_height_of_the_body_around_its_place(
    shape, yaw_rad, x_m, y_m
):
    figure = FIGURES[shape]
    hull = figure_outline(CAMERA, figure, (x_m, y_m, yaw_rad)).reshape(-1, 2) / 16
    (u, foot), (_, top) = pixel_of(x_m, y_m, 0.0), pixel_of(x_m, y_m, figure.height_m)
    tall_px = foot - top
    assert hull[:, 1].min() == pytest.approx(top, abs=0.10 * tall_px)
    assert hull[:, 1].max() == pytest.approx(foot, abs=0.14 * tall_px)
    assert hull[:, 0].min() < u < hull[:, 0].max()
    assert np.ptp(hull[:, 0]) <= 1.25 * CAMERA.fx_px * np.hypot(figure.length_m, figure.width_m) / (x_m - 2)


@pytest.mark.parametrize("shape", [*Shape])
def test_the_picture_of_a_figure_lies_within_its_outline(shape):
    pose, figure = (9.0, 1.0, 0.8), replace(FIGURES[shape], looks=4)
    hull = figure_outline(CAMERA, figure, pose).reshape(-1, 2) / 16
    rows, columns = np.nonzero(body_of(draw_person(figure, pose)))
    assert len(rows) > 0
    wheel_px = 0.30 * CAMERA.fx_px / 8 if shape is Shape.CYCLIST else 2.0
    assert hull[:, 0].min() - wheel_px <= columns.min() <= columns.max() <= hull[:, 0].max() + wheel_px
    assert hull[:, 1].min() - 2 <= rows.min()


@pytest.mark.parametrize("shape", [*Shape])
@pytest.mark.parametrize(("y_m", "yaw_rad"), [(1.5, 0.6), (-2.0, 2.0), (0.0, 0.0)])
def test_the_mirror_image_has_the_mirrored_outline(shape, y_m, yaw_rad):
    figure = FIGURES[shape]
    half_a_turn_m = 2.5 * figure.height_m / 1.865 if shape is Shape.CYCLIST else 0.0  # of the pedals
    other, middle = replace(figure, walked_m=half_a_turn_m), CAMERA.cx_px
    one = figure_outline(CAMERA, figure, (12.0, y_m, yaw_rad)).reshape(-1, 2) / 16
    two = figure_outline(CAMERA, other, (12.0, -y_m, -yaw_rad)).reshape(-1, 2) / 16
    assert one.min(axis=0) == pytest.approx((2 * middle - two[:, 0].max(), two[:, 1].min()), abs=0.3)
    assert one.max(axis=0) == pytest.approx((2 * middle - two[:, 0].min(), two[:, 1].max()), abs=0.3)


def test_walking_legs_are_apart_and_together_twice_in_a_stride():
    stride_m = 0.83 * WALK.height_m

    def wide_px(walked_m):
        hull = figure_outline(CAMERA, replace(WALK, walked_m=walked_m), (10.0, 0.0, np.pi / 2))
        return np.ptp(hull.reshape(-1, 2)[:, 0]) / 16

    apart, together = wide_px(stride_m / 4), wide_px(0.0)
    assert apart > 1.4 * together
    assert wide_px(stride_m * 3 / 4) == pytest.approx(apart, rel=0.1)
    still = replace(WALK, speed_mps=0.0)
    assert np.array_equal(
        draw_person(replace(still, walked_m=0.1), (9, 0, 1)),
        draw_person(replace(still, walked_m=0.6), (9, 0, 1)),
    )


def test_looks_follow_the_seed():
    images = [draw_person(replace(WALK, looks=k), (6.0, 0.0, 0.0)).tobytes() for k in (*range(8), 0)]
    assert images[0] == images[8]
    assert len(set(images)) >= 6


def test_nothing_is_drawn_behind_the_lens():
    for x_m in (-5.0, 0.0, CAMERA.x_m + 0.2):
        assert (draw_person(WALK, (x_m, 0.0, 0.0)) == GREY).all()
        assert figure_outline(CAMERA, WALK, (x_m, 0.0, 0.0)) is None


def frame(*placed, **disturbances):
    kinds = [Disturbance(kind=kind, grade=grade) for kind, grade in disturbances.items()]
    renderer = Renderer(ROAD, CAMERA.resize(320, 240), seed=1, disturbances=kinds)
    return renderer.render(0.0, 0.0, 0.0, t_s=0.0, station_m=0.0, vehicles=placed).astype(int)


def test_a_person_before_a_car_is_seen_and_one_behind_it_is_not():
    car = ((12.0, 0.0, 0.0), Body(height_m=2.0))
    behind, before = ((18.0, 0.0, 0.0), WALK), ((9.0, 0.0, 0.0), WALK)
    alone = frame(car)
    assert np.array_equal(frame(behind, car), alone)
    assert (np.abs(frame(before, car) - alone).max(axis=2) > 30).sum() > 100


def test_fog_hides_a_far_person_and_headlights_show_a_near_one():
    def contrast(x_m, **disturbances):
        standing = ((x_m, 0.0, np.pi), replace(FIGURES[Shape.ADULT], looks=3))
        return np.abs(frame(standing, **disturbances) - frame(**disturbances)).max()

    assert contrast(8.0, fog=5) < contrast(8.0)
    assert contrast(40.0, fog=5) < 0.25 * contrast(40.0)
    assert contrast(8.0, night=5) > 3 * contrast(40.0, night=5)


def test_a_wet_road_mirrors_a_person():
    person = ((10.0, 0.0, 0.0), replace(WALK, looks=4))
    below = round(pixel_of(10.0, 0.0, 0.0, CAMERA.resize(320, 240))[1]) + 4

    def change(**disturbances):
        return np.abs(frame(person, **disturbances) - frame(**disturbances))[below:].sum()

    assert change(wet_road=5) > 3 * change()


def test_the_camera_of_a_run_draws_its_road_users_in_the_step_of_their_way():
    fields = dict(description="", tags=["traffic"], road="straight", duration_s=1.0)
    users = [{"gap_m": 10.0, "shape": "child"}, {"gap_m": 20.0, "shape": "dog"}]
    scenario = Scenario.model_validate(fields | {"road_users": users})

    class Truth:
        user_x_m, user_y_m = (10.0, 20.0), (1.0, -1.0)
        user_yaw_rad, user_speed_mps = (np.pi / 2, 0.0), (1.5, 0.0)

    (place, child), (_, dog) = people(Truth, [user.figure for user in scenario.road_users], seed=0)
    assert place == (10.0, 1.0, np.pi / 2)
    assert (child.shape, dog.shape) == (Shape.CHILD, Shape.DOG)
    assert (child.speed_mps, child.walked_m) == (1.5, pytest.approx(1.0))
    assert child.looks != dog.looks


def test_a_vehicle_is_drawn_by_the_function_that_draws_figures():
    one, two = (np.full((CAMERA.height_px, CAMERA.width_px, 3), GREY, np.uint8) for _ in range(2))
    draw_lead(one, CAMERA, WALK, (10.0, 0.0, 0.0))
    draw_figure(two, CAMERA, WALK, (10.0, 0.0, 0.0))
    assert np.array_equal(one, two)
