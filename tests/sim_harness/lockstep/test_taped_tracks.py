"""The small cars on their tracks: every scenario with pixels, and the roads by the generator of tracks."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from cockpit.car.init import Like, write_car
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.road_file import load_road
from sim_harness.world.tracks import LOOKS, taped_track
from trepid.config import CONFIG_DIR, using_car

MINI = CONFIG_DIR / "cars" / "mini"
BENDS = {"tight": 1.5, "narrow": 2.0, "wide": 3.0}


def names(folder: str) -> list[str]:
    return sorted(path.stem for path in (MINI / folder).glob("*.yaml"))


@pytest.fixture(autouse=True)
def mini() -> Iterator[None]:
    with using_car(Path(MINI)):
        yield


@pytest.mark.suite
@pytest.mark.parametrize("name", names("scenarios"))
def test_the_car_drives_a_lap_of_every_track_in_its_lane(name: str) -> None:
    result = run(load_scenario(name), seed=0)
    assert result.reasons == ()
    assert result.metrics.departures == 0
    assert result.metrics.max_lateral_error_m < 0.03  # a wheel reaches the line at 0.065 m


@pytest.mark.suite
@pytest.mark.parametrize("name", ["oval_left", "oval_right"])
def test_a_duckiebot_keeps_the_right_half_of_a_road_of_tiles(name: str, tmp_path: Path) -> None:
    write_car(tmp_path / "mybot", Like.DUCKIEBOT)
    with using_car(tmp_path / "mybot"):
        result = run(load_scenario(name), seed=0)
        track = taped_track(
            name, LOOKS["duckie"], lane_width_m=0.25, bend=2.0 if name == "oval_left" else -2.0
        )
        road = load_road(name)
    assert result.reasons == ()
    assert result.metrics.departures == 0
    assert road.length_m == pytest.approx(sum(segment.length_m for segment in track.segments), rel=1e-8)


def test_ten_tracks_show_every_colour_on_every_floor() -> None:
    scenarios = [load_scenario(name) for name in names("scenarios")]
    sections = [scenario.build_road().sections[0] for scenario in scenarios]
    assert len(scenarios) == 10
    assert {section.verge.value for section in sections} == {"mat", "wood", "light_floor", "carpet"}
    paints = {marking.paint.value for section in sections for marking in (section.left, section.right)}
    assert paints == {"white", "yellow", "blue", "black"}
    assert {scenario.road for scenario in scenarios} == set(names("roads"))


@pytest.mark.parametrize("name", names("roads"))
def test_a_road_of_the_car_is_an_oval_with_the_bends_in_its_name(name: str) -> None:
    size, side = name.split("_")
    bend = BENDS[size] * (1 if side == "left" else -1)
    track = taped_track(name, LOOKS["white_on_mat"], lane_width_m=0.22, bend=bend)
    road = load_road(name).settings
    assert road.closed and len(road.segments) == len(track.segments)
    for own, other in zip(road.segments, track.segments, strict=True):
        assert own.length_m == pytest.approx(other.length_m, rel=1e-8)
        assert own.end_curvature_1pm == pytest.approx(other.end_curvature_1pm, rel=1e-8)
