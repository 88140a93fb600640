"""Snow, water, broken edges, kerbs and bridges on the carriageway."""

import gc
import weakref

import numpy as np
import pytest
from painted_road import WIDTH_M, bare, plan, straight

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Marking, Surface, Verge

EDGE_M = WIDTH_M / 2 + 0.3
SNOW = {"verge": Verge.SNOW}


def paved_width_m(seed: int = 0, **section) -> np.ndarray:
    """Width of the dark carriageway in snow at every station."""
    return (plan(straight(bare(**SNOW | section)), to_m=90, seed=seed).bgr.max(axis=2) < 140).sum(
        axis=0
    ) * 0.025


def test_a_bank_of_snow_has_its_width_and_a_ragged_rim():
    seen = plan(straight(bare(snow_right_m=0.8, **SNOW)), to_m=70, from_m=15)
    dark = seen.dark()
    right = np.array([seen.y_m[column].min() for column in dark.T])
    left = np.array([seen.y_m[column].max() for column in dark.T])
    assert right.mean() == pytest.approx(-EDGE_M + 0.8, abs=0.2) and right.std() > 0.15
    assert left == pytest.approx(EDGE_M, abs=0.16)


def test_snow_hides_the_line_under_it():
    line = Marking(width_m=0.15)
    road = straight(bare(right=line, snow_right_m=1.0, surface_grey=0.3, **SNOW))
    strip = plan(road, 15, 60)
    just_inside = strip.bgr[strip.row(-WIDTH_M / 2 + 0.15)].min(axis=1)
    assert (just_inside > 150).mean() > 0.5


def test_trodden_snow_covers_about_its_share_and_less_in_wheel_tracks():
    for cover in (0.2, 0.5, 0.8):
        seen = plan(straight(bare(snow_cover=cover, **SNOW)), 0, 70, right_m=-1.9, left_m=1.9)
        white = seen.bgr.min(axis=2) > 140
        assert white.mean() == pytest.approx(cover, abs=0.2)
        tracks = [white[seen.row(y)].mean() for y in (-0.75, 0.75)]
        assert np.mean(tracks) < white.mean()


def test_broken_edges_change_only_the_edge():
    sound, few, many = (paved_width_m(edge_breaks=share) for share in (0.0, 0.2, 0.7))
    assert sound == pytest.approx(2 * EDGE_M, abs=0.2)
    assert (few < sound - 0.1).mean() < (
        many < sound - 0.1
    ).mean() and many.mean() < few.mean() < sound.mean()
    assert many.min() > 2 * (EDGE_M - 0.6) - 0.15 and (few > 2 * EDGE_M - 0.1).mean() > 0.4


def test_a_seam_is_a_dark_line_along_the_road_at_its_place():
    bare_road, seamed = (
        plan(straight(bare(surface_grey=0.5, seams_m=seams_m)), 15, 60) for seams_m in ((), (0.8,))
    )
    brightness = seamed.bgr.mean(axis=(1, 2)) / bare_road.bgr.mean(axis=(1, 2))
    dark = np.flatnonzero(brightness < 0.9)
    assert seamed.y_m[dark] == pytest.approx(0.8, abs=0.05)
    assert 1 <= len(dark) <= 4
    assert np.delete(brightness, range(dark[0] - 3, dark[-1] + 4)) == pytest.approx(1.0, abs=0.01)


def test_only_a_wet_road_is_darker_and_has_puddles():
    dry, wet = (plan(straight(bare(wet=wet)), 15, 60, right_m=-1.9, left_m=1.9) for wet in (0.0, 1.0))
    ratio = np.median(wet.bgr) / np.median(dry.bgr)
    assert ratio == pytest.approx(0.62, abs=0.05)
    assert 0.01 < (wet.bgr.min(axis=2) > 110).mean() < 0.3
    half = plan(straight(bare(), bare("wet", 50, wet=1.0)), 0, 49)
    assert np.array_equal(half.bgr, plan(straight(bare(), bare("wet", 50)), 0, 49).bgr)


def test_a_bridge_has_a_parapet_and_water_on_both_sides():
    deck = bare(kerb_m=0.5, surface=Surface.CONCRETE, verge=Verge.WATER)
    seen = plan(straight(deck), 10, 30, right_m=-4, left_m=4)
    for side in (-1, 1):
        parapet = seen.bgr[seen.row(side * (EDGE_M + 0.25))]
        water = seen.bgr[seen.row(side * (EDGE_M + 1.2))]
        assert np.median(parapet) > 150
        assert water[:, 0].mean() > water[:, 2].mean() + 10 and water.mean() < 130


def test_the_carriageway_of_a_wide_road_is_painted_to_its_edges():
    lanes = tuple({"width_m": 3.5} for _ in range(3))
    road = straight(bare(left_lanes=lanes, right_lanes=lanes, **SNOW))
    seen = plan(road, 10, 20, right_m=-14, left_m=14)
    dark = (seen.bgr.max(axis=2) < 140).mean(axis=1) > 0.5
    assert seen.y_m[dark][[0, -1]] == pytest.approx([-EDGE_M - 10.5, EDGE_M + 10.5], abs=0.06)


@pytest.mark.parametrize("name", ["town", "winter"])
def test_equal_seeds_paint_equal_bytes_in_any_order(name):
    road = load_road(name)
    places = [np.array(road.position(s, 0.0)) for s in (115.0, road.length_m - 30)]
    one, other = Ground(road, seed=5), Ground(road, seed=5)
    forwards = [one.crop(1, place - 6, place + 6)[0] for place in places]
    backwards = [other.crop(1, place - 6, place + 6)[0] for place in reversed(places)]
    assert all(np.array_equal(a, b) for a, b in zip(forwards, reversed(backwards), strict=True))
    assert not np.array_equal(forwards[0], Ground(road, seed=6).crop(1, places[0] - 6, places[0] + 6)[0])


def test_painted_tiles_are_freed_with_their_ground_without_a_garbage_collection():
    ground = Ground(load_road("town"), seed=5)
    ground.crop(1, np.array([0.0, -6.0]), np.array([12.0, 6.0]))
    gone = weakref.ref(ground)
    tiles = weakref.ref(ground._tiles[1]._tiles[next(iter(ground._tiles[1]._tiles))])
    gc.disable()
    try:
        del ground
        assert gone() is None and tiles() is None
    finally:
        gc.enable()
