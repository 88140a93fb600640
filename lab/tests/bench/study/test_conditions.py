"""The study of conditions: every combination once, commands that repeat a drive, tables that count each drive."""

import shlex
from itertools import pairwise

import pytest

from lab.bench.fear.kinds import DRIVEN, LEFT, STOPPED, kind_of
from lab.bench.study.conditions import (
    DRIVERS,
    LIGHTS,
    ROADS,
    SPEEDS_MPS,
    WEATHERS,
    Conditions,
    StudiedDrive,
    all_conditions,
    mean_of,
    tables,
)
from sim_harness.scenarios.scenario import load_scenario


def row(*, departures: int = 0, driven: float = 100.0, autonomy: float = 100.0) -> dict[str, object]:
    return {
        "departures": departures,
        "driven_percent": driven,
        "autonomy_percent": autonomy,
        "max_lateral_error_m": 0.1,
        "cause": "fog",
    }


def test_every_combination_is_driven_once() -> None:
    found = list(all_conditions())
    assert len(set(found)) == len(found) == len(LIGHTS) * len(WEATHERS) * len(ROADS) * len(SPEEDS_MPS)
    for one in found:
        one.scenario().check()


@pytest.mark.parametrize("road", ROADS)
def test_the_command_of_a_drive_has_the_scenario_that_was_driven(road: str) -> None:
    conditions = Conditions("night", "fog", road, 9)
    words = shlex.split(conditions.command(7))
    settings = dict(word.split("=", 1) for option, word in pairwise(words) if option == "--set")
    assert words[:6] == ["trepid", "sim", "run", ROADS[road], "--seed", "7"]
    scenario = load_scenario(words[3], settings)
    assert scenario == conditions.scenario()
    assert [one.kind for one in scenario.disturbances] == ["night", "fog"]
    assert (scenario.speed_mps, scenario.start.speed_mps) == (9.0, 9.0)


def test_a_car_that_never_moved_has_no_autonomy_and_takes_none_from_others() -> None:
    assert mean_of([None, 50.0, 100.0]) == 75.0
    assert mean_of([None]) is None
    still = row(driven=0.0) | {"autonomy_percent": None, "max_lateral_error_m": None}
    drives = [StudiedDrive(one, driver, 1) for one in all_conditions() for driver in DRIVERS]
    page = tables(dict.fromkeys(drives, still))
    assert set(page["autonomy [%] by road and speed"]["lines, 5 m/s"].values()) == {None}
    assert page["kinds of failure, drives"]["cv alone"]["farthest [m]"] is None


def test_a_departure_counts_before_a_stop_and_a_stop_is_no_drive() -> None:
    assert kind_of(row()) == DRIVEN
    assert kind_of(row(driven=40.0)) == STOPPED
    assert kind_of(row(driven=40.0, departures=1)) == LEFT


def test_a_drive_is_in_one_row_of_each_table_and_a_failed_one_has_its_command() -> None:
    drives = [StudiedDrive(one, driver, 1) for one in all_conditions() for driver in DRIVERS]
    failed = StudiedDrive(Conditions("night", "snow", "lines", 5), "both under fear", 1)
    page = tables({one: row(driven=0.0, autonomy=50.0) if one == failed else row() for one in drives})
    by_light, by_road = page["autonomy [%] by light and weather"], page["autonomy [%] by road and speed"]
    assert by_light["night, snow"] == {"cv alone": 100.0, "cnn alone": 100.0, "both under fear": 87.5}
    assert by_road["lines, 5 m/s"]["both under fear"] == pytest.approx(100 - 50 / 12, abs=0.05)
    assert {
        driver: sum(list(one.values())[:3]) for driver, one in page["kinds of failure, drives"].items()
    } == dict.fromkeys(DRIVERS, len(drives) // 3)
    assert page["failed drives under fear"] == {
        "night, snow, lines, 5 m/s, seed 1": {
            "what": STOPPED,
            "cause": "fog",
            "command": f"`{failed.conditions.command(1)}`",
        }
    }
