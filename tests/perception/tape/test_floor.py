"""Lines of tape on drawn floors: place and direction in every direction, colours, and what is no line."""

import math

import cv2
import numpy as np
import pytest

from perception.tape.floor import FloorRaster, TapePoints, VotingPoints
from perception.tape.memory import LineMemory, thin
from perception.tape.settings import TapeSettings
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "tape.yaml", TapeSettings)
CAMERA = Camera(
    width_px=320,
    height_px=240,
    fx_px=160.0,
    fy_px=160.0,
    cx_px=160.0,
    cy_px=120.0,
    x_m=1.0,
    y_m=0.0,
    height_m=1.5,
    pitch_down_rad=0.25,
    yaw_rad=0.0,
)
LINE_M = 0.36
FINE = 8  # the image is drawn so many times larger and then reduced


def floor_with(
    *patches: tuple[np.ndarray, tuple[int, int, int]],
    floor: tuple[int, int, int] = (120, 120, 120),
    seed: int = 0,
) -> np.ndarray:
    """An image of a floor with polygons of road points (n, 2) [m] in colours, and sensor noise."""
    large = CAMERA.resize(FINE * CAMERA.width_px, FINE * CAMERA.height_px)
    image = np.full((large.height_px, large.width_px, 3), floor, np.uint8)
    for road_m, colour in patches:
        pixels = large.pixel_from_road(road_m)
        assert np.isfinite(pixels).all()
        cv2.fillPoly(image, [np.round(pixels).astype(np.int32)], colour)
    image[: round(large.horizon_row_px)] = (210, 200, 190)
    small = cv2.resize(image, (CAMERA.width_px, CAMERA.height_px), interpolation=cv2.INTER_AREA)
    noise = np.random.default_rng(seed).normal(0, 2, small.shape)
    return np.clip(small + noise, 0, 255).astype(np.uint8)


def strip(middle: complex, course_rad: float, length_m: float = 2.0, width_m: float = LINE_M) -> np.ndarray:
    along, across = np.exp(1j * course_rad) * length_m / 2, 1j * np.exp(1j * course_rad) * width_m / 2
    corners = middle + np.array([along + across, along - across, -along - across, -along + across])
    return np.column_stack([corners.real, corners.imag])


RASTER = FloorRaster(CAMERA, SETTINGS.floor, (LINE_M,))


@pytest.mark.parametrize("course_deg", [0, 30, 60, 90, 120, 150])
def test_a_line_is_found_at_its_place_in_every_direction(course_deg: int) -> None:
    course_rad, middle = math.radians(course_deg), 4.5 + 0.4j
    found = RASTER.points(floor_with((strip(middle, course_rad), (225, 225, 225))))
    at = (found.x_m + 1j * found.y_m - middle) * np.exp(-1j * course_rad)
    inner = np.abs(at.real) < 0.7
    assert np.count_nonzero(inner) >= 8
    assert np.abs(at.imag[inner]).max() < 0.12
    assert np.abs(np.sin(found.course_rad[inner] - course_rad)).mean() < 0.15


@pytest.mark.parametrize(
    ("floor", "tape"),
    [
        ((50, 50, 50), (225, 225, 225)),
        ((52, 50, 50), (62, 178, 226)),
        ((84, 124, 162), (168, 96, 34)),
        ((180, 185, 188), (38, 36, 36)),
        ((84, 124, 162), (38, 36, 36)),
        ((120, 120, 120), (210, 105, 60)),  # blue tape as light as the floor
    ],
)
def test_tape_is_found_by_its_light_or_by_its_colour(
    floor: tuple[int, int, int], tape: tuple[int, int, int]
) -> None:
    found = RASTER.points(floor_with((strip(4.5 + 0j, 0.4), tape), floor=floor))
    at = (found.x_m + 1j * found.y_m - 4.5) * np.exp(-0.4j)
    inside = (np.abs(at.real) < 1.1) & (np.abs(at.imag) < 0.3)
    assert np.count_nonzero(inside) >= 8
    assert np.count_nonzero(~inside) <= 0.2 * np.count_nonzero(inside)


def test_the_edge_of_a_patch_of_light_is_no_line_but_at_its_corners() -> None:
    patch = np.array([[3.0, -2.0], [3.0, 2.0], [7.0, 2.5], [7.0, -2.5]])
    found = RASTER.points(floor_with((patch, (220, 220, 220))))
    apart = np.abs((found.x_m + 1j * found.y_m)[:, None] - patch @ [1, 1j]).min(axis=1)
    assert np.count_nonzero(apart > 0.6) <= 2


@pytest.mark.parametrize("sign", [1, -1])
def test_with_two_widths_a_wide_edge_is_found_and_a_narrow_line_counts_once(
    sign: int,
) -> None:
    both = FloorRaster(CAMERA, SETTINGS.floor, (LINE_M, 2 * LINE_M))
    wide, narrow = strip(5.5 - sign * 1.4j, 0.0, 4.0, 2 * LINE_M), strip(5.5 + sign * 1.4j, 0.0, 4.0)
    image = floor_with((wide, (225, 225, 225)), (narrow, (62, 178, 226)))
    found, alone = both.points(image), RASTER.points(image)
    near, near_alone = (np.abs(one.x_m - 5.5) < 1.2 for one in (found, alone))
    on_wide = near & (np.abs(found.y_m + sign * 1.4) < 0.15)
    assert len(np.unique(np.rint(found.x_m[on_wide] / SETTINGS.floor.cell_m))) >= 24
    beside, beside_alone = (
        np.count_nonzero(part & (np.abs(one.y_m - sign * 1.4) < 2 * LINE_M))
        for one, part in ((found, near), (alone, near_alone))
    )
    assert beside_alone >= 24 and beside <= 1.1 * beside_alone


def test_a_streak_on_a_wide_line_is_no_line_of_its_own() -> None:
    both = FloorRaster(CAMERA, SETTINGS.floor, (LINE_M, 2 * LINE_M))
    wide, streak = strip(5.5 + 0j, 0.0, 4.0, 2 * LINE_M), strip(5.5 - 0.2j, 0.0, 4.0, LINE_M / 2)
    found = both.points(floor_with((wide, (200, 200, 200)), (streak, (216, 216, 216))))
    near = (np.abs(found.x_m - 5.5) < 1.2) & (np.abs(found.y_m) < LINE_M)
    assert np.count_nonzero(near) >= 24
    assert np.median(found.size[near]) > 60 and np.abs(np.median(found.y_m[near])) < 0.1


def test_a_line_much_fainter_than_the_others_hardly_counts() -> None:
    contrast = np.zeros((20, 3))
    contrast[:, 0] = [-100.0] * 10 + [90.0] * 8 + [-20.0, 12.0]
    zero = np.zeros(20)
    points = TapePoints(zero, zero, zero, contrast, np.ones(20), zero)
    weight = VotingPoints.of(points, SETTINGS.lane).left
    assert weight[:18].min() > 0.9 and weight[18:].max() < 0.2
    faint = points._replace(contrast=0.15 * contrast)
    assert VotingPoints.of(faint, SETTINGS.lane).left == pytest.approx(weight)


def test_a_bare_floor_has_no_line() -> None:
    both = FloorRaster(CAMERA, SETTINGS.floor, (LINE_M, 2 * LINE_M))
    assert len(RASTER.points(floor_with(seed=3)).x_m) <= 3
    assert len(both.points(floor_with(seed=3)).x_m) <= 5


def test_lines_beside_the_image_are_remembered_and_move_with_the_car() -> None:
    memory = LineMemory(SETTINGS.memory)
    seen = memory.update(RASTER.points(floor_with((strip(4.0 - 1.2j, 0.0, 3.0), (225, 225, 225)))), RASTER)
    places = seen.x_m + 1j * seen.y_m
    blank = floor_with()
    for _ in range(10):  # an arc of 3 m that turns by 0.5 rad
        memory.move(0.3, 0.05)
        now = memory.update(RASTER.points(blank), RASTER)
    along = 3.0 * math.sin(0.25) / 0.25 * np.exp(0.25j)  # chord of the arc
    expected = (places - along) * np.exp(-0.5j)
    old = now.where(now.way_m > 2.9)
    assert len(old.x_m) >= 5
    apart = np.abs((old.x_m + 1j * old.y_m)[:, None] - expected).min(axis=1)
    assert apart.max() < 0.02  # ten chords for one arc


def test_a_line_too_wide_to_be_found_at_the_edge_of_the_image_is_remembered_there() -> None:
    both = FloorRaster(CAMERA, SETTINGS.floor, (LINE_M, 2 * LINE_M))
    at_m = np.arange(both.x_m[0], 9.0, 0.2)
    edge_m = np.full(len(at_m), 1.0) * np.interp(at_m, [both.x_m[0], 9.0], [0.5, 5.5])
    narrow, wide = (both.sees(at_m, edge_m, np.full(len(at_m), line_m)) for line_m in both.lines_m)
    margin = narrow & ~wide  # a narrow line is found in these places, a wide one is not
    assert margin.any() and not (wide & ~narrow).any()
    memory, count = LineMemory(SETTINGS.memory), np.count_nonzero(margin)
    seen = TapePoints(
        at_m[margin] + 0.3,
        edge_m[margin],
        np.zeros(count),
        np.full((count, 3), 50.0),
        np.resize(both.lines_m, count),
        np.zeros(count),
    )
    memory.update(seen, both)
    memory.move(0.3, 0.0)
    kept = memory.update(both.points(floor_with()), both)
    assert len(kept.x_m) and set(kept.line_m) == {2 * LINE_M}


def test_lines_of_long_ago_are_forgotten() -> None:
    memory = LineMemory(SETTINGS.memory)
    memory.update(RASTER.points(floor_with((strip(3.5 + 0j, 0.0), (225, 225, 225)))), RASTER)
    memory.move(SETTINGS.memory.keep_m + 0.1, 6.0)
    assert not len(memory.points.x_m)


def test_points_are_thinned_to_one_in_a_square() -> None:
    found = RASTER.points(floor_with((strip(4.0 + 0j, 0.3), (225, 225, 225))))
    kept = thin(found)
    assert 5 <= len(kept.x_m) < len(found.x_m)
    apart = np.abs((kept.x_m + 1j * kept.y_m)[:, None] - (found.x_m + 1j * found.y_m)).min(axis=0)
    assert apart.max() < 0.25
