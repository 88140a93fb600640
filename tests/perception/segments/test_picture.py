"""Masks drawn as a clean road: crests of lines, edges where the area is undecided."""

import numpy as np
import pytest

from perception.segments.network import Masks
from perception.segments.picture import AREA, REST, crests, draw_masks

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
    sure, unsure = (draw_masks(Masks(share * line(100.0, 5.0), None)) for share in (1.0, 0.5))
    steps = [int(one[0].max()) - 100 for one in (sure, unsure)]
    assert steps[0] == pytest.approx(2 * steps[1], rel=0.1)


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
