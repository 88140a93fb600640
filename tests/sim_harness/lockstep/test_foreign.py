"""A world of another package in the lock-step loop: the ring of examples/add_on, and worlds with a fault."""

import math
from collections.abc import Iterator
from dataclasses import replace
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from driving_network_rig import write_network

import trepid
from learning.correcting.alone import EXPERT, drive_alone, scenario_for
from learning.dataset.sources.log import Faults
from learning.dataset.sources.recording import read_drive
from sim_harness.lockstep.closed_loop import Result
from sim_harness.lockstep.foreign import WorldState, wheel_outside
from sim_harness.report.summary import _edges_beside
from sim_harness.scenarios.scenario import Scenario, load_scenario
from trepid import plugins
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from trepid.plugins import Group
from trepid.recording.reader import read_recording
from trepid.topics import SIM_TRUTH, estimate_topic

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
RING = "description: a ring\ntags: [mine]\nworld: {model: ring}\nestimators: [cv]\nduration_s: 6\n"
BROKEN = """
from trepid.messages import Command
from trepid_add_on.world import Ring

class Blind(Ring):
    def picture(self): return super().picture()[:100]

class Stuck(Ring):
    def advance(self, command, period_s):
        self._angle_rad = 0.0
        straight = Command(t_s=None, road_wheel_angle_rad=0.0, speed_mps=5.0, accel_mps2=1.0)
        super().advance(straight, period_s)

class Lost(Ring):
    def state(self):
        import dataclasses
        return dataclasses.replace(super().state(), lateral_offset_m=float("nan"))

class Endless(Ring):
    def curvature_at(self, ahead_m): return float("inf")

class Mute(Ring):
    def curvature_at(self, ahead_m): return None

class Nailed(Stuck):
    def recentre(self): raise RuntimeError("nailed down")

class Absent(Ring):
    def __init__(self, camera, vehicle, *, seed): raise OSError("no licence")
"""

BROKEN_NAMES = ("blind", "stuck", "lost", "endless", "mute", "nailed", "absent")


@pytest.fixture(autouse=True)
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The worlds of the example and of this test, as installed packages add them."""
    (tmp_path / "broken_worlds.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.syspath_prepend(ROOT / "examples" / "add_on")
    broken = {name: f"broken_worlds:{name.title()}" for name in BROKEN_NAMES}
    points = [
        EntryPoint(n, v, Group.WORLDS) for n, v in {"ring": "trepid_add_on.world:Ring", **broken}.items()
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points if group == Group.WORLDS else [])
    plugins.added_entry_points.cache_clear()
    yield
    plugins.added_entry_points.cache_clear()


def scenario(folder: Path, **settings: object) -> Scenario:
    file = folder / "ring.yaml"
    file.write_text(RING)
    return load_scenario(str(file), {name.replace("__", "."): str(value) for name, value in settings.items()})


def run(folder: Path, record: Path | None = None, **settings: object) -> Result:
    return trepid.run(scenario(folder, **settings), seed=3, record=record)


def test_the_pictures_of_a_world_drive_its_car_and_its_truth_judges_it(tmp_path: Path) -> None:
    result = run(tmp_path, tmp_path / "ring.mcap", sight="camera", duration_s=5)
    assert result.reasons == () and result.driven
    trace = result.trace
    assert trace["station_m"][-1] > 1.0
    assert np.abs(trace["cv.lateral_offset_m"][150:] - trace["lateral_offset_m"][150:]).max() < 0.15
    again = run(tmp_path, sight="camera", duration_s=1.5).trace
    assert np.array_equal(
        again["cv.lateral_offset_m"], trace["cv.lateral_offset_m"][: len(again)], equal_nan=True
    )
    drive = read_drive(tmp_path / "ring.mcap", Faults(strict=True))
    assert len(drive.t_s) > 60, "the recording is one for `dataset build`"
    truths = read_recording(tmp_path / "ring.mcap", SIM_TRUTH.key).of(SIM_TRUTH)
    assert max(one.station_m for _, one in truths) == pytest.approx(trace["station_m"][-1], abs=0.1)


def test_a_network_that_is_corrected_there_drives_beside_the_expert_of_the_exact_lane(tmp_path: Path) -> None:
    (tmp_path / "ring.yaml").write_text(RING)
    network = write_network(tmp_path / "ahead.onnx", gain_rad=0.0)
    alone = scenario_for(str(tmp_path / "ring.yaml"), network, {"duration_s": "2"})
    drive_alone(alone, seed=0, record=tmp_path / "alone.mcap")
    expert = read_recording(tmp_path / "alone.mcap", estimate_topic(EXPERT).key).of(estimate_topic(EXPERT))
    angles = [one.road_wheel_angle_rad for _, one in expert]
    assert angles[0] == pytest.approx(math.atan(VEHICLE.wheelbase_m / 40), rel=0.01)


def test_without_pictures_the_estimators_are_the_exact_lane_of_the_world(tmp_path: Path) -> None:
    trace = run(tmp_path, sight="truth", duration_s=9).trace
    assert np.nanmax(np.abs(trace["cv.curvature_1pm"] - 1 / 40)) < 1e-9
    assert np.abs(trace["lateral_offset_m"]).max() < 0.05 and trace["station_m"][-1] > 15.0


def test_the_route_ends_after_its_length(tmp_path: Path) -> None:
    trace = run(tmp_path, sight="truth", distance_m=5, duration_s=20).trace
    assert trace["finished"][-1] == 1.0
    assert trace["station_m"][-1] == pytest.approx(5.0, abs=0.1)


def test_a_car_that_leaves_the_lane_is_put_back_and_every_excursion_counts_once(tmp_path: Path) -> None:
    trace = run(tmp_path, world="{model: stuck}", sight="truth", duration_s=12).trace
    back = np.flatnonzero(np.diff(trace["interventions"]) > 0) + 1
    assert len(back) >= 2 and trace["departures"][-1] == len(back)
    assert np.abs(trace["lateral_offset_m"][back]).max() == pytest.approx(0.0, abs=1e-6)
    assert (trace["lateral_offset_m"][back - 1] < -0.5).all(), "straight on: to the right of a left bend"


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({"world": "{model: rink}"}, r"world.model: unknown world 'rink'; did you mean 'ring'"),
        (
            {"world": "{model: ring, options: {radius: 9}}"},
            r"unknown option 'radius'; did you mean 'radius_m'",
        ),
        (
            {"world": "{model: blind}"},
            r"world 'blind': picture\(\) is uint8 of shape \(100, 320, 3\); camera.yaml",
        ),
        ({"world": "{model: lost}"}, r"world 'lost': state\(\): lateral_offset_m is nan"),
        ({"world": "{model: endless}"}, r"world 'endless': curvature_at\(0\) is inf"),
        ({"world": "{model: mute}"}, r"world 'mute': curvature_at\(\): TypeError: "),
        (
            {"world": "{model: nailed}", "sight": "truth", "duration_s": 12},
            r"world 'nailed': recentre\(\): RuntimeError: nailed down",
        ),
        ({"world": "{model: absent}"}, r"trepid.worlds 'absent': cannot begin: OSError: no licence"),
        ({"road": "circuit"}, r"road: belongs to the simulated road; the world 'ring' has its own"),
        ({"start": "{speed_mps: 5}"}, r"start: belongs to the simulated road"),
        ({"lead_sensor": "truth"}, r"lead_sensor: the world 'ring' has no such sensor"),
        ({"world": "null"}, r"road: a scenario needs a road, or a `world`"),
    ],
)
def test_what_a_world_cannot_do_is_refused_in_one_line(tmp_path: Path, settings: Any, text: str) -> None:
    with pytest.raises(InputError, match=text) as raised:
        run(tmp_path, **{"duration_s": 0.1, **settings})
    assert "\n" not in str(raised.value)


STATE = WorldState(
    x_m=0.0,
    y_m=0.0,
    yaw_rad=0.0,
    speed_mps=0.0,
    yaw_rate_radps=0.0,
    road_wheel_angle_rad=0.0,
    station_m=0.0,
    lateral_offset_m=0.0,
    heading_error_rad=0.0,
    lane_width_m=3.5,
)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_wheel_is_outside_from_the_edge_on_and_the_front_axle_counts(side: float) -> None:
    room_m = 3.5 / 2 - VEHICLE.track_m / 2
    at = [replace(STATE, lateral_offset_m=side * share * room_m) for share in (0.999, 1.001)]
    assert [wheel_outside(one, VEHICLE, 0.0) for one in at] == [False, True]
    near = replace(STATE, lateral_offset_m=side * (room_m - 0.1), heading_error_rad=side * 0.1)
    assert wheel_outside(near, VEHICLE, 0.0)
    assert not wheel_outside(replace(near, heading_error_rad=-side * 0.1), VEHICLE, 0.0)
    sagitta_m = VEHICLE.wheelbase_m**2 / 2 * 0.05  # of the front axle beside a bend away from the heading
    beside = replace(STATE, lateral_offset_m=side * (room_m - sagitta_m / 2))
    assert wheel_outside(beside, VEHICLE, -side * 0.05) and not wheel_outside(beside, VEHICLE, 0.0)


def test_the_report_draws_the_lane_beside_the_driven_path(tmp_path: Path) -> None:
    trace = run(tmp_path, sight="truth", duration_s=9).trace
    left_x_m, left_y_m, right_x_m, right_y_m = _edges_beside(trace)
    assert np.hypot(left_x_m, left_y_m) == pytest.approx(40 - 1.75, abs=1e-6)
    assert np.hypot(right_x_m, right_y_m) == pytest.approx(40 + 1.75, abs=1e-6)
    assert math.isclose(float(left_x_m[0]), 38.25, abs_tol=1e-6)
