"""Division into train, validation and test."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from learning.dataset.dataset import NONE, Split
from learning.dataset.likeness import ImageMeasurements
from learning.dataset.split import ALIKE_WHY, GAP, split_rows, stretches
from trepid.config import InputError

PERIOD_S = 0.05
SHARES = {"train": 0.65, "validation": 0.15, "test": 0.2}


def by_time(gap_s: float = 2.0) -> Split:
    return Split(by="time", seed=0, gap_s=gap_s, shares=SHARES)


def different(count: int) -> ImageMeasurements:
    """Images that do not look alike."""
    random = np.random.default_rng(0)
    return ImageMeasurements(
        light=np.full(count, 0.5, np.float32),
        hash=random.integers(0, 2**63, count).astype(np.uint64),
        small=random.integers(0, 255, (count, 24, 32)).astype(np.uint8),
        change=np.full(count, 0.1, np.float32),
        shift=np.zeros(count, np.float32),
    )


def times(count: int) -> np.ndarray:
    return PERIOD_S * np.arange(count)


@given(count=st.integers(420, 700), gap_s=st.floats(0.0, 2.0), routes=st.integers(1, 3))
def test_by_time_each_split_of_a_route_comes_after_the_one_before_with_the_gap_between(
    count: int, gap_s: float, routes: int
) -> None:
    route = np.repeat([f"r{n}" for n in range(routes)], count)
    t_s = np.tile(times(count), routes)
    split, _ = split_rows(by_time(gap_s), t_s, route, np.full(len(t_s), ""), different(len(t_s)))
    for name in np.unique(route):
        mine = route == name
        ends = [t_s[mine & (split == part)] for part in ("train", "validation", "test")]
        assert all(len(part) for part in ends)
        for before, after in pairwise(ends):
            assert after.min() - before.max() >= gap_s - 1e-9


def test_the_shares_are_those_that_were_asked_for() -> None:
    split, why = split_rows(by_time(0.0), times(1000), np.full(1000, "r"), np.full(1000, ""), different(1000))
    assert [(split == name).sum() for name in SHARES] == [650, 150, 200]
    assert (why == "").all()


def test_rows_with_a_reason_are_in_no_split() -> None:
    why = np.full(300, "")
    why = why.astype("<U20")
    why[10] = "no steering"
    split, reasons = split_rows(by_time(), times(300), np.full(300, "r"), why, different(300))
    assert split[10] == NONE and reasons[10] == "no steering"


def test_a_border_does_not_cut_a_frozen_piece() -> None:
    look = different(1000)
    look.change[600:700] = 0.0  # 650 would be the border
    split, _ = split_rows(by_time(0.0), times(1000), np.full(1000, "r"), np.full(1000, ""), look)
    assert set(split[600:700]) == {"train"}


def test_a_frame_of_train_that_looks_like_one_of_test_is_left_out() -> None:
    look = different(1000)
    look.hash[100], look.small[100] = look.hash[900] ^ np.uint64(1), look.small[900]
    split, why = split_rows(by_time(), times(1000), np.full(1000, "r"), np.full(1000, ""), look)
    assert split[100] == NONE and why[100] == ALIKE_WHY
    assert split[900] == "test"


def test_by_route_no_route_is_in_two_splits() -> None:
    route = np.repeat([f"r{n}" for n in range(6)], 100)
    rule = Split(by="route", seed=3, gap_s=2.0, shares=SHARES)
    split, why = split_rows(rule, np.tile(times(100), 6), route, np.full(600, ""), different(600))
    assert {len(set(split[route == name])) for name in set(route)} == {1}
    assert set(split) == {"train", "validation", "test"}
    assert GAP not in why


def test_a_named_route_is_the_test() -> None:
    route = np.repeat(["a", "b"], 300)
    rule = Split(by="route", seed=0, gap_s=1.0, shares=SHARES, test_routes=("a",))
    split, _ = split_rows(rule, np.tile(times(300), 2), route, np.full(600, ""), different(600))
    assert set(split[route == "a"]) == {"test"}
    assert {"train", "validation"} <= set(split[route == "b"])


@pytest.mark.parametrize(
    ("routes", "named", "message"), [(1, (), "two routes"), (2, ("z",), "no such route")]
)
def test_a_split_by_route_that_is_not_possible_is_refused(
    routes: int, named: tuple[str, ...], message: str
) -> None:
    route = np.repeat([f"r{n}" for n in range(routes)], 50)
    rule = Split(by="route", seed=0, gap_s=0.0, shares=SHARES, test_routes=named)
    with pytest.raises(InputError, match=message):
        split_rows(rule, np.tile(times(50), routes), route, np.full(len(route), ""), different(len(route)))


def test_a_stretch_ends_at_a_pause_at_a_new_route_and_where_time_runs_back() -> None:
    t_s = np.array([0.0, 0.1, 0.2, 5.0, 5.1, 5.0, 5.1, 5.2])
    route = np.array([*["a"] * 7, "b"])
    assert stretches(t_s, route).tolist() == [0, 0, 0, 1, 1, 2, 2, 3]


def test_a_split_by_route_can_be_the_test_alone_and_needs_a_share_of_it() -> None:
    route, rest = np.repeat(["a", "b"], 50), (np.full(100, ""), different(100))
    every = {"train": 0.0, "validation": 0.0, "test": 1.0}
    split, _ = split_rows(
        Split(by="route", seed=0, gap_s=0.0, shares=every), np.tile(times(50), 2), route, *rest
    )
    assert set(split) == {"test"}
    none = {"train": 0.8, "validation": 0.2, "test": 0.0}
    with pytest.raises(InputError, match="a share of the test above 0"):
        split_rows(Split(by="route", seed=0, gap_s=0.0, shares=none), np.tile(times(50), 2), route, *rest)


def test_where_time_runs_back_no_row_of_training_is_nearer_to_a_later_split_than_the_gap() -> None:
    t_s = np.concatenate([times(800) + 10.0, times(800)])  # the clock began again
    count = len(t_s)
    split, _ = split_rows(by_time(), t_s, np.full(count, "r"), np.full(count, ""), different(count))
    for earlier, later in (("train", "validation"), ("train", "test"), ("validation", "test")):
        between_s = np.abs(t_s[split == earlier][:, None] - t_s[split == later][None])
        assert between_s.size and between_s.min() >= 2.0 - 1e-6
    shuffled = np.random.default_rng(0).permutation(times(300))
    split, _ = split_rows(by_time(), shuffled, np.full(300, "r"), np.full(300, ""), different(300))
    assert "train" not in split
