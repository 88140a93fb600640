"""Painted lines have the place, pattern, colour, wear and damage of their settings."""

import math
from itertools import pairwise

import cv2
import numpy as np
import pytest
from painted_road import WIDTH_M, bare, centres_m, lengths_m, plan, straight
from pydantic import ValidationError

from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.appearance import Light, Marking, NeighbourLane, Paint, Stroke
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
SOLID = Marking(width_m=0.15)
HALF_M = WIDTH_M / 2


def test_the_lines_of_all_lanes_lie_at_their_edges():
    lanes = (NeighbourLane(width_m=3.0, marking=SOLID), NeighbourLane(width_m=2.5, marking=SOLID))
    road = straight(bare(left=SOLID, right=SOLID, left_lanes=lanes, right_lanes=lanes))
    seen = plan(road, right_m=-8, left_m=8)
    painted = seen.white()[:, 400:1200].mean(axis=1) > 0.9
    expected = [-HALF_M - 5.5, -HALF_M - 3, -HALF_M, HALF_M, HALF_M + 3, HALF_M + 5.5]
    assert centres_m(painted, seen.y_m) == pytest.approx(expected, abs=0.03)
    assert lengths_m(painted) == pytest.approx([0.15] * 6, abs=0.051)


@pytest.mark.parametrize("curvature_1pm", [0.0, 1 / 60, -1 / 60])
def test_the_line_of_a_neighbour_lane_is_rendered_where_the_camera_model_predicts(curvature_1pm):
    section = bare(left_lanes=(NeighbourLane(width_m=2.8, marking=SOLID),), paved_left_m=1)
    road = straight(section, segments=(Segment(length_m=100, curvature_1pm=curvature_1pm),))
    x_m, y_m = road.position(20.0, 0.0)
    heading = road.heading_at(20.0)
    image = Renderer(road, CAMERA, seed=1).render(x_m, y_m, heading, t_s=0.0, light=Light(noise=0))
    world = road.positions(np.arange(26, 40, 0.02), HALF_M + 2.8) - (x_m, y_m)
    turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    pixels = CAMERA.pixel_from_road(world @ turn.T)
    grey, errors_px = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(float), []
    for row in range(105, 180, 3):
        column = pixels[np.argmin(np.abs(pixels[:, 1] - row)), 0]
        if np.abs(pixels[:, 1] - row).min() < 0.5 and 12 < column < 307:
            near = np.arange(round(column) - 10, round(column) + 11)
            excess = np.maximum(grey[row, near] - np.median(grey[row, near]) - 25, 0)
            if excess.any():
                errors_px.append((near * excess).sum() / excess.sum() - column)
    assert len(errors_px) >= 5 and np.abs(np.median(errors_px)) < 0.7


@pytest.mark.parametrize(
    ("stroke", "left_share", "right_share"),
    [
        (Stroke.DOUBLE_SOLID, 1, 1),
        (Stroke.DOUBLE_DASHED, 1 / 3, 1 / 3),
        (Stroke.SOLID_DASHED, 1, 1 / 3),
        (Stroke.DASHED_SOLID, 1 / 3, 1),
    ],
)
def test_a_pair_has_two_lines_in_the_order_of_its_name(stroke, left_share, right_share):
    marking = Marking(stroke=stroke, width_m=0.15, spacing_m=0.15, dash_m=2, gap_m=4)
    seen = plan(straight(bare(left=marking, paved_left_m=3)), to_m=36)
    shares = [seen.white()[seen.row(HALF_M + shift)].mean() for shift in (0.15, -0.15)]
    assert shares == pytest.approx([left_share, right_share], abs=0.02)
    assert not seen.white()[seen.row(HALF_M)].any()


def test_dashes_have_the_stated_period_from_the_start_of_their_section():
    dashed = Marking(stroke=Stroke.DASHED, dash_m=2.5, gap_m=5)
    seen = plan(straight(bare(), bare("dashed", 4.0, right=dashed, paved_right_m=1)), to_m=44)
    dashes = seen.white()[seen.row(-HALF_M)]
    assert centres_m(dashes, seen.x_m) == pytest.approx(np.arange(5.25, 44, 7.5), abs=0.04)
    assert np.diff(centres_m(dashes, seen.x_m)) == pytest.approx(7.5, abs=0.03)


def test_only_gaps_are_empty():
    line = Marking(gaps_m=((10.0, 14.0), (20.0, 21.5)))
    seen = plan(straight(bare(left=line, right=SOLID, paved_right_m=1)), to_m=36)
    missing = ~seen.white()[seen.row(HALF_M)]
    assert centres_m(missing, seen.x_m) == pytest.approx([12.0, 20.75], abs=0.03)
    assert lengths_m(missing) == pytest.approx([4.0, 1.5], abs=0.06)
    assert seen.white()[seen.row(-HALF_M)].all()


def test_yellow_paint_is_yellow():
    seen = plan(straight(bare(left=Marking(paint=Paint.YELLOW, stroke=Stroke.DOUBLE_SOLID))), to_m=20)
    assert seen.yellow()[seen.row(HALF_M + 0.12)].mean() > 0.99 and not seen.white().any()


def test_damage_removes_pieces_with_hard_edges_in_proportion():
    shares = []
    for damage in (0.0, 0.4, 0.9):
        seen = plan(straight(bare(left=Marking(width_m=0.2, damage=damage))), to_m=50)
        line = seen.bgr[seen.row(HALF_M)].min(axis=1)
        shares.append((line > 160).mean())
        assert ((line > 115) & (line < 155)).mean() < 0.12
    assert shares[0] == 1 and all(a > b + 0.1 for a, b in pairwise(shares))


def test_a_line_follows_a_varying_width():
    section = bare(lane_width_m=(2.4, 4.4), left=SOLID, right=SOLID, paved_left_m=1, paved_right_m=1)
    seen = plan(straight(section), to_m=100)
    for station_m in (10, 50, 90):
        half_m = 1.2 + station_m / 100
        painted = seen.white()[:, seen.column(station_m)]
        assert centres_m(painted, seen.y_m) == pytest.approx([-half_m, half_m], abs=0.03)


def test_the_mirror_image_of_a_road_has_the_mirror_image_of_its_lines():
    near = Marking(stroke=Stroke.SOLID_DASHED)
    far = (NeighbourLane(width_m=2, marking=Marking(stroke=Stroke.DASHED)),)
    left = plan(straight(bare(left=near, left_lanes=far)), right_m=-4.5, left_m=4.5)
    mirrored = near.model_copy(update={"stroke": Stroke.DASHED_SOLID})
    right = plan(straight(bare(right=mirrored, right_lanes=far)), right_m=-4.5, left_m=4.5)
    here, there = left.white(), right.white()[::-1]
    grown = [cv2.dilate(mask.astype(np.uint8), np.ones((3, 3))) > 0 for mask in (here, there)]
    assert here.sum() > 1000 and not (here & ~grown[1]).any() and not (there & ~grown[0]).any()


def test_a_local_change_leaves_the_rest_of_the_road_unchanged():
    sections = (bare(left=SOLID), bare("far", 60, left=SOLID))
    changed = (sections[0], sections[1].model_copy(update={"left": Marking(damage=0.5), "kerb_m": 0.3}))
    mark = {"kind": "stop_line", "at_m": 70}
    before, after = plan(straight(*sections), to_m=55), plan(straight(*changed, marks=(mark,)), to_m=55)
    assert np.array_equal(before.bgr, after.bgr)


def test_a_closed_road_interrupts_its_lines_across_its_seam():
    radius_m = 40.0
    road = Road(
        RoadSettings(
            name="ring",
            closed=True,
            lane_width_m=WIDTH_M,
            segments=(Segment(length_m=2 * math.pi * radius_m, curvature_1pm=1 / radius_m),),
            sections=(bare(left=SOLID, right=SOLID, paved_right_m=1),),
            junctions=({"kind": "driveway", "side": "right", "at_m": 1.0, "width_m": 5, "radius_m": 1},),
        )
    )
    seen = plan(road, from_m=-10, to_m=10, right_m=-3, left_m=-1)
    assert not seen.white()[:, seen.column(-2.0)].any() and not seen.white()[:, seen.column(4.0)].any()
    assert seen.white()[:, seen.column(-5.0)].any() and seen.white()[:, seen.column(6.0)].any()


@pytest.mark.parametrize("gap_m", [(5.0, 5.0), (7.0, 3.0)])
def test_a_gap_of_no_length_is_refused(gap_m):
    with pytest.raises(ValidationError, match="a gap must end beyond its start"):
        Marking(gaps_m=(gap_m,))
