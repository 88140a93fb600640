"""Taped tracks: closed ovals of the given bends, in every scale."""

import math

import numpy as np
import pytest

from sim_harness.world.roads.appearance import Surface
from sim_harness.world.roads.road import Road, RoadSettings
from sim_harness.world.tracks import LOOKS, taped_track


@pytest.mark.parametrize("bend", [1.5, -1.5, 2.0, -3.0])
@pytest.mark.parametrize("lane_width_m", [0.22, 0.5])
def test_a_track_closes_with_bends_of_the_given_radius(bend: float, lane_width_m: float) -> None:
    road = Road(taped_track("oval", LOOKS["duckie"], lane_width_m=lane_width_m, bend=bend))
    poses = road.poses(np.linspace(0, road.length_m * (1 - 1e-9), 400))
    assert poses[-1, :2] == pytest.approx(poses[0, :2], abs=1e-6)
    assert poses[-1, 2] - poses[0, 2] == pytest.approx(math.copysign(math.tau, bend))
    assert road.max_curvature_1pm == pytest.approx(1 / (abs(bend) * lane_width_m))
    assert np.sign(poses[np.argmax(np.abs(poses[:, 3])), 3]) == math.copysign(1, bend)


def test_a_track_of_another_scale_is_the_same_track() -> None:
    small, large = (
        Road(taped_track("oval", LOOKS["duckie"], lane_width_m=width_m, bend=2.0)) for width_m in (0.22, 0.44)
    )
    at = np.linspace(0, 1, 50)
    assert 2 * small.poses(at * small.length_m)[:, :2] == pytest.approx(
        large.poses(at * large.length_m)[:, :2], abs=1e-9
    )


def test_the_looks_differ_and_lie_on_floors() -> None:
    sections = [taped_track("oval", look, lane_width_m=0.22, bend=2.0).sections[0] for look in LOOKS.values()]
    assert len({section.model_dump_json() for section in sections}) == len(LOOKS)
    assert all(section.surface is Surface.FLOOR for section in sections)


def test_bends_tighter_than_lanes_allow_are_refused_at_their_place() -> None:
    track = taped_track("oval", LOOKS["duckie"], lane_width_m=0.22, bend=2.0).model_dump()
    track["segments"] = [{"length_m": 0.1, "curvature_1pm": 16.0}]
    with pytest.raises(ValueError, match="less than or equal to 10"):
        RoadSettings.model_validate(track)
    track |= {"lane_width_m": 1.0, "segments": [{"length_m": 0.1, "curvature_1pm": 9.0}]}
    with pytest.raises(ValueError, match=r"9 1/m is tighter than 3\.3 1/m"):
        RoadSettings.model_validate(track)
