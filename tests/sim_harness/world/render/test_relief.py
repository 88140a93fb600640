"""Hills and walls in the image: rows by projection, things hidden behind them, symmetry, light."""

import math

import cv2
import numpy as np
import pytest

from sim_harness.scenarios.traffic import BODIES, Shape
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.appearance import Light, Section
from sim_harness.world.roads.disturbances import Disturbance
from sim_harness.world.roads.elevation import ElevationPoint
from sim_harness.world.roads.features import RoadMark, Wall
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
PLAIN = Light(noise=0)
STRAIGHT = (Segment(length_m=400),)
TRUCK = BODIES[Shape.TRUCK]


def road(*marks: RoadMark, segments: tuple[Segment, ...] = STRAIGHT, **features: object) -> Road:
    look = {"name": "plain", "closed": False, "lane_width_m": 3.4}
    sections = (Section(name="plain", start_m=0, patchiness=0),)
    return Road(RoadSettings(**look, sections=sections, segments=segments, marks=marks, **features))


def hill(*points: tuple[float, float]) -> tuple[ElevationPoint, ...]:
    return tuple(ElevationPoint(at_m=at_m, grade=grade) for at_m, grade in points)


def frame(on: Road, station_m: float = 20.0, *disturbances: Disturbance, camera: Camera = CAMERA, **how):
    pose = (*on.position(station_m, 0.0), on.heading_at(station_m))
    renderer = Renderer(on, camera, seed=3, disturbances=disturbances)
    return renderer.render(*pose, **({"t_s": 1.0, "station_m": station_m, "light": PLAIN} | how))


def grey(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(float)


def test_an_even_grade_looks_like_flat_ground_but_for_the_horizon():
    """The vehicle stands on the same slope as the ground ahead."""
    flat, slope = (grey(frame(road(elevation=points))) for points in ((), hill((0.0, 0.06))))
    near = math.ceil(CAMERA.horizon_row_px) + 12
    assert np.abs(flat[near:] - slope[near:]).mean() < 2.5
    assert np.corrcoef(flat[near:].ravel(), slope[near:].ravel())[0, 1] > 0.97
    assert np.abs(flat[:near] - slope[:near]).mean() > 5


@pytest.mark.parametrize("grade", [0.05, -0.04])
def test_a_stop_line_in_a_sag_or_on_a_crest_lies_in_the_row_of_its_height(grade):
    """Its height above the tangent at the vehicle is ds²/(2·R) with R = L/Δg."""
    profile = hill((20.0, 0.0), (120.0, grade))
    at_m, long_m = 50.0, 0.5
    bare, marked = (
        grey(frame(road(*marks, elevation=profile)))
        for marks in ([], [RoadMark(kind="stop_line", at_m=at_m, length_m=long_m)])
    )
    change = np.abs(marked - bare)[:, 150:170].sum(axis=1)
    row = float((change * np.arange(len(change))).sum() / change.sum())
    run_m = at_m + long_m / 2 - 20.0
    up_m = run_m**2 * grade / (2 * 100.0)
    ahead_m, down_m = run_m - CAMERA.x_m, CAMERA.height_m - up_m
    cos, sin = math.cos(CAMERA.pitch_down_rad), math.sin(CAMERA.pitch_down_rad)
    expected = CAMERA.cy_px + CAMERA.fy_px * (down_m * cos - ahead_m * sin) / (ahead_m * cos + down_m * sin)
    assert row == pytest.approx(expected, abs=0.4)


def test_a_vehicle_behind_a_crest_is_hidden_up_to_the_line_of_sight():
    """On a crest of 400 m radius a car of 1.48 m at 150 m is below the line of sight, a truck at 60 m is not."""
    crest = road(elevation=hill((10.0, 0.15), (130.0, -0.15)))
    empty = frame(crest)

    def shows(ahead_m: float, body: Body) -> int:
        pose: Pose = (20.0 + ahead_m, 0.0, 0.0)
        return int((frame(crest, vehicles=[(pose, body)]) != empty).any(axis=2).sum())

    assert shows(150.0, Body()) == 0
    assert shows(12.0, Body()) > 500
    whole = int((frame(road(), vehicles=[((80.0, 0.0, 0.0), TRUCK)]) != frame(road())).any(axis=2).sum())
    assert 0 < shows(60.0, TRUCK) < 0.9 * whole


def test_a_vehicle_behind_a_wall_is_hidden_and_one_before_it_is_not():
    walled = road(walls=(Wall(side="right", from_m=25, to_m=120, distance_m=2.0, height_m=3.0),))
    empty = frame(walled)
    behind = frame(walled, vehicles=[((50.0, -8.0, 0.0), Body())])
    before = frame(walled, vehicles=[((50.0, -2.0, 0.0), Body())])
    assert np.array_equal(empty, behind)
    assert (empty != before).any(axis=2).sum() > 50


@pytest.mark.parametrize("kind", ["parapet", "stone", "houses", "kerb"])
def test_the_upper_edge_of_a_wall_lies_where_the_camera_sees_its_height(kind):
    wall = Wall(kind=kind, side="right", from_m=30, to_m=60, distance_m=3.0, height_m=2.5)
    changed = (frame(road(walls=(wall,))) != frame(road())).any(axis=2)
    ahead_m, aside_m = 30.0 - 20.0 - CAMERA.x_m, 1.7 + 3.0
    cos, sin = math.cos(CAMERA.pitch_down_rad), math.sin(CAMERA.pitch_down_rad)
    depth_m = ahead_m * cos - (2.5 - CAMERA.height_m) * sin
    column = CAMERA.cx_px + CAMERA.fx_px * aside_m / depth_m
    top = CAMERA.cy_px - CAMERA.fy_px * ((2.5 - CAMERA.height_m) * cos + ahead_m * sin) / depth_m
    rows = np.flatnonzero(changed[:, round(column) - 1])
    assert rows[0] == pytest.approx(top, abs=1.5)


@pytest.mark.parametrize(("kind", "share"), [("stone", 0.01), ("kerb", 0.01), ("trees", 0.03)])
def test_walls_left_and_right_are_mirror_images_but_for_their_heights(kind, share):
    camera = CAMERA.model_copy(update={"cx_px": (CAMERA.width_px - 1) / 2})
    masks = []
    for side in ("left", "right"):
        walled = road(walls=(Wall(kind=kind, side=side, from_m=24, to_m=90, distance_m=1.5),))
        masks.append((frame(walled, camera=camera) != frame(road(), camera=camera)).any(axis=2))
    assert masks[0].any()
    assert (masks[0] != masks[1][:, ::-1]).mean() < share


def test_a_row_of_trees_hides_only_what_is_behind_trunks_and_crowns():
    avenue = road(walls=(Wall(kind="trees", side="right", from_m=25, to_m=121, distance_m=2.0),))
    truck = [((50.0, -8.0, 0.0), TRUCK)]
    without = (frame(road()) != frame(road(), vehicles=truck)).any(axis=2)
    within = (frame(avenue) != frame(avenue, vehicles=truck)).any(axis=2)
    assert not (within & ~without).any()
    assert 0.2 * without.sum() < within.sum() < 0.95 * without.sum()


def test_a_bank_of_snow_hides_the_wheels_of_a_vehicle_behind_it_and_shows_its_roof():
    bank = road(walls=(Wall(kind="snow", side="right", from_m=22, to_m=120, distance_m=1.0),))
    van = [((40.0, -6.0, 0.0), BODIES[Shape.VAN])]
    without = (frame(road()) != frame(road(), vehicles=van)).any(axis=2).any(axis=1)
    within = (frame(bank) != frame(bank, vehicles=van)).any(axis=2).any(axis=1)
    rows = [np.flatnonzero(mask) for mask in (without, within)]
    assert rows[0][0] == rows[1][0]
    assert rows[1][-1] <= rows[0][-1] - 3


def test_fog_covers_a_far_wall_more_than_a_near_one():
    fog = Disturbance(kind="fog", grade=5)
    contrasts = []
    for ahead_m in (8.0, 40.0):
        start_m = 20.0 + ahead_m
        wall = Wall(
            kind="hedge", side="right", from_m=start_m, to_m=start_m + 30, distance_m=1.0, height_m=6.0
        )
        foggy = [frame(on, 20.0, fog).astype(float) for on in (road(), road(walls=(wall,)))]
        clear = [frame(on).astype(float) for on in (road(), road(walls=(wall,)))]
        change = [np.abs(b - a).max() for a, b in (foggy, clear)]
        contrasts.append(change[0] / change[1])
    assert contrasts[1] < 0.4 * contrasts[0]


def test_equal_seeds_give_equal_pictures_of_walls_and_hills():
    made = [
        frame(
            road(
                walls=(Wall(kind="hedge", side="both", from_m=0, to_m=200),),
                elevation=hill((0, 0.02), (90, -0.03)),
            )
        )
        for _ in range(2)
    ]
    assert np.array_equal(*made)


@pytest.mark.parametrize("kind", ["night", "rain", "motion_blur", "rolling_shutter"])
def test_disturbances_apply_to_roads_with_walls_and_hills(kind):
    both = road(walls=(Wall(side="left", from_m=0, to_m=200),), elevation=hill((0, 0.02), (90, -0.03)))
    vehicles = [((45.0, 0.0, 0.0), TRUCK)]
    clear, worse = (
        frame(both, 20.0, *d, vehicles=vehicles, motion=ShutterMotion(8.0, 0.2))
        for d in ((), (Disturbance(kind=kind, grade=4),))
    )
    assert worse.shape == clear.shape
    assert (worse != clear).any()
