"""Masks drawn as a clean road: crests of lines, edges where the area is undecided."""

import numpy as np
import pytest

from perception.segments.network import Masks
from perception.segments.picture import (
    AREA,
    LINE,
    REST,
    crest_probability,
    crests,
    draw_masks,
    drivable_share,
)

ROWS, COLUMNS = 40, 320


def line(column: float, width: float) -> np.ndarray:
    """The mask of an upright line with soft sides."""
    across = 1 / (1 + np.exp((np.abs(np.arange(COLUMNS) - column) - width / 2) / 0.7))
    return np.tile(across.astype(np.float32), (ROWS, 1))


@pytest.mark.parametrize("width", [3.0, 6.0, 12.0])
@pytest.mark.parametrize("column", [60.0, 150.5, 200.0])
def test_the_crest_of_a_line_is_its_middle_whatever_its_width(width: float, column: float) -> None:
    painted = np.flatnonzero(crests(line(column, width))[0])
    assert painted.mean() == pytest.approx(column, abs=1.0) and len(painted) <= 2


def test_two_lines_have_two_crests_and_an_empty_mask_none() -> None:
    found = np.flatnonzero(crests(np.maximum(line(100.0, 5.0), line(116.0, 5.0)))[0])
    assert len(np.flatnonzero(np.diff(found) > 1)) == 1
    assert not crests(np.full((ROWS, COLUMNS), 0.15, np.float32)).any()


def test_a_crest_is_as_light_as_its_line_is_probable() -> None:
    middle = line(100.0, 5.0).max()
    for share in (1.0, 0.5, 0.05):
        picture = draw_masks(Masks(share * line(100.0, 5.0), None))
        lightness = (int(picture[0].max()) - AREA[0]) / (LINE[0] - AREA[0])
        probable = crest_probability(np.array([[share * middle]], np.float32))[0, 0]
        assert lightness == pytest.approx(probable, abs=0.01)


def test_a_crest_is_a_line_more_often_than_its_pixels_and_in_their_order() -> None:
    pixel = np.linspace(0, 1, 101, dtype=np.float32)[None]
    crest = crest_probability(pixel)[0]
    assert (np.diff(crest) > 0).all() and crest[0] < 0.01 and crest[-1] > 0.99
    assert crest[50] == pytest.approx(1 / (1 + np.exp(-1.5)), abs=1e-3)
    assert (crest[1:50] > pixel[0, 1:50]).all()


def test_a_faint_line_is_drawn_where_it_stands_out_and_a_level_mask_is_not() -> None:
    faint = draw_masks(Masks(0.02 * line(100.0, 5.0), None))
    assert int(faint[0, 98:103].max()) - AREA[0] > 40
    assert (draw_masks(Masks(np.full((ROWS, COLUMNS), 0.02, np.float32), None)) == AREA).all()


def test_the_edge_of_the_road_lies_where_its_probability_is_one_half() -> None:
    area = np.tile(np.clip((np.arange(COLUMNS, dtype=np.float32) - 100) / 40, 0, 1), (ROWS, 1))
    picture = draw_masks(Masks(None, area)).astype(int)
    middle = int(np.abs(picture[0] - (AREA + REST) / 2).sum(axis=1).argmin())
    assert middle == 120
    np.testing.assert_array_equal(picture[0, 10], REST)
    np.testing.assert_array_equal(picture[0, -10], AREA)


def test_without_an_area_everything_is_road() -> None:
    picture = draw_masks(Masks(np.zeros((ROWS, COLUMNS), np.float32), None))
    assert (picture == AREA.astype(np.uint8)).all()


def test_the_surface_of_a_lane_is_as_drivable_as_the_mean_of_its_pixels() -> None:
    left, right = ([(x, float(y)) for y in range(ROWS - 1, 9, -5)] for x in (110.0, 209.0))
    area = np.zeros((ROWS, COLUMNS), np.float32)
    area[:, 160:] = 0.8
    assert drivable_share(area, tuple(left), tuple(right)) == pytest.approx(0.4, abs=0.01)
    assert drivable_share(area[:, ::-1], tuple(left), tuple(right)) == pytest.approx(0.4, abs=0.01)
    assert drivable_share(area, (), tuple(right)) == 0.0


def test_only_rows_of_a_bonnet_are_left_out_of_the_surface_of_a_lane() -> None:
    left, right = ([(x, float(y)) for y in range(ROWS - 1, 9, -5)] for x in (110.0, 209.0))
    area = np.ones((ROWS, COLUMNS), np.float32)
    area[-10:] = 0.0  # a bonnet over a third of the lane
    assert drivable_share(area, tuple(left), tuple(right)) == 1.0
    area[:-10], area[-10:] = 0.0, 1.0  # a wall ahead
    assert drivable_share(area, tuple(left), tuple(right)) == pytest.approx(10 / 26)
    assert drivable_share(np.zeros_like(area), tuple(left), tuple(right)) == 0.0
