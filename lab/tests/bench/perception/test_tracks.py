"""The benchmark of taped tracks: its roads, and what its rows become."""

from pathlib import Path

import pytest

from lab.bench.perception.tracks import BENDS, ESTIMATORS, Lap, driven_row, scenario_of, summary
from sim_harness.world.tracks import LOOKS
from trepid.config import CONFIG_DIR, using_car


def row(bend: float, look: str, **changed: object) -> dict[str, object]:
    usual = dict(
        bend=bend,
        look=look,
        finished=True,
        departures=0,
        engaged_percent=100.0,
        speed_mps=0.4,
        largest_offset_m=0.01,
        mean_fear=0.1,
    )
    return usual | changed


@pytest.mark.parametrize("bend", BENDS)
def test_the_scenario_of_a_lap_is_a_closed_track_of_its_bend(bend: float, tmp_path: Path) -> None:
    with using_car(CONFIG_DIR / "cars" / "mini"):
        scenario = scenario_of(Lap(bend, "duckie", 0, ESTIMATORS), tmp_path)
        scenario.check()
        road = scenario.build_road()
    assert road.closed
    assert road.max_curvature_1pm == pytest.approx(1 / (abs(bend) * 0.22))


def test_one_bad_lap_shows_in_its_bend_its_look_and_in_all() -> None:
    rows = [row(bend, look) for bend in BENDS for look in LOOKS]
    rows[0] = row(
        BENDS[0], next(iter(LOOKS)), departures=2, finished=False, speed_mps=0.1, engaged_percent=40.0
    )
    tables = summary(rows)
    assert tables["all laps"]["departures"] == 2 and tables["all laps"]["least_speed_mps"] == 0.1
    assert tables["by bend"]["R = 1.5 lane widths, left"]["departures"] == 2
    assert sum(scores["departures"] for scores in tables["by tape and floor"].values()) == 2
    assert tables["by bend"]["R = 1.5 lane widths, right"]["finished"] == len(LOOKS)


@pytest.mark.long
@pytest.mark.parametrize("bend", [1.5, -1.5])
def test_the_car_follows_a_single_line_through_the_tightest_bends(bend: float) -> None:
    lap = driven_row(Lap(bend, "single_on_mat", 0, ESTIMATORS))
    assert lap["finished"] and lap["departures"] == 0
    assert lap["engaged_percent"] >= 95.0 and lap["speed_mps"] >= 0.3
    assert lap["largest_offset_m"] < 0.03  # the tape is 0.024 m wide
