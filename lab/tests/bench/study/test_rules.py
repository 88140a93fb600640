"""The printed rules are ranked by interventions, then by offset; their angles by the frames within two degrees."""

import numpy as np
import pytest

from lab.bench.perception.clips import CLEAR, WARM_UP_FRAMES, ClipCase
from lab.bench.perception.drive import COURSES
from lab.bench.perception.watch import LOOK, TRUTH, WatchedClip
from lab.bench.study.rules import (
    MARKED_COURSES,
    PEERS,
    angle_row,
    compared_rules,
    marked_clips,
    rank_drives,
    tables,
)
from perception.estimators import estimators
from sim_harness.sweep.store import Row
from sim_harness.world.roads.drawn import UNMARKED, BendShape, MarkingKind
from trepid.messages import EstimateKind

CLIP = ClipCase(1, 0, CLEAR, 0, MarkingKind.WHITE, BendShape.STRAIGHT)


def clip(**errors_deg: list[float]) -> WatchedClip:
    """A clip on which each rule has these errors after the warm-up; NaN: no answer."""
    looks = {}
    for name, errors in errors_deg.items():
        looks[name] = np.zeros(WARM_UP_FRAMES + len(errors), LOOK)
        looks[name]["angle_rad"][WARM_UP_FRAMES:] = np.radians(errors)
        looks[name]["offset_m"] = np.nan  # a rule gives no lane
    return WatchedClip(np.zeros(WARM_UP_FRAMES + len(errors), TRUTH), looks)


def drive(interventions: int, offset_m: float, blind: float = 0.0) -> Row:
    return {"interventions": interventions, "square_m2": offset_m**2, "blind": blind}


def test_every_pipeline_that_gives_an_angle_is_compared_beside_its_own_chain_with_pursuit() -> None:
    names, known = compared_rules(), estimators()
    rules = [name for name in names if name not in PEERS]
    assert len(rules) == 6 and {known[name].kind for name in rules} == {EstimateKind.ANGLE}
    assert set(rules) == {name for name, one in known.items() if one.kind is EstimateKind.ANGLE}


def test_all_roads_have_lines() -> None:
    kinds = {COURSES[number][0] for number in MARKED_COURSES} | {case.kind for case in marked_clips(3)}
    assert kinds.isdisjoint(UNMARKED) and len(MARKED_COURSES) == 6
    assert {case.seed for case in marked_clips(3)} == {3}


def test_a_frame_without_an_answer_is_not_within_two_degrees_and_has_no_error() -> None:
    row = angle_row({CLIP: clip(a=[1.0, -1.0, 3.0, float("nan")])}, "a")
    assert (row["within 2 deg [%]"], row["answered [%]"]) == (50.0, 75.0)
    assert (row["median error [deg]"], row["bias [deg]"]) == (1.0, 1.0)


def test_a_rule_that_never_answers_has_no_error() -> None:
    row = angle_row({CLIP: clip(a=[float("nan")] * 3)}, "a")
    assert (row["within 2 deg [%]"], row["answered [%]"]) == (0.0, 0.0)
    assert row["median error [deg]"] is None and row["bias [deg]"] is None


def test_an_intervention_outweighs_any_offset_and_equal_drives_share_the_middle() -> None:
    table = rank_drives(
        {"wild": [drive(1, 0.1)], "wide": [drive(0, 0.9)], "b": [drive(0, 0.2)], "a": [drive(0, 0.2)]}
    )
    assert {name: row["mean rank"] for name, row in table.items()} == {
        "b": 1.5,
        "a": 1.5,
        "wide": 3.0,
        "wild": 4.0,
    }
    assert list(table)[-2:] == ["wide", "wild"]


def test_the_autonomy_of_a_rule_is_the_mean_of_its_drives() -> None:
    table = rank_drives({"a": [drive(0, 0.3), drive(1, 0.4, blind=0.5)], "b": [drive(5, 1.0), drive(9, 1.0)]})
    assert table["a"]["autonomy [%]"] == pytest.approx(90.0)  # 6 s of 30 s in one of two
    assert table["a"]["offset rms [m]"] == pytest.approx(np.sqrt((0.09 + 0.16) / 2), abs=1e-3)
    assert (table["a"]["interventions"], table["a"]["courses without"]) == (1, 1)
    assert table["a"]["without answer [%]"] == 25.0


@pytest.mark.parametrize(("turned", "correlation"), [(False, 1.0), (True, -1.0)])
def test_the_correlation_is_one_where_better_angles_drive_better(turned: bool, correlation: float) -> None:
    errors = {"good": [0.0] * 4, "fair": [0.0, 0.0, 9.0, 9.0], "bad": [9.0] * 4}
    drives = {name: [drive(n, 0.1)] for n, name in enumerate(reversed(errors) if turned else errors)}
    page = tables({CLIP: clip(**errors)}, drives)
    assert page["rank correlation"] == correlation
    assert list(page["by angle"]) == list(page["in closed loop, alone"]) == list(drives)


def test_mirrored_errors_change_the_sign_of_the_bias_alone() -> None:
    errors = [0.5, 1.5, -4.0, float("nan")]
    row, mirrored = (angle_row({CLIP: clip(a=[side * one for one in errors])}, "a") for side in (1.0, -1.0))
    assert mirrored == {**row, "bias [deg]": -row["bias [deg]"]}
