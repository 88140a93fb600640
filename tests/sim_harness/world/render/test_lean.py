"""Banked roads in the image: level where the bank is even, twisted where it changes, below a tilted horizon."""

import math

import cv2
import numpy as np
import pytest

from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.relief import BankedRelief, Relief, between_columns
from sim_harness.world.roads.appearance import Light, Section
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint
from sim_harness.world.roads.features import RoadMark
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
PLAIN = Light(noise=0)
HERE_M = 100.0


def road(*bank: tuple[float, float], **features: object) -> Road:
    look = {"name": "plain", "closed": False, "lane_width_m": 3.4}
    points = tuple(BankPoint(at_m=at_m, bank_rad=bank_rad) for at_m, bank_rad in bank)
    sections = (Section(name="plain", start_m=0, patchiness=0),)
    segments = (Segment(length_m=500),)
    return Road(RoadSettings(**look, sections=sections, segments=segments, bank=points, **features))


def frame(on: Road, *, camera: Camera = CAMERA, offset_m: float = 0.0) -> np.ndarray:
    renderer = Renderer(on, camera, seed=3)
    return renderer.render(HERE_M, offset_m, 0.0, t_s=1.0, station_m=HERE_M, light=PLAIN)


def places_ahead_m(relief: Relief, rows: np.ndarray) -> np.ndarray:
    """Distance ahead of the lens of the ground in every pixel of rows, NaN above it."""
    seen = 1 / between_columns(relief.nearness_1pm(rows), relief.width_px)
    seen[rows[:, None] < between_columns(relief.tops[None], relief.width_px)] = np.nan
    return seen


def pixel_of(ahead_m: float, left_m: float, up_m: float) -> tuple[float, float]:
    """Column and row of a point in the axes of the vehicle."""
    place = np.array([ahead_m - CAMERA.x_m, left_m - CAMERA.y_m, up_m - CAMERA.height_m])
    right, down, depth = CAMERA.optical_from_vehicle @ place
    return CAMERA.cx_px + CAMERA.fx_px * right / depth, CAMERA.cy_px + CAMERA.fy_px * down / depth


def test_on_an_even_bank_the_carriageway_looks_as_on_level_ground():
    """The vehicle leans with the road."""
    level, leaning = (cv2.cvtColor(frame(road(*bank)), cv2.COLOR_BGR2GRAY) for bank in ([], [(0.0, 0.06)]))
    part = np.s_[140:, 60:280]
    assert np.abs(level[part].astype(float) - leaning[part]).mean() < 2.5
    assert np.corrcoef(level[part].ravel(), leaning[part].ravel())[0, 1] > 0.95


@pytest.mark.parametrize("left_m", [-3.0, 0.0, 3.0])
def test_where_the_road_rolls_a_place_lies_in_the_row_of_its_height(left_m):
    """The bank rises from 0 to 0.1 between 5 and 35 m ahead: a place is t·tan φ above the plane of the vehicle."""
    twisted = road((HERE_M + 5, 0.0), (HERE_M + 35, 0.1))
    relief = BankedRelief(twisted, CAMERA, HERE_M, (HERE_M, 0.0, 0.0))
    for ahead_m in (12.0, 20.0, 30.0, 45.0):
        up_m = left_m * math.tan(twisted.bank_at(HERE_M + ahead_m))
        column, row = pixel_of(ahead_m, left_m, up_m)
        found_m = places_ahead_m(relief, np.array([row]))[0, round(column)]
        assert found_m == pytest.approx(ahead_m - CAMERA.x_m, rel=0.02)
        assert relief.lift_at(ahead_m, left_m) == pytest.approx(up_m, abs=2e-3)


def test_a_stop_line_beyond_a_roll_is_drawn_where_its_ends_lie():
    at_m, mark = HERE_M + 14.0, RoadMark(kind="stop_line", at_m=HERE_M + 14.0, length_m=0.6)
    profile = ((HERE_M + 2, 0.0), (HERE_M + 12, 0.1))
    bare, marked = (frame(road(*profile, marks=marks)).astype(float) for marks in ((), (mark,)))
    change = np.abs(marked - bare).sum(axis=2)
    for left_m in (-1.2, 1.2):
        column, row = pixel_of(at_m + 0.3 - HERE_M, left_m, left_m * math.tan(0.1))
        weights = change[:, round(column) - 2 : round(column) + 3].sum(axis=1)
        assert float((weights * np.arange(len(weights))).sum() / weights.sum()) == pytest.approx(row, abs=0.7)


def test_the_horizon_tilts_by_the_bank():
    relief = BankedRelief(road((0.0, 0.06)), CAMERA, HERE_M, (HERE_M, 0.0, 0.0))
    fall = np.polyfit(np.arange(CAMERA.width_px), relief.horizon_row, 1)[0]
    assert math.atan(fall) == pytest.approx(
        -0.06, abs=0.003
    )  # lower on the left, the higher side of the road


def test_banks_to_either_side_are_mirror_images():
    camera = CAMERA.model_copy(update={"cx_px": (CAMERA.width_px - 1) / 2, "y_m": 0.0, "yaw_rad": 0.0})
    rows = np.arange(camera.height_px, dtype=float)
    found = []
    for side in (1, -1):
        profile = ((HERE_M, 0.02 * side), (HERE_M + 30, -0.08 * side))
        relief = BankedRelief(road(*profile), camera, HERE_M, (HERE_M, 0.5 * side, 0.02 * side))
        found.append(places_ahead_m(relief, rows))
    left, right = found[0], found[1][:, ::-1]
    assert np.isfinite(left).mean() > 0.5
    np.testing.assert_allclose(left, right, rtol=1e-4)


def test_a_bank_of_zero_shows_the_hill_alone():
    hill = (ElevationPoint(at_m=90, grade=0.05), ElevationPoint(at_m=150, grade=-0.05))
    pose, rows = (HERE_M, 0.3, 0.02), np.arange(CAMERA.height_px, dtype=float)
    plain = places_ahead_m(Relief(road(elevation=hill), CAMERA, HERE_M, pose), rows)
    banked = places_ahead_m(BankedRelief(road((0.0, 0.0), elevation=hill), CAMERA, HERE_M, pose), rows)
    np.testing.assert_allclose(plain, banked, rtol=1e-4)


def test_a_bank_of_zero_does_not_change_the_picture_of_a_hill():
    hill = (ElevationPoint(at_m=90, grade=0.05), ElevationPoint(at_m=150, grade=-0.05))
    plain, banked = (
        frame(road(*bank, elevation=hill), offset_m=0.4).astype(int) for bank in ([], [(0.0, 0.0)])
    )
    assert np.abs(plain - banked).max() <= 2


def test_a_bank_of_zero_on_level_ground_shows_the_flat_road():
    """By another projection; the lines of paint lie in the same columns within 0.3 px."""
    rows = np.s_[125:235:10]
    flat, banked = (cv2.cvtColor(frame(road(*bank)), cv2.COLOR_BGR2GRAY) for bank in ([], [(0.0, 0.0)]))
    assert np.abs(flat[110:].astype(float) - banked[110:]).mean() < 1.5
    for side in (np.s_[:160], np.s_[160:]):
        light = [np.clip(of[rows].astype(float)[:, side] - 150, 0, None) for of in (flat, banked)]
        assert all(of.any() for of in light)
        middle = [(of * np.arange(160)).sum(axis=1) / np.maximum(of.sum(axis=1), 1) for of in light]
        np.testing.assert_allclose(*middle, atol=0.3)


def test_equal_seeds_give_equal_pictures_of_banked_roads():
    first, second = (frame(road((0.0, 0.0), (150.0, 0.06)), offset_m=0.4) for _ in range(2))
    assert np.array_equal(first, second)
