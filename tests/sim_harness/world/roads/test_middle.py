"""The middle of a road as the line that is followed and judged (V03)."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cockpit.car.checks import configuration
from cockpit.logbook.recall import recall
from cockpit.logbook.story import story
from cockpit.logbook.story_text import story_text
from sim_harness.lockstep.closed_loop import run
from sim_harness.lockstep.recording import recording
from sim_harness.lockstep.referee import Referee, locate
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.plants.state import PlantState
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.middle import followed_road, middle_m
from trepid.car.vehicle import Vehicle
from trepid.config import CAR, CONFIG_DIR, InputError, load, use_car

LANE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
ROAD = Vehicle.model_validate({**LANE.model_dump(), "corridor": "road", "road_width_m": 7.0})
CORNER = load_scenario("sharp_corner_r12").build_road()  # two lanes of 3.5 m
MIDDLE = followed_road(CORNER, ROAD)


@pytest.fixture
def road_car(tmp_path: Path) -> Iterator[None]:
    before = os.environ.get(CAR)
    (tmp_path / "car").mkdir()
    (tmp_path / "car" / "vehicle.yaml").write_text("corridor: road\nroad_width_m: 7.0\n")
    use_car(tmp_path / "car")
    yield
    os.environ.pop(CAR)
    if before is not None:
        os.environ[CAR] = before


def test_a_car_in_its_lane_follows_the_road_itself():
    assert followed_road(CORNER, LANE) is CORNER


def test_the_middle_of_two_equal_lanes_is_their_common_line():
    assert middle_m(CORNER.sections[0], CORNER.settings.lane_width_m) == (1.75, 1.75)
    assert MIDDLE.position(3.0, 0.0) == CORNER.position(3.0, 1.75)


@given(station_m=st.floats(5.0, 90.0), offset_m=st.floats(-2.0, 2.0))
def test_a_point_of_the_middle_has_its_station_and_offset(station_m: float, offset_m: float):
    foot = MIDDLE.foot_point(*MIDDLE.position(station_m, offset_m), near_station_m=station_m + 0.5)
    assert foot.station_m == pytest.approx(station_m, abs=1e-5)
    assert foot.offset_m == pytest.approx(offset_m, abs=1e-5)


def test_the_radius_of_the_middle_of_a_left_bend_is_smaller_by_its_distance():
    assert 1 / CORNER.curvature_at(50.0) - 1 / MIDDLE.curvature_at(50.0) == pytest.approx(1.75)


def test_a_departure_is_a_wheel_over_the_corridor_and_not_over_the_middle_line():
    def departs(offset_m: float, vehicle: Vehicle, road: object) -> bool:
        x_m, y_m = CORNER.position(10.0, offset_m)
        pose = replace(PlantState(speed_mps=5.0), x_m=x_m, y_m=y_m)
        referee = Referee(road, vehicle, max_offset_m=1e3)  # type: ignore[arg-type]
        return referee.must_recentre(pose, locate(road, pose, 10.0))  # type: ignore[arg-type]

    assert departs(1.75, LANE, CORNER) and not departs(1.75, ROAD, MIDDLE)
    assert not departs(0.0, LANE, CORNER) and departs(0.0, ROAD, MIDDLE)
    edge_m = 1.75 - ROAD.track_m / 2
    assert not departs(1.75 + edge_m - 0.01, ROAD, MIDDLE) and departs(1.75 + edge_m + 0.01, ROAD, MIDDLE)


def test_a_road_whose_lanes_change_and_other_traffic_are_refused(road_car: None):
    with pytest.raises(InputError, match="middle of the road circuit moves aside by"):
        followed_road(load_road("circuit"), ROAD)
    with pytest.raises(InputError, match="has other vehicles or people"):
        run(load_scenario("cut_in", {"sight": "truth"}))


def test_doctor_says_where_the_car_drives(road_car: None):
    found = configuration()
    assert found.ok and "along the middle of the road (corridor: road) of 7 m" in found.message
    assert "closed paths without other traffic only" in found.message


def test_the_explanation_of_a_drive_says_where_the_car_drove(road_car: None, tmp_path: Path):
    scenario = load_scenario(
        "sharp_corner_r12", {"sight": "truth", "duration_s": "1.5", "estimators": "[cv]"}
    )
    with recording(tmp_path / "drive.mcap", scenario) as witness:
        result = run(scenario, witness=witness)
    assert abs(result.trace["lateral_offset_m"]).max() < 0.05
    text = story_text(story(recall(tmp_path / "drive.mcap"), 1.0))
    assert text.startswith("The car drove along the middle of the road (corridor: road).")


@pytest.mark.suite
def test_the_car_drives_a_corner_of_12_m_along_its_middle_line(road_car: None):
    result = run(load_scenario("sharp_corner_r12", {"estimators": "[cv]"}))
    assert not result.reasons and result.metrics.departures == 0
    assert result.metrics.max_lateral_error_m < 0.3
