"""A crest is told from the horizon, from what lies on the ground, and from a road that falls evenly."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sight_rig import CAMERA, SETTINGS

from perception.sight.crest import CrestFinder, GroundEnd
from perception.sight.strip import path_of

HEIGHT_M, PERIOD_S = CAMERA.height_m, 0.04


def last_seen(
    ahead_m: Callable[[float], float | None], speed_mps: float | None, *, frames: int = 40
) -> float | None:
    """The sight at the end of a drive, with the end of the ground by the way driven."""
    finder = CrestFinder(SETTINGS.crest, HEIGHT_M)
    seen = None
    for number in range(frames):
        t_s = number * PERIOD_S
        seen = finder.step(ahead_m((speed_mps or 0.0) * t_s), speed_mps, t_s)
    return seen


def over_a_crest(radius_m: float, begins_m: float) -> Callable[[float], float]:
    """D of a crest that begins ``begins_m`` ahead: the flat ground in the row of the ray that touches the arc."""

    def ahead_m(way_m: float) -> float:
        before_m = max(begins_m - way_m, 0.0)
        slope = (math.sqrt(before_m**2 + 2 * radius_m * HEIGHT_M) - before_m) / radius_m
        return HEIGHT_M / slope

    return ahead_m


@given(st.floats(200, 800), st.floats(8, 20))
def test_on_a_crest_the_ray_that_touches_it_gives_the_sight(radius_m: float, speed_mps: float) -> None:
    assert last_seen(over_a_crest(radius_m, 0.0), speed_mps) == pytest.approx(
        math.sqrt(2 * radius_m * HEIGHT_M)
    )


@pytest.mark.parametrize("radius_m", [300.0, 500.0])
def test_just_before_a_crest_the_sight_ends_on_it(radius_m: float) -> None:
    speed_mps, frames = 12.0, 40
    begins_m = speed_mps * frames * PERIOD_S + 3.0
    left_m = begins_m - speed_mps * (frames - 1) * PERIOD_S
    seen_m = last_seen(over_a_crest(radius_m, begins_m), speed_mps, frames=frames)
    true_m = math.sqrt(left_m**2 + 2 * radius_m * HEIGHT_M)
    assert seen_m is not None and 0.8 * true_m < seen_m < 1.05 * true_m  # ρ is that of the last second


@given(st.floats(30, 60), st.floats(5, 25))
def test_what_lies_on_the_ground_is_no_crest(start_m: float, speed_mps: float) -> None:
    assert last_seen(lambda way_m: start_m - way_m if start_m - way_m > 5 else None, speed_mps) is None


@given(st.floats(300, 900), st.floats(8, 20))
def test_a_road_that_falls_evenly_behind_the_arc_is_no_crest(radius_m: float, speed_mps: float) -> None:
    rest_m = 0.95 * math.sqrt(2 * radius_m * HEIGHT_M)
    ends = lambda way_m: HEIGHT_M * radius_m / max(rest_m - way_m, 5.0)  # noqa: E731
    assert last_seen(ends, speed_mps) is None


@pytest.mark.parametrize("speed_mps", [None, math.nan, math.inf])
def test_without_a_speed_there_is_no_crest(speed_mps: float | None) -> None:
    assert last_seen(lambda _: 25.0, speed_mps) is None


def test_a_single_wrong_row_is_no_crest_and_hides_none() -> None:
    assert last_seen(lambda way_m: 20.0 if 7.9 < way_m < 8.3 else None, 10.0) is None
    crest = over_a_crest(400.0, 0.0)
    seen_m = last_seen(lambda way_m: 55.0 if 7.9 < way_m < 8.3 else crest(way_m), 10.0)
    assert seen_m == pytest.approx(math.sqrt(800 * HEIGHT_M), rel=0.03)


def test_a_time_that_steps_back_or_pauses_forgets_everything() -> None:
    finder = CrestFinder(SETTINGS.crest, HEIGHT_M)
    for number in range(40):
        found = finder.step(25.0, 10.0, number * PERIOD_S)
    assert found is not None
    assert finder.step(25.0, 10.0, 0.5) is None
    assert finder.step(25.0, 10.0, 9.0) is None


def ends_at(dip_px: float, *, seed: int = 0) -> np.ndarray:
    """Ground up to ``dip_px`` below the horizon, dark woods and a light sky above."""
    rng = np.random.default_rng(seed)
    rows = np.arange(CAMERA.height_px, dtype=float)[:, None] - CAMERA.horizon_row_px
    share = np.clip(rows - dip_px + 0.5, 0, 1)  # of ground in a row
    behind = np.where(rows > dip_px - 12, 40.0, 200.0)
    image = share * 110 + (1 - share) * behind + rng.normal(0, 4, (CAMERA.height_px, CAMERA.width_px))
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("dip_px", [6.0, 9.0, 13.0, 18.0])
def test_the_row_in_which_the_ground_ends_is_that_of_flat_ground_at_its_distance(dip_px: float) -> None:
    path = path_of(None, CAMERA.pixel_from_road_matrix, reach_m=300.0, known_m=30.0)
    found_m = GroundEnd(CAMERA, SETTINGS.crest).ahead_m(ends_at(dip_px), path)
    row = CAMERA.horizon_row_px + dip_px
    flat_m = CAMERA.road_from_pixel([(CAMERA.cx_px, row)])[0, 0] - CAMERA.x_m
    assert found_m == pytest.approx(flat_m, rel=0.12)


@pytest.mark.parametrize("dip_px", [6.0, 13.0])
def test_ground_ends_where_only_its_colour_does(dip_px: float) -> None:
    """Grass before blue hills of the same brightness."""
    weights = np.array([0.114, 0.587, 0.299])  # of blue, green, red in grey
    grass, hills = np.array([60.0, 120.0, 110.0]), np.array([150.0, 105.0, 105.0])
    hills *= (weights @ grass) / (weights @ hills)
    rows = np.arange(CAMERA.height_px)[:, None, None] - CAMERA.horizon_row_px
    noise = np.random.default_rng(3).normal(0, 3, (CAMERA.height_px, CAMERA.width_px, 1))
    image = np.clip(np.where(rows > dip_px, grass, hills) + noise, 0, 255).astype(np.uint8)
    path = path_of(None, CAMERA.pixel_from_road_matrix, reach_m=300.0, known_m=30.0)
    ground_end = GroundEnd(CAMERA, SETTINGS.crest)
    flat_m = CAMERA.road_from_pixel([(CAMERA.cx_px, CAMERA.horizon_row_px + dip_px)])[0, 0] - CAMERA.x_m
    assert ground_end.ahead_m(image, path) == pytest.approx(flat_m, rel=0.12)
    grey = image @ weights
    assert ground_end.ahead_m(grey.astype(np.uint8), path) is None


def test_a_crest_that_is_no_longer_found_counts_for_a_moment() -> None:
    finder, crest = CrestFinder(SETTINGS.crest, HEIGHT_M), over_a_crest(400.0, 0.0)
    true_m = math.sqrt(800 * HEIGHT_M)
    seen_m = {}
    for number in range(100):
        t_s = number * PERIOD_S
        seen_m[number] = finder.step(crest(10.0 * t_s) if number < 40 else None, 10.0, t_s)
    shown = [number for number, at_m in seen_m.items() if number >= 40 and at_m is not None]
    assert [seen_m[number] for number in shown] == pytest.approx([true_m] * len(shown))
    lasts_s = (max(shown) - 39) * PERIOD_S
    assert SETTINGS.crest.memory_s <= lasts_s <= 2 * SETTINGS.crest.memory_s


def test_a_car_that_stands_before_a_crest_does_not_forget_it() -> None:
    finder, crest = CrestFinder(SETTINGS.crest, HEIGHT_M), over_a_crest(400.0, 0.0)
    way_m = 0.0
    for number in range(1000):
        speed_mps = max(10.0 - 0.2 * number, 0.0)
        way_m += speed_mps * PERIOD_S
        seen_m = finder.step(crest(way_m), speed_mps, number * PERIOD_S)
    assert seen_m == pytest.approx(math.sqrt(800 * HEIGHT_M), rel=0.2)  # a slow approach leaves what is usual


def test_a_shadow_across_road_and_verges_is_no_end_of_the_ground() -> None:
    image = ends_at(0.5).astype(float)
    horizon = CAMERA.horizon_row_px
    image[round(horizon + 9) : round(horizon + 13)] *= 0.5
    path = path_of(None, CAMERA.pixel_from_road_matrix, reach_m=300.0, known_m=30.0)
    assert GroundEnd(CAMERA, SETTINGS.crest).ahead_m(image.astype(np.uint8), path) is None


@given(st.floats(0.5, 0.75), st.floats(30, 45))
def test_far_before_a_crest_a_coarse_row_leaves_what_is_usual(closing: float, start_m: float) -> None:
    """Rows of whole pixels, as the image has them, in a slow approach."""
    row_rad = 1 / CAMERA.fy_px

    def rows(way_m: float) -> float:
        return HEIGHT_M / (round(HEIGHT_M / (start_m - closing * way_m) / row_rad) * row_rad)

    seen_m = last_seen(rows, 6.0)
    end_m = start_m - closing * 6.0 * 39 * PERIOD_S
    assert seen_m is None or 0.9 * end_m / 0.75 < seen_m < 1.1 * end_m / 0.5


def test_ground_up_to_the_horizon_has_no_end() -> None:
    path = path_of(None, CAMERA.pixel_from_road_matrix, reach_m=300.0, known_m=30.0)
    for seed in range(5):
        assert GroundEnd(CAMERA, SETTINGS.crest).ahead_m(ends_at(0.5, seed=seed), path) is None
