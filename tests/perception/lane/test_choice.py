"""The choice between candidates that are given instead of detected."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.choice import LaneChoice
from perception.lane.memory import LaneMemory
from perception.lane.model.evidence import NO_SUPPORT, BoundarySupport, LaneFit
from perception.lane.model.geometry import WIDTH, E, LaneState
from perception.lane.rating import Rating

SETTINGS = lane_cv_settings()
RATING = Rating(SETTINGS)
NO_LANE = LaneFit(SETTINGS.prior.lane, NO_SUPPORT, NO_SUPPORT, 0.0)


def fit(width_m: float, excess: float, *, offset_m: float = 0.0, apart: float | None = None) -> LaneFit:
    """A lane between lines or, with ``apart``, a road between edges."""
    mean = np.zeros(6)
    mean[[E, WIDTH]] = offset_m, width_m
    side = BoundarySupport(excess=excess, extent_m=20.0, seen=True)
    state = LaneState(mean, np.diag([0.01, 0.001, 1e-4, 1e-6, 0.01, 1e-4]) ** 2)
    return LaneFit(state, side, side, 0.5, by_edges=apart is not None, apart=apart or 0.0)


GOOD, WEAK = fit(3.4, 0.35), fit(3.4, 0.066)
ONE_LANE, TWO_LANES = fit(4.2, 0.35, apart=8.0), fit(6.2, 0.35, apart=8.0)


@dataclass
class Given:
    """Candidates in place of a search; records the searches over all lanes."""

    lines: LaneFit = NO_LANE
    edges: LaneFit = NO_LANE
    near: LaneFit = NO_LANE
    searched: list[str] = field(default_factory=list)

    def lines_anywhere(self) -> LaneFit:
        self.searched.append("lines")
        return self.lines

    def edges_anywhere(self) -> LaneFit:
        self.searched.append("edges")
        return self.edges

    def lines_at(self, predicted: LaneState) -> LaneFit:
        return self.near

    lines_near = lines_at

    def edges_at(self, predicted: LaneState) -> LaneFit:
        return NO_LANE


def chosen(given: Given, memory: LaneMemory | None = None, choice: LaneChoice | None = None):
    return (choice or LaneChoice(SETTINGS, RATING)).choose(given, memory or LaneMemory(SETTINGS, RATING))


def memory_of(lane: LaneFit) -> LaneMemory:
    memory = LaneMemory(SETTINGS, RATING)
    memory.update(RATING.candidate(lane), 0.0)
    return memory


def test_two_good_lines_need_no_search_for_edges():
    given = Given(lines=GOOD, edges=ONE_LANE)
    assert chosen(given).fit is GOOD and given.searched == ["lines"]


def test_edges_of_one_lane_win_against_lines_of_a_lower_score():
    assert chosen(Given(lines=WEAK, edges=ONE_LANE)).fit is ONE_LANE


def test_probable_lines_win_against_edges_of_two_lanes_of_a_higher_score():
    lines, edges = RATING.candidate(WEAK), RATING.candidate(TWO_LANES)
    assert lines.score < edges.score
    assert RATING.probability_of(edges, looks=0) > SETTINGS.min_probability
    best = chosen(Given(lines=WEAK, edges=TWO_LANES))
    assert best.fit is WEAK and best.sure


def test_without_any_candidate_nothing_is_chosen():
    assert chosen(Given()) is None


@pytest.mark.parametrize(("offset_m", "frames"), [(0.1, 1), (1.0, 1 + 2 * SETTINGS.track.rival_every)])
def test_a_better_lane_elsewhere_replaces_a_weak_one_at_once_only_if_it_continues_it(offset_m, frames):
    memory, choice = memory_of(GOOD), LaneChoice(SETTINGS, RATING)
    given = Given(lines=fit(3.4, 0.35, offset_m=offset_m), near=WEAK)
    fits = [chosen(given, memory, choice).fit for _ in range(frames)]
    assert [one is WEAK for one in fits] == [True] * (frames - 1) + [False]


def test_edges_right_after_lines_do_not_replace_a_more_probable_remembered_lane():
    memory = memory_of(GOOD)
    edges = fit(3.7, 0.12, apart=0.0)
    given = Given(near=NO_LANE)
    given.edges_at = lambda predicted: edges
    assert RATING.candidate(edges).score >= SETTINGS.min_score
    assert chosen(given, memory) is None
