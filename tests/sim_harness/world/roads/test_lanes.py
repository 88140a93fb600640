"""Parallel lanes: closed-form geometry, round trips, varying widths."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from painted_road import bare, straight
from pydantic import ValidationError

from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Marking, NeighbourLane, Section
from sim_harness.world.roads.lanes import RoadLane
from sim_harness.world.roads.road import Road, RoadSettings, Segment

DUAL, TRACK = load_road("dual_carriageway"), load_road("gravel_track")
WIDE = (NeighbourLane(width_m=3.0), NeighbourLane(width_m=2.6))
LANES = [
    RoadLane(DUAL, 1),
    RoadLane(DUAL, 0),
    RoadLane(DUAL, -1),
    RoadLane(TRACK, 0),
    RoadLane(load_road("circuit"), 1),
]


def circle(radius_m: float, **section) -> Road:
    return Road(
        RoadSettings(
            name="circle",
            closed=True,
            lane_width_m=3.5,
            segments=(Segment(length_m=2 * math.pi * radius_m, curvature_1pm=1 / radius_m),),
            sections=(Section(name="only", start_m=0, **section),),
        )
    )


def test_centres_lie_half_widths_apart():
    road = straight(bare(left_lanes=WIDE, right_lanes=WIDE[:1]))
    assert [RoadLane(road, i).centre_at(10) for i in (-1, 0, 1, 2)] == pytest.approx([-3.2, 0, 3.2, 6.0])
    assert [RoadLane(road, i).width_at(10) for i in (-1, 0, 1, 2)] == [3.0, 3.4, 3.0, 2.6]


def test_a_neighbour_lane_of_a_circle_is_a_circle_with_the_same_centre():
    road = circle(50, left_lanes=WIDE, right_lanes=WIDE)
    for index, radius_m in ((1, 50 - 3.25), (2, 50 - 6.05), (-1, 50 + 3.25), (-2, 50 + 6.05)):
        lane = RoadLane(road, index)
        points = np.array([lane.position(s, 0.0) for s in np.linspace(0, road.length_m, 30)])
        assert np.hypot(points[:, 0], points[:, 1] - 50) == pytest.approx(radius_m, abs=1e-9)
        assert lane.heading_at(70.0) == pytest.approx(70 / 50)


@settings(max_examples=60, deadline=None)
@given(lane=st.sampled_from(LANES), share=st.floats(0, 0.999), offset_m=st.floats(-2, 2))
def test_local_coordinates_invert_position(lane, share, offset_m):
    station_m = share * lane.road.length_m
    if not math.isnan(lane.centre_at(station_m)):
        point = lane.position(station_m, offset_m)
        there = lane.local_coordinates(*point, near_station_m=station_m)
        assert there == pytest.approx((station_m, offset_m), abs=1e-6)


@pytest.mark.parametrize(
    "lane", [RoadLane(DUAL, -1), RoadLane(DUAL, 1), RoadLane(TRACK, 0)], ids=["right", "left", "own"]
)
def test_heading_is_the_direction_of_the_lanes_centre(lane):
    h = 1e-4
    for share in (0.3, 0.32, 0.4, 0.49, 0.66):
        station_m = share * lane.road.length_m
        (x0, y0), (x1, y1) = (lane.position(station_m + d, 0.0) for d in (-h, h))
        if not math.isnan(x0):
            assert math.atan2(y1 - y0, x1 - x0) == pytest.approx(
                math.remainder(lane.heading_at(station_m), math.tau), abs=1e-6
            )


def test_widths_change_linearly_and_without_a_jump():
    lane = RoadLane(DUAL, -1)
    assert [lane.width_at(s) for s in (420, 450, 500, 640, 680)] == pytest.approx([0, 1.75, 3.5, 3.5, 1.75])
    widths = np.array([TRACK.width_at(s) for s in np.arange(0, 340, 0.1)])
    assert np.abs(np.diff(widths)).max() <= 0.9 / 50 * 0.1 + 1e-9
    assert widths == pytest.approx(TRACK.widths_at(np.arange(0, 340, 0.1)))
    assert (TRACK.width_at(225.0), TRACK.width_at(1e4)) == pytest.approx((3.15, 2.7))


def test_a_missing_lane_has_nan_coordinates():
    lane = RoadLane(DUAL, -1)
    assert all(map(math.isnan, (lane.width_at(100.0), lane.centre_at(100.0), *lane.position(100.0, 0.0))))
    assert math.isnan(lane.heading_at(100.0)) and math.isnan(lane.local_coordinates(100.0, 0.0)[1])
    with pytest.raises(ValueError, match="dual_carriageway has no lane -2 in any section"):
        RoadLane(DUAL, -2)


def test_far_left_is_one_lane_of_the_kept_lanes_width():
    road = straight(bare(far_left=Marking()))
    assert (RoadLane(road, 1).centre_at(5.0), RoadLane(road, 1).width_at(5.0)) == (3.4, 3.4)
    with pytest.raises(ValidationError, match="far_left describes one left lane"):
        bare(far_left=Marking(), left_lanes=WIDE)


def test_the_mirror_image_of_a_road_has_its_lanes_on_the_other_side():
    left, right = circle(50, left_lanes=WIDE), circle(50, right_lanes=WIDE)
    for index in (1, 2):
        assert RoadLane(left, index).centre_at(20.0) == -RoadLane(right, -index).centre_at(20.0)


@pytest.mark.parametrize("lane", ["lane_width_m", "left", "right"])
def test_a_width_that_jumps_is_refused_with_its_place(lane):
    widths = {"lane_width_m": 3.0}
    if lane != "lane_width_m":
        widths = {f"{lane}_lanes": (NeighbourLane(width_m=3.0),)}
    wider = {"left": {"left_lanes": ({},)}, "right": {"right_lanes": ({},)}}.get(lane, {})
    with pytest.raises(ValidationError, match=r"lane -?[01] jumps from 3.0 to 3.4 m width at section 'next'"):
        straight(bare(**widths), bare("next", 50, **wider))
