"""Things in the lane and on the inside of a bend, drawn by their geometry, end the sight where they hide it."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sight_rig import CAMERA, SETTINGS, arc, bend, misty, with_box, with_trees

from perception.sight.hidden import End, HiddenRoad, HiddenWatch
from perception.sight.observer import Sight, SightObserver
from perception.sight.strip import Path, path_of
from perception.sight.upright import Edge, UprightEdges
from trepid.car.camera import Camera
from trepid.causes import Cause
from trepid.messages import Frame, SteeringEstimate

PERIOD_S = 0.04
CLEAR = with_trees(misty(5000.0))
WALL_M = 2.5  # from the middle of the lane


def watch_frames(
    image: np.ndarray, lane: SteeringEstimate | None, *, assumed: bool = False, frames: int = 15
) -> Sight:
    """The sight after some frames that show the same."""
    observer = SightObserver(SETTINGS, CAMERA, assumed=assumed)
    for number in range(frames):
        sight = observer.step(Frame(t_s=number * PERIOD_S, image=image), lane)
    assert sight is not None
    return sight


def way_to_hidden_m(radius_m: float, wall_m: float) -> float:
    """Way along an arc from the rear axle to the first place that a concentric wall on its inside hides."""
    eye = np.array([CAMERA.x_m, 0.0])
    centre = np.array([0.0, radius_m])
    for way_m in np.arange(5.0, 200.0, 0.05):
        turned = way_m / radius_m
        place = np.array([radius_m * math.sin(turned), radius_m * (1 - math.cos(turned))])
        along = (place - eye) / np.linalg.norm(place - eye)
        nearest = eye + max((centre - eye) @ along, 0.0) * along
        if np.linalg.norm(nearest - centre) < radius_m - wall_m and (nearest - eye) @ along < np.linalg.norm(
            place - eye
        ):
            return float(way_m)
    return math.inf


@pytest.mark.parametrize("ahead_m", [12.0, 20.0, 30.0, 40.0, 50.0])
def test_a_lorry_in_the_lane_ends_the_sight_at_its_base(ahead_m: float) -> None:
    sight = watch_frames(with_box(CLEAR, ahead_m), arc(0.0))
    assert sight.cause == Cause.OCCLUDED
    assert sight.distance_m == pytest.approx(ahead_m, rel=0.15)
    assert abs(sight.distance_m - ahead_m) < 2 * sight.sigma_m


def in_blocks(image: np.ndarray, step_grey: float, seed: int) -> np.ndarray:
    """``image`` with the steps between blocks of 8 x 8 pixels that strong JPEG compression leaves."""
    rows, columns = (-(-size // 8) for size in image.shape[:2])
    offset = np.random.default_rng(seed).uniform(-step_grey, step_grey, (rows, columns))
    blocks = np.kron(offset, np.ones((8, 8)))[: image.shape[0], : image.shape[1]]
    return np.clip(image + blocks, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("seed", range(5))
def test_the_blocks_of_a_compressed_image_are_no_sides_of_things(seed: int) -> None:
    def find(image: np.ndarray) -> list[Edge]:
        return UprightEdges(CAMERA, SETTINGS.hidden).find(np.repeat(image[:, :, None], 3, axis=2))

    assert len(find(in_blocks(CLEAR, 20.0, seed))) <= len(find(CLEAR))
    sight = watch_frames(in_blocks(with_box(CLEAR, 20.0), 6.0, seed), arc(0.0))
    assert sight.distance_m == pytest.approx(20.0, rel=0.15) and sight.cause == Cause.OCCLUDED


@pytest.mark.parametrize("seed", range(5))
def test_the_wider_blocks_of_compressed_colours_are_no_sides_of_things(seed: int) -> None:
    rows, columns = (-(-size // 16) for size in CLEAR.shape[:2])
    tints = np.random.default_rng(seed).uniform(-20.0, 20.0, (rows, columns, 3))
    tint = np.kron(tints, np.ones((16, 16, 1)))[: CLEAR.shape[0], : CLEAR.shape[1]]
    image = np.clip(CLEAR[:, :, None] + tint, 0, 255).astype(np.uint8)
    edges = UprightEdges(CAMERA, SETTINGS.hidden)
    assert len(edges.find(image)) <= len(edges.find(np.repeat(CLEAR[:, :, None], 3, axis=2)))


@pytest.mark.parametrize("left_m", [-4.5, 4.5])
def test_a_lorry_in_another_lane_of_a_straight_road_takes_no_sight(left_m: float) -> None:
    sight = watch_frames(with_box(CLEAR, 25.0, left_m=left_m), arc(0.0))
    assert sight.distance_m == pytest.approx(SETTINGS.reach_m) and sight.cause == ""


@pytest.mark.parametrize("tall_m", [0.1, 0.6, 1.2])
def test_what_is_lower_than_the_lens_shows_the_road_behind_it(tall_m: float) -> None:
    sight = watch_frames(with_box(CLEAR, 25.0, tall_m=tall_m), arc(0.0))
    assert sight.cause == ""


@pytest.mark.parametrize("grey", [0.35, 2.0])
def test_shadows_and_patches_on_the_ground_take_no_sight(grey: float) -> None:
    """Darker or lighter ground from 15 to 40 m, as wide as a lorry, and from 20 m on."""
    rows = np.arange(CAMERA.height_px)
    x_m = CAMERA.road_from_pixel(np.column_stack([np.full(len(rows), CAMERA.cx_px), rows]))[:, 0]
    for until_m in (40.0, math.inf):
        image = CLEAR.astype(float)
        there = (x_m > 15.0) & (x_m < until_m)
        half_px = np.where(there, 1.3 * CAMERA.fx_px / np.maximum(x_m, 1.0), 0.0)[:, None]
        inside = np.abs(np.arange(CAMERA.width_px) - CAMERA.cx_px) < half_px
        image = np.where(inside, image * grey, image)
        sight = watch_frames(np.clip(image, 0, 255).astype(np.uint8), arc(0.0))
        assert sight.cause == ""


@pytest.mark.parametrize("radius_m", [40.0, 60.0, 90.0, -40.0, -60.0, -90.0])
def test_a_wall_on_the_inside_of_a_bend_ends_the_sight_where_it_hides_the_lane(radius_m: float) -> None:
    true_m = way_to_hidden_m(abs(radius_m), WALL_M)
    sight = watch_frames(bend(radius_m, wall_m=WALL_M), arc(1 / radius_m))
    assert sight.cause == Cause.OCCLUDED
    assert sight.distance_m == pytest.approx(true_m, rel=0.25)
    assert abs(sight.distance_m - true_m) < 2 * sight.sigma_m


@pytest.mark.parametrize("radius_m", [60.0, -90.0])
def test_the_same_bend_without_a_wall_is_seen_farther(radius_m: float) -> None:
    assert watch_frames(bend(radius_m, wall_m=None), arc(1 / radius_m)).cause != Cause.OCCLUDED


@pytest.mark.parametrize("radius_m", [60.0, -90.0])
def test_a_wall_on_the_outside_of_a_bend_hides_nothing(radius_m: float) -> None:
    assert watch_frames(bend(radius_m, wall_m=-8.0), arc(1 / radius_m)).cause != Cause.OCCLUDED


@pytest.mark.parametrize("side", [1, -1])
def test_a_tree_above_the_end_of_a_line_is_no_wall(side: int) -> None:
    """A line that runs upright to the horizon of a bend, and a tree that begins in the same column beyond it."""
    image, row = CLEAR[:, ::side].copy(), round(CAMERA.horizon_row_px)
    image[row : row + 25, 214:217] = 230
    image[row - 16 : row + 1, 214:] = 30
    lane = arc(-side / 60.0)
    assert watch_frames(np.ascontiguousarray(image[:, ::side]), lane).cause == ""


@given(st.floats(10.0, 50.0), st.floats(-0.8, 0.8))
def test_the_mirror_image_has_the_same_end(ahead_m: float, left_m: float) -> None:
    finder = HiddenRoad(CAMERA.model_copy(update={"cx_px": 159.5}), SETTINGS.hidden)
    image = with_box(CLEAR, ahead_m, left_m=left_m)
    plain, mirrored = (finder.end(np.ascontiguousarray(one), path(None)) for one in (image, image[:, ::-1]))
    assert (plain is None) == (mirrored is None)
    if plain is not None and mirrored is not None:
        assert mirrored.distance_m == pytest.approx(plain.distance_m, rel=0.1)


def test_colour_shows_a_lorry_of_the_brightness_of_the_road() -> None:
    box = with_box(np.repeat(CLEAR[:, :, None], 3, axis=2), 25.0, colour=(150, 40, 130))
    assert watch_frames(box, arc(0.0)).cause == Cause.OCCLUDED


def test_without_a_sure_lane_or_a_known_horizon_nothing_is_hidden() -> None:
    image = with_box(CLEAR, 25.0)
    assert watch_frames(image, None).cause == ""
    assert watch_frames(image, arc(0.0, confidence=0.2)).cause == ""
    assert watch_frames(image, arc(0.0), assumed=True).cause == ""


@given(st.sampled_from([math.nan, math.inf, -math.inf, None, 0.0, 1e6, -1e6]))
def test_no_broken_lane_breaks_the_search(value: float | None) -> None:
    for field in ("lateral_offset_m", "heading_error_rad", "curvature_1pm", "curvature_rate_1pm2"):
        sight = watch_frames(with_box(CLEAR, 25.0), replace(arc(0.0), **{field: value}), frames=12)
        assert math.isfinite(sight.distance_m) and sight.distance_m > 0.0


def test_images_of_another_size_have_the_same_end() -> None:
    small = CAMERA.resize(160, 120)
    image = with_box(with_trees(misty(5000.0, camera=small), camera=small), 15.0, colour=200, camera=small)
    found = HiddenRoad(small, SETTINGS.hidden).end(image, path(None, small))
    assert found is not None and found.distance_m + CAMERA.x_m == pytest.approx(15.0, rel=0.2)


def path(lane: SteeringEstimate | None, camera: Camera = CAMERA) -> Path:
    return path_of(lane, camera.pixel_from_road_matrix, reach_m=300.0, known_m=30.0)


def last(ends: list[End | None], *, period_s: float = PERIOD_S) -> End | None:
    watch = HiddenWatch(SETTINGS.hidden)
    found = None
    for number, end in enumerate(ends):
        found = watch.step(end, number * period_s)
    return found


def test_most_frames_decide() -> None:
    end, other = End(30.0, 0.1), End(60.0, 0.1)
    assert last([end] * 12) == end
    assert last([end, end, None, end, end] * 3) == end
    assert last([None, end] * 8) is None
    assert last([*[end] * 10, other]) == end


def test_a_single_frame_and_frames_after_a_pause_decide_nothing() -> None:
    end = End(30.0, 0.1)
    assert last([end]) is None
    assert last([end] * 3) is None
    watch = HiddenWatch(SETTINGS.hidden)
    for number in range(12):
        watch.step(end, number * PERIOD_S)
    assert watch.step(end, 5.0) is None
    assert watch.step(end, 1.0) is None


@pytest.mark.parametrize("gap_m", [2.6, 3.2, 3.8])
@pytest.mark.parametrize("ahead_m", [16.0, 20.0, 24.0])
def test_the_road_between_two_parked_vehicles_hides_nothing(gap_m: float, ahead_m: float) -> None:
    below_px = np.arange(len(CLEAR)) - CAMERA.horizon_row_px
    lighter = np.where(below_px > 0, 45 * np.exp(-below_px / 4), 0.0)  # far ground, as it is before the sun
    image = (CLEAR + lighter[:, None]).clip(0, 255).astype(np.uint8)
    for side in (1, -1):
        image = with_box(image, ahead_m, left_m=side * (gap_m / 2 + 0.9), width_m=1.8, tall_m=2.2)
    assert watch_frames(image, arc(0.0)).cause != Cause.OCCLUDED


def test_a_lorry_beyond_a_gap_ends_the_sight() -> None:
    image = with_box(CLEAR, 40.0)
    for side in (1, -1):
        image = with_box(image, 24.0, left_m=side * 2.6, width_m=1.8, tall_m=2.2)
    assert watch_frames(image, arc(0.0)).cause == Cause.OCCLUDED
