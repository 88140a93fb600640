"""Arrows, letters, zebra crossings and stop lines have the place and direction of their settings."""

from functools import cache

import cv2
import numpy as np
import pytest
from painted_road import WIDTH_M, bare, centres_m, lengths_m, plan, straight
from pydantic import ValidationError

from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.appearance import Light, NeighbourLane, Paint
from sim_harness.world.roads.features import MarkKind
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

LANES = bare(left_lanes=(NeighbourLane(width_m=3.0),), right_lanes=(NeighbourLane(width_m=2.8),))
HALF_M = WIDTH_M / 2


@cache
def painted_pixels(**mark) -> tuple[np.ndarray, np.ndarray]:
    """Stations and offsets of all painted pixels of one mark at 10 m."""
    seen = plan(straight(LANES, marks=({"at_m": 10.0} | mark,)), to_m=18, right_m=-5, left_m=5)
    rows, columns = np.nonzero(seen.yellow() if mark.get("paint") else seen.white())
    return seen.x_m[columns], seen.y_m[rows]


@pytest.mark.parametrize("kind", [kind for kind in MarkKind if kind.name.startswith("ARROW")])
@pytest.mark.parametrize(("lane", "centre_m"), [(0, 0.0), (1, HALF_M + 1.5), (-1, -HALF_M - 1.4)])
def test_an_arrow_lies_in_its_lane_between_its_stations(kind, lane, centre_m):
    x, y = painted_pixels(kind=kind, lane=lane)
    assert len(x) > 500 and x.min() == pytest.approx(10.0, abs=0.06) and x.max() <= 15.03
    assert np.abs(y - centre_m).max() < 0.9


def test_an_arrow_points_in_its_direction():
    tip = {kind: painted_pixels(kind=kind) for kind in MarkKind if kind.name.startswith("ARROW")}
    assert tip[MarkKind.ARROW_STRAIGHT][0].max() == pytest.approx(15.0, abs=0.15)
    assert np.abs(tip[MarkKind.ARROW_STRAIGHT][1]).max() < 0.35
    for kind, side in (
        (MarkKind.ARROW_LEFT, 1),
        (MarkKind.ARROW_STRAIGHT_LEFT, 1),
        (MarkKind.ARROW_RIGHT, -1),
    ):
        assert 0.6 < (side * tip[kind][1]).max() < 0.9 and (-side * tip[kind][1]).max() < 0.35


def test_left_and_right_arrows_are_mirror_images():
    for left, right in (("arrow_left", "arrow_right"), ("arrow_straight_left", "arrow_straight_right")):
        (xl, yl), (xr, yr) = painted_pixels(kind=left), painted_pixels(kind=right)
        assert len(xl) == pytest.approx(len(xr), rel=0.03)
        assert (xl.mean(), yl.mean()) == pytest.approx((xr.mean(), -yr.mean()), abs=0.02)


def test_an_oncoming_mark_is_rotated():
    (x, y), (xo, yo) = painted_pixels(kind="arrow_left"), painted_pixels(kind="arrow_left", oncoming=True)
    assert (25.0 - xo.mean(), -yo.mean()) == pytest.approx((x.mean(), y.mean()), abs=0.03)


def test_a_stop_line_spans_only_its_lane():
    x, y = painted_pixels(kind="stop_line", lane=1)
    assert (x.min(), x.max()) == pytest.approx((10.0, 10.5), abs=0.03)
    assert (y.min(), y.max()) == pytest.approx((HALF_M, HALF_M + 3.0), abs=0.03)


def test_a_zebra_crossing_has_stripes_of_half_a_metre_across_all_lanes():
    seen = plan(straight(LANES, marks=({"kind": "zebra", "at_m": 10, "length_m": 3},)), right_m=-6, left_m=6)
    stripes = seen.white()[:, seen.column(11.5)]
    assert lengths_m(stripes)[:-1] == pytest.approx([0.5] * (len(lengths_m(stripes)) - 1), abs=0.03)
    assert centres_m(stripes, seen.y_m)[:3] == pytest.approx(
        -HALF_M - 2.8 + np.array([0.25, 1.25, 2.25]), abs=0.03
    )
    assert seen.y_m[stripes].max() <= HALF_M + 3.03
    along = seen.white()[seen.row(-HALF_M - 2.55)]
    assert (seen.x_m[along].min(), seen.x_m[along].max()) == pytest.approx((10, 13), abs=0.03)


def test_text_is_upright_for_the_driver():
    """The letter L has its upright on the left and its foot at the near end."""
    x, y = painted_pixels(kind="text", text="L")
    assert (x.min(), x.max()) == pytest.approx((10.0, 12.4), abs=0.06)
    upright, foot = y > y.max() - 0.12, x < x.min() + 0.3
    assert np.ptp(x[upright]) > 2.1 and np.ptp(y[foot]) > 0.4
    assert len(x[(x > 11.2) & (y < y.mean() - 0.1)]) == 0


def test_yellow_and_worn_marks():
    x, _ = painted_pixels(kind="stop_line", paint=Paint.YELLOW)
    assert len(x) > 0.9 * 20 * WIDTH_M * 40
    assert len(painted_pixels(kind="stop_line", wear=0.7)[0]) < 0.75 * len(
        painted_pixels(kind="stop_line")[0]
    )


def test_a_mark_is_rendered_in_the_camera_image():
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    marks = ({"kind": "stop_line", "at_m": 20.0},)
    with_mark, without = (
        Renderer(straight(LANES, **road), camera, seed=1).render(
            10.0, 0.0, 0.0, t_s=0.0, light=Light(noise=0)
        )
        for road in ({"marks": marks}, {})
    )
    changed = np.abs(with_mark.astype(int) - without).max(axis=2) > 40
    corners = camera.pixel_from_road(np.array([[x, y] for x in (10.0, 10.5) for y in (-HALF_M, HALF_M)]))
    rows, columns = np.nonzero(changed)
    assert (rows.min(), rows.max()) == pytest.approx((corners[:, 1].min(), corners[:, 1].max()), abs=1.5)
    assert (columns.min(), columns.max()) == pytest.approx((corners[:, 0].min(), corners[:, 0].max()), abs=2)
    assert cv2.countNonZero(changed.astype(np.uint8)) > 100


@pytest.mark.parametrize(
    ("mark", "message"),
    [
        ({"kind": "text", "at_m": 1}, "text is required for a mark of kind text"),
        ({"kind": "zebra", "at_m": 1, "text": "no"}, "not allowed for any other kind"),
        ({"kind": "text", "at_m": 1, "text": "straße"}, "match pattern"),
        ({"kind": "arrow_left", "at_m": 98}, "marks.0 ends at 103.0 m, beyond the road's 100.0 m"),
        ({"kind": "arrow_left", "at_m": 8, "lane": 2}, "marks.0: section 'bare' has no lane 2"),
        ({"kind": "arrow_up", "at_m": 8}, "arrow_straight"),
    ],
)
def test_a_mark_that_cannot_be_painted_is_refused(mark, message):
    with pytest.raises(ValidationError, match=message):
        straight(LANES, marks=(mark,))
