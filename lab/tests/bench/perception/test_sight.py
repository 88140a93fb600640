"""The scores of the sight distance, and the drives that they come from."""

from dataclasses import replace

import pytest

from lab.bench.perception.sight import GRADES, WEATHER, SightCase, SightSample, cases, drive, scores
from sim_harness.lockstep.oracle import clear_view
from sim_harness.world.sight_truth import SightDistance
from trepid.causes import Cause


def sample(
    seen_m: float | None, true_m: float, *, sigma_m: float = 10.0, cause: str = "", true: str = ""
) -> SightSample:
    seen = replace(clear_view(0.0), sight_m=seen_m, sight_sigma_m=sigma_m, sight_cause=cause)
    return SightSample(seen, SightDistance(true_m, true), 1.0, 0.5)


def test_scores_are_those_of_hand_made_frames() -> None:
    found = [
        sample(100.0, 100.0, cause="fog", true=Cause.FOG),
        sample(115.0, 100.0, cause="fog", true=Cause.FOG),
        sample(150.0, 100.0, cause="", true=Cause.FOG),
        sample(None, 100.0),
    ]
    row = scores(found)
    assert row["frames"] == 4 and row["absent_percent"] == 25.0
    assert row["error_percent"] == pytest.approx(15.0)
    assert row["right_cause_percent"] == pytest.approx(200 / 3)
    assert row["too_long_percent"] == 25.0
    assert row["within_1_sigma_percent"] == pytest.approx(100 / 3)
    assert row["within_2_sigma_percent"] == pytest.approx(200 / 3)
    assert row["least_seen_m"] == 100.0


def test_every_kind_and_grade_is_driven() -> None:
    rows = {case.row for case in cases(1, quick=True)}
    assert rows == {"clear", "crest", "dip", "wall", "truck", *(f"{k} {g}" for k in WEATHER for g in GRADES)}
    assert rows == {case.row for case in cases(1)}


@pytest.mark.long
def test_a_valley_hides_no_road() -> None:
    found = drive(SightCase(5, "dip", 0, 0))
    assert not {one.true.cause for one in found} & {Cause.CREST}
    assert Cause.CREST not in {one.seen.sight_cause for one in found}
    assert min(one.seen.sight_m or 0.0 for one in found) > 0.5 * max(one.true.distance_m for one in found)


@pytest.mark.long
def test_a_drive_in_fog_is_seen_nearly_as_far_as_it_is_true_and_the_same_again() -> None:
    case = SightCase(5, "fog", 3, 0)
    found = drive(case)
    assert [one.true.cause for one in found] == [Cause.FOG] * len(found)
    assert scores(found)["error_percent"] == pytest.approx(0.0, abs=35.0)
    again = drive(case)
    assert [one.seen for one in again] == [one.seen for one in found]
