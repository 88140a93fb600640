"""The choice between candidates that are given instead of detected."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.choice import LaneChoice, SecondLook
from perception.lane.memory import LaneMemory
from perception.lane.model.evidence import NO_SUPPORT, BoundarySupport, LaneFit
from perception.lane.model.geometry import KAPPA, WIDTH, E, LaneState
from perception.lane.model.prediction import VehicleMotion
from perception.lane.rating import Rating

SETTINGS = lane_cv_settings()
RATING = Rating(SETTINGS)
NO_LANE = LaneFit(SETTINGS.prior.lane, NO_SUPPORT, NO_SUPPORT, 0.0)


def fit(
    width_m: float, excess: float, *, offset_m: float = 0.0, apart: float | None = None, bend_1pm: float = 0.0
) -> LaneFit:
    """A lane between lines or, with ``apart``, a road between edges."""
    mean = np.zeros(6)
    mean[[E, KAPPA, WIDTH]] = offset_m, bend_1pm, width_m
    side = BoundarySupport(excess=excess, extent_m=20.0, seen=True)
    state = LaneState(mean, np.diag([0.01, 0.001, 1e-4, 1e-6, 0.01, 1e-4]) ** 2)
    return LaneFit(state, side, side, 0.5, by_edges=apart is not None, apart=apart or 0.0, end_m=20.0)


GOOD, WEAK = fit(3.4, 0.35), fit(3.4, 0.066)
CORNER = fit(3.4, 0.35, bend_1pm=-0.1)
ONE_LANE, TWO_LANES = fit(4.2, 0.35, apart=8.0), fit(6.2, 0.35, apart=8.0)


@dataclass
class GivenSearch:
    """Candidates in place of a search; records the searches."""

    lines: LaneFit = NO_LANE
    edges: LaneFit = NO_LANE
    near: LaneFit = NO_LANE
    around: LaneFit | None = None  # edges of any predicted road; None: a miss
    continued: LaneFit | None = None  # lines elsewhere as those of the remembered lane; None: as ``lines``
    searched: list[str] = field(default_factory=list)

    def lines_anywhere(self) -> LaneFit:
        self.searched.append("lines")
        return self.lines

    def shape_anywhere(self) -> LaneState:
        self.searched.append("shape")
        return self.lines.state

    def lines_like(self, shape: LaneState, remembered: LaneState | None = None) -> LaneFit:
        self.searched.append("like")
        return self.continued or self.lines if remembered else self.lines

    def edges_anywhere(self) -> LaneFit:
        self.searched.append("edges")
        return self.edges

    def lines_at(self, predicted: LaneState) -> LaneFit:
        self.searched.append("at")
        return self.near

    def lines_near(self, predicted: LaneState) -> LaneFit:
        self.searched.append("near")
        return self.near

    def edges_at(self, predicted: LaneState) -> LaneFit:
        self.searched.append("around")
        return self.around or NO_LANE


def choose(given: GivenSearch, memory: LaneMemory | None = None, choice: LaneChoice | None = None):
    return (choice or LaneChoice(SETTINGS, RATING)).choose(given, memory or LaneMemory(SETTINGS, RATING))


def memory_of(lane: LaneFit) -> LaneMemory:
    memory = LaneMemory(SETTINGS, RATING)
    memory.update(RATING.candidate(lane), 0.0)
    return memory


def test_two_good_lines_need_no_search_for_edges():
    given = GivenSearch(lines=GOOD, edges=ONE_LANE)
    assert choose(given).fit is GOOD and given.searched == ["lines"]


def test_edges_of_one_lane_win_against_lines_of_a_lower_score():
    assert choose(GivenSearch(lines=WEAK, edges=ONE_LANE)).fit is ONE_LANE


def test_probable_lines_win_against_edges_of_two_lanes_of_a_higher_score():
    lines, edges = RATING.candidate(WEAK), RATING.candidate(TWO_LANES)
    assert lines.score < edges.score
    assert RATING.probability_of(edges, looks=0) > SETTINGS.min_probability
    best = choose(GivenSearch(lines=WEAK, edges=TWO_LANES))
    assert best.fit is WEAK and best.sure


def test_without_any_candidate_nothing_is_chosen():
    assert choose(GivenSearch()) is None


@pytest.mark.parametrize(("offset_m", "frames"), [(0.1, 3), (1.0, 3 + 2 * SETTINGS.track.rival_every)])
def test_a_better_lane_elsewhere_replaces_a_weak_one_at_its_first_fit_only_if_it_continues_it(
    offset_m, frames
):
    memory, choice = memory_of(GOOD), LaneChoice(SETTINGS, RATING)
    given = GivenSearch(lines=fit(3.4, 0.35, offset_m=offset_m), near=WEAK)
    fits = [choose(given, memory, choice).fit for _ in range(frames)]
    assert [one is WEAK for one in fits] == [True] * (frames - 1) + [False]


def test_lines_that_continue_the_remembered_lane_are_fitted_with_what_it_knows():
    memory, choice = memory_of(GOOD), LaneChoice(SETTINGS, RATING)
    known = fit(3.5, 0.35, offset_m=0.05)
    given = GivenSearch(lines=fit(3.2, 0.35, offset_m=0.1), near=WEAK, continued=known)
    memory.looks, memory.width_seen = 3.0, True
    assert [choose(given, memory, choice).fit for _ in range(3)][-1] is known
    assert memory.looks == 3.0 and memory.width_seen


def test_lines_close_by_that_do_not_fit_the_remembered_lane_must_be_found_as_often_as_lines_elsewhere():
    memory, choice = memory_of(GOOD), LaneChoice(SETTINGS, RATING)
    given = GivenSearch(lines=fit(3.2, 0.35, offset_m=0.1), near=WEAK, continued=WEAK)
    frames = 3 + 2 * SETTINGS.track.rival_every
    fits = [choose(given, memory, choice).fit for _ in range(frames)]
    assert [one is WEAK for one in fits] == [True] * (frames - 1) + [False]
    assert memory.looks == 0.0


@pytest.mark.parametrize(("gap", "one_boundary", "chosen"), [(0, False, 40), (3, False, 0), (0, True, 0)])
def test_a_lane_that_turns_off_the_road_shown_needs_two_boundaries_and_no_gap(gap, one_boundary, chosen):
    corner = replace(CORNER, left=NO_SUPPORT) if one_boundary else CORNER
    memory, choice, given, found = memory_of(GOOD), LaneChoice(SETTINGS, RATING), GivenSearch(), []
    memory.probability = 1.0
    for number in range(gap + 40):
        if number == gap:
            given = GivenSearch(lines=corner, near=corner, edges=corner, continued=corner)
        memory.predict(0.04 * number, VehicleMotion(0.5, 0.0))
        best = choose(given, memory, choice)
        if best is None:
            memory.coast()
        else:
            memory.update(best, 0.04 * number)
            found.append(best.fit)
    assert len(found) == chosen


def test_a_forgotten_lane_leaves_the_road_that_was_shown_and_its_end_frees_the_choice():
    memory, choice, given = memory_of(GOOD), LaneChoice(SETTINGS, RATING), GivenSearch(lines=CORNER)
    memory.probability, found = 1.0, []
    for t_s in (3.5, 4.0, 30.0):  # 3.5 m, 4 m and more than the 20 m that were shown
        memory.predict(t_s, VehicleMotion(1.0, 0.0))
        assert memory.lane is None
        found.append(choose(given, memory, choice))
    assert found[:2] == [None, None]
    assert found[2].fit is CORNER


def searches_of(given: GivenSearch, memory: LaneMemory, frames: int) -> list[list[str]]:
    """The searches of each frame."""
    choice, found = LaneChoice(SETTINGS, RATING), []
    for _ in range(frames):
        given.searched = []
        choose(given, memory, choice)
        found.append(given.searched)
    return found


def test_a_search_for_a_rival_takes_two_frames_of_one_look_near_the_remembered_lane_each():
    cycle = searches_of(GivenSearch(near=WEAK), memory_of(GOOD), 1 + SETTINGS.track.rival_every)
    both = ["at", "near"]
    assert cycle == [both, ["at", "shape"], ["near", "like"], both, both]


def test_a_single_weak_frame_begins_no_search_for_a_rival():
    given, memory, choice = GivenSearch(lines=GOOD), memory_of(GOOD), LaneChoice(SETTINGS, RATING)
    for near in (WEAK, GOOD) * 4:
        given.near = near
        choose(given, memory, choice)
    assert "shape" not in given.searched


@pytest.mark.parametrize("around", [None, fit(3.4, 0.1, apart=8.0)])
@pytest.mark.parametrize("near", [NO_LANE, fit(3.4, 0.04), WEAK])
@pytest.mark.parametrize("remembered", [GOOD, ONE_LANE])
def test_a_frame_without_a_good_lane_has_at_most_three_searches(remembered, near, around):
    frames = searches_of(GivenSearch(near=near, around=around), memory_of(remembered), 40)
    assert max(map(len, frames)) <= 3


@pytest.mark.parametrize("remembered", [GOOD, ONE_LANE])
def test_between_good_edges_missing_lines_are_looked_for_every_few_frames(remembered):
    edges = fit(3.7, 0.35, apart=8.0) if remembered is GOOD else ONE_LANE
    looks = [
        any(one in frame for one in ("at", "near"))
        for frame in searches_of(GivenSearch(around=edges), memory_of(remembered), 13)
    ]
    assert [number for number, look in enumerate(looks) if look] == list(
        range(0, 13, SETTINGS.track.lines_every)
    )


@pytest.mark.parametrize("side", [1, -1])
def test_a_road_with_a_second_lane_on_either_side_is_found_by_one_layout_a_frame(side):
    lane = fit(3.4, 0.35)
    road = fit(3.4 + 3.7, 0.35, offset_m=-side * 1.75, apart=8.0)
    memory, given = memory_of(lane), GivenSearch(around=road)
    frames = [frame.count("around") for frame in searches_of(given, memory, 5)]
    assert frames == [1] * 5 and memory.neighbour == side


def test_edges_right_after_lines_do_not_replace_a_more_probable_remembered_lane():
    memory = memory_of(GOOD)
    edges = fit(3.7, 0.12, apart=0.0)
    given = GivenSearch(near=NO_LANE)
    given.edges_at = lambda predicted: edges
    assert RATING.candidate(edges).score >= SETTINGS.min_score
    assert choose(given, memory) is None


STRAIGHT_EDGES, BENT_EDGES = fit(4.2, 0.35, apart=8.0), fit(4.2, 0.35, apart=8.0, bend_1pm=0.05)
FEW = 3 * SETTINGS.track.second_every  # frames with three looks


def factors(lane: LaneFit, found: LaneFit, frames: int, look: SecondLook | None = None) -> list[float]:
    look = look or SecondLook(SETTINGS)
    return [look.step(lane, GivenSearch(edges=found)) for _ in range(frames)]


def test_a_lane_between_edges_that_a_search_without_memory_contradicts_loses_its_probability_within_looks():
    seen = factors(STRAIGHT_EDGES, BENT_EDGES, 2 * FEW)
    assert seen[0] > 0.8, "one look errs"
    assert seen[FEW] < 0.5 and seen[-1] < 0.2
    assert seen == sorted(seen, reverse=True)


@pytest.mark.parametrize("found", [fit(6.9, 0.35, apart=8.0, offset_m=1.7), NO_LANE])
def test_another_width_or_place_of_the_same_road_and_a_search_in_vain_raise_no_doubt(found):
    assert factors(STRAIGHT_EDGES, found, FEW) == [1.0] * FEW


def test_bends_to_either_side_are_doubted_alike():
    mirrored = fit(4.2, 0.35, apart=8.0, bend_1pm=-0.05)
    assert factors(STRAIGHT_EDGES, BENT_EDGES, FEW) == factors(STRAIGHT_EDGES, mirrored, FEW)
    assert factors(BENT_EDGES, mirrored, FEW) == factors(mirrored, BENT_EDGES, FEW)


def test_lines_are_not_searched_again_and_end_the_doubt_within_seconds():
    look, given = SecondLook(SETTINGS), GivenSearch(edges=BENT_EDGES)
    doubted = factors(STRAIGHT_EDGES, BENT_EDGES, 2 * FEW, look)[-1]
    between_lines = [look.step(GOOD, given) for _ in range(200)]
    assert given.searched == [] and between_lines == sorted(between_lines)
    assert between_lines[12] < doubted + 0.3, "the border of a patch looks like a line for half a second"
    assert between_lines[72] == 1.0, "three seconds"


def test_a_lane_between_lines_is_not_doubted():
    assert factors(GOOD, BENT_EDGES, FEW) == [1.0] * FEW


def test_edges_that_are_found_again_end_the_doubt():
    look = SecondLook(SETTINGS)
    doubted = factors(STRAIGHT_EDGES, BENT_EDGES, 2 * FEW, look)[-1]
    assert doubted < 0.2 and factors(STRAIGHT_EDGES, STRAIGHT_EDGES, 2 * FEW, look)[-1] == 1.0


def test_a_second_look_is_due_in_every_nth_frame_between_edges():
    given, look = GivenSearch(edges=STRAIGHT_EDGES), SecondLook(SETTINGS)
    for _ in range(FEW):
        look.step(STRAIGHT_EDGES, given)
    assert given.searched == ["edges"] * 3
