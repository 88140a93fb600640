"""The second evaluation of OpenDRIVE lanes: closed forms, and what counts as imported, close, tight and cut."""

import math
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from lab.bench.foreign.opendrive import apart_m, centre, count_lanes, length_m, sharpest_1pm

ARC = '<arc curvature="0.02"/>'


def write_road(
    path: Path, shape: str, *, width: str = 'a="3.5" b="0" c="0" d="0"', long_m: float = 60.0
) -> Path:
    path.write_text(
        f'<OpenDRIVE><road id="1" length="{long_m}"><planView><geometry s="0" x="3" y="4" hdg="0.5"'
        f' length="{long_m}">{shape}</geometry></planView><lanes><laneSection s="0"><center>'
        '<lane id="0" type="none"/></center><right><lane id="-1" type="driving">'
        f'<width sOffset="0" {width}/></lane></right></laneSection></lanes></road></OpenDRIVE>'
    )
    return path


def middle(path: Path) -> np.ndarray:
    return centre(etree.parse(str(path)).getroot().find("road"), -1)


def test_the_centre_of_a_lane_along_an_arc_is_an_arc_of_another_radius(tmp_path: Path) -> None:
    line = middle(write_road(tmp_path / "a.xodr", ARC))
    pivot = np.array([3.0, 4.0]) + 50.0 * np.array([-math.sin(0.5), math.cos(0.5)])
    assert np.hypot(*(line - pivot).T) == pytest.approx(50.0 + 1.75, abs=1e-4)
    assert length_m(line) == pytest.approx(60.0 * (1 + 0.02 * 1.75), rel=1e-5)
    assert sharpest_1pm(line) == pytest.approx(1 / 51.75, rel=1e-2)


@pytest.mark.parametrize(
    "shape",
    [
        '<line/>',
        ARC,
        '<spiral curvStart="0" curvEnd="0.03"/>',
        '<paramPoly3 pRange="normalized" aU="0" bU="60" cU="0" dU="0" aV="0" bV="0" cV="6" dV="-4"/>',
    ],
)  # fmt: skip
def test_an_imported_lane_lies_on_its_evaluation(tmp_path: Path, shape: str) -> None:
    found = count_lanes(write_road(tmp_path / "a.xodr", shape))
    assert (found["lanes"], found["imported"], found["close"], found["cut"]) == (1, 1, 1, 0)


def test_a_lane_that_closes_is_cut_and_still_close(tmp_path: Path) -> None:
    found = count_lanes(write_road(tmp_path / "a.xodr", ARC, width='a="3.5" b="-0.0583333" c="0" d="0"'))
    assert (found["imported"], found["cut"], found["close"]) == (1, 1, 1)


def test_a_lane_that_bends_within_a_metre_is_refused_and_tight(tmp_path: Path) -> None:
    found = count_lanes(write_road(tmp_path / "a.xodr", '<arc curvature="-0.5"/>', long_m=3.0))
    assert (found["lanes"], found["imported"], found["refused"], found["tight"]) == (1, 0, 1, 1)


def test_lines_are_compared_wherever_they_lie_and_a_bulge_is_seen() -> None:
    x = np.linspace(0.0, 50.0, 500)
    line = np.column_stack([x, 0.01 * x**2])
    turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    assert apart_m(line, line @ turn + [7.0, -3.0]) < 1e-9
    bulged = line + np.column_stack([0 * x, 0.05 * np.exp(-(((x - 25.0) / 2.0) ** 2))])
    assert 0.03 < apart_m(line, bulged) < 0.06
    assert apart_m(line, line * [1.0, -1.0]) > 0.5, "a mirror image is another lane"
