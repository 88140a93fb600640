"""Side roads: place, width, rounded corners, interrupted lines and kerbs."""

import numpy as np
import pytest
from painted_road import WIDTH_M, bare, lengths_m, plan, straight
from pydantic import ValidationError

from sim_harness.world.roads.appearance import Marking, NeighbourLane, Verge

LINE = Marking(width_m=0.15)
HALF_M = WIDTH_M / 2
SECTION = bare(
    left=LINE, right=LINE, left_lanes=(NeighbourLane(width_m=3, marking=LINE),), verge=Verge.SNOW, kerb_m=0.2
)


def plan_with(**junction):
    place = {"kind": "driveway", "side": "right", "at_m": 20, "width_m": 5, "radius_m": 2} | junction
    return plan(straight(SECTION, junctions=(place,)), right_m=-12, left_m=12)


@pytest.mark.parametrize(("side", "edge_m"), [("right", -HALF_M - 0.3), ("left", HALF_M + 3.3)])
def test_a_side_road_has_its_width_and_side(side, edge_m):
    seen = plan_with(side=side)
    dark = seen.dark()
    beyond = edge_m + np.sign(edge_m) * 3.0
    assert lengths_m(dark[seen.row(beyond)]) == pytest.approx([5.0], abs=0.1)
    assert np.flatnonzero(dark[seen.row(beyond)]).mean() == pytest.approx(seen.column(20), abs=2)
    assert not dark[seen.row(-np.sign(edge_m) * 8.0)].any()


def test_the_corners_are_rounded_with_the_radius():
    seen = plan_with(radius_m=3)
    dark = seen.dark()
    for away_m in (0.5, 1.0, 2.0):
        width_m = 5 + 2 * (3 - np.sqrt(9 - (3 - away_m) ** 2))
        assert lengths_m(dark[seen.row(-HALF_M - 0.3 - away_m)]) == pytest.approx([width_m], abs=0.15)


@pytest.mark.parametrize(
    ("kind", "side", "open_"),
    [
        ("driveway", "right", (True, False, False)),
        ("driveway", "left", (False, False, True)),
        ("driveway", "both", (True, False, True)),
        ("intersection", "right", (True, True, False)),
        ("intersection", "both", (True, True, True)),
    ],
)
def test_lines_are_interrupted_at_the_mouth(kind, side, open_):
    seen = plan_with(kind=kind, side=side)
    for offset_m, is_open in zip((-HALF_M, HALF_M, HALF_M + 3), open_, strict=True):
        line = seen.white()[seen.row(offset_m)]
        assert lengths_m(~line) == pytest.approx([9.0] if is_open else [], abs=0.06)


def test_the_kerb_is_open_at_the_mouth():
    seen = plan_with()
    kerb = seen.bgr[seen.row(-HALF_M - 0.4)].min(axis=1) > 110
    assert not kerb[seen.column(16.5) : seen.column(23.5)].any()
    assert kerb[: seen.column(15)].mean() > 0.9 and kerb[seen.column(25) :].mean() > 0.9


def test_the_stop_line_of_a_side_road_spans_its_right_half():
    for side, sign in (("right", -1), ("left", 1)):
        seen = plan_with(kind="intersection", side=side, centre_line=True)
        edge_m = HALF_M + 0.3 + (3 if side == "left" else 0)
        stop = seen.white()[seen.row(sign * (edge_m + 1.25)), seen.column(17.8) : seen.column(22.2)]
        stations = seen.x_m[seen.column(17.8) : seen.column(22.2)][stop] - 20
        assert len(stations) > 80 and (np.sign(stations) == -sign).mean() > 0.97


def test_a_side_road_may_have_another_surface():
    asphalt, gravel = plan_with(), plan_with(surface="gravel")
    place = (slice(asphalt.row(-9), asphalt.row(-7)), slice(asphalt.column(19), asphalt.column(21)))
    redness = [
        seen.bgr[place][:, :, 2].mean() / seen.bgr[place][:, :, 0].mean() for seen in (asphalt, gravel)
    ]
    assert redness[1] > redness[0] + 0.2


def test_a_junction_beyond_the_road_is_refused():
    with pytest.raises(ValidationError, match=r"junctions.0 lies at 200.0 m, beyond the road's 100.0 m"):
        plan_with(at_m=200)


def test_the_edge_line_around_a_corner_follows_its_radius():
    seen = plan_with(kind="intersection", radius_m=3, rim_line=True)
    for away_m in (1.0, 2.0):
        root_m = np.sqrt(9 - (3 - away_m) ** 2)
        rim_m = 20 - 2.5 - 3 + root_m
        part = slice(seen.column(rim_m + 0.08), seen.column(20))  # from the rim, beside the snow, to the axis
        line = seen.x_m[part][seen.white()[seen.row(-HALF_M - 0.3 - away_m), part]]
        assert line.mean() == pytest.approx(17.5 - 3 + np.sqrt(3.16**2 - (3 - away_m) ** 2), abs=0.04)


def test_a_give_way_line_has_gaps_where_a_stop_line_is_whole():
    row_m, columns = -HALF_M - 0.3 - 1.25, (17.8, 22.2)
    shares = []
    for line in ("stop", "give_way", "none"):
        seen = plan_with(kind="intersection", mouth_line=line)
        part = seen.white()[seen.row(row_m), seen.column(columns[0]) : seen.column(columns[1])]
        shares.append(part.mean())
    assert shares[0] == pytest.approx(0.5, abs=0.05)
    assert shares[1] == pytest.approx(2 / 3 * shares[0], abs=0.05)
    assert shares[2] == 0


@pytest.mark.parametrize("side", ["left", "right"])
def test_left_hand_traffic_has_the_line_of_the_mouth_in_the_other_half(side):
    sign = -1 if side == "right" else 1
    edge_m = HALF_M + 0.3 + (3 if side == "left" else 0)
    middles = []
    for left_hand in (False, True):
        seen = plan_with(kind="intersection", side=side, mouth_line="stop", left_hand=left_hand)
        part = slice(seen.column(17.8), seen.column(22.2))
        stop = seen.white()[seen.row(sign * (edge_m + 1.25)), part]
        middles.append(float((seen.x_m[part][stop] - 20).mean()))
    assert middles[0] == pytest.approx(-middles[1], abs=0.05) and abs(middles[0]) > 1
