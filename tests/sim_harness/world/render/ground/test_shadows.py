"""Shadows of trees, buildings and bridges: dark, sharp, growing with their share, only in their section."""

import numpy as np
import pytest
from painted_road import bare, plan, straight

from sim_harness.world.render.ground.shadows import Shadows
from sim_harness.world.render.ground.strip_grid import PIXEL_M, ROWS, Grid
from sim_harness.world.roads.road import Road

KINDS = ("shadows", "building_shadows", "bridge_shadows")
GRID = Grid()


def shade(road: Road, *, blocks: int = 4) -> np.ndarray:
    """Shade (rows, columns) of the first blocks of a road, on its lane."""
    shadows = Shadows(road, GRID, np.random.default_rng(1), seed=1)
    stations = [(index * ROWS + np.arange(ROWS) + 0.5) * PIXEL_M for index in range(blocks)]
    lit = np.full((ROWS, GRID.columns), 255)
    shades = [shadows.shade(index, station) for index, station in enumerate(stations)]
    lane = GRID.columns_between(-1.7, 1.7)
    return np.vstack([lit if part is None else part for part in shades])[:, lane]


@pytest.mark.parametrize("kind", KINDS)
def test_shadows_grow_with_their_share_from_none_at_0(kind):
    dark = [(shade(straight(bare(**{kind: share}))) < 150).mean() for share in (0.0, 0.4, 1.0)]
    assert dark[0] == 0 and 0.02 < dark[1] < dark[2] <= 1.0


@pytest.mark.parametrize("kind", KINDS)
def test_a_shadow_darkens_the_ground_at_its_place(kind):
    lit, shaded = (
        plan(straight(bare(**{kind: share})), 15, 40, right_m=-1.7, left_m=1.7) for share in (0.0, 1.0)
    )
    ratio = shaded.bgr.mean(axis=2) / lit.bgr.mean(axis=2)
    assert np.percentile(ratio, 2) == pytest.approx(0.38, abs=0.05) and (ratio < 0.5).mean() > 0.05


def test_shadows_of_houses_come_from_the_right():
    across = (shade(straight(bare(building_shadows=0.5))) < 150).mean(axis=0)
    assert across[:20].mean() > 0.6 and across[-20:].mean() < 0.45


def test_a_bridge_shadow_crosses_the_whole_road_about_every_fifty_metres():
    dark = shade(straight(bare(bridge_shadows=0.5), length_m=410), blocks=15) < 150
    starts = np.flatnonzero(np.diff(dark[:, dark.shape[1] // 2].astype(int)) == 1) * PIXEL_M
    assert 7 <= len(starts) <= 8 and np.diff(starts).min() > 29 and np.diff(starts).max() < 71
    assert dark.mean(axis=0) == pytest.approx(dark.mean(), abs=0.02)


@pytest.mark.parametrize("kind", KINDS)
def test_a_shadow_does_not_reach_back_into_the_previous_section(kind):
    seen = shade(straight(bare(), bare("dark", 60, **{kind: 1.0})))
    start = round(60 / PIXEL_M)
    assert (seen[:start] == 255).all() and (seen[start:] < 150).any()
