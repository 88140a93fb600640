"""The lock-step loop with estimators that read the truth: fast, and every fault comes from the scenario."""

import dataclasses
import hashlib
import math
from functools import cache

import numpy as np
import pytest

import controller.controller
import controller.limiter
import perception.sight.judge
import sim_harness.lockstep.sensors
import supervisor.supervisor
from sim_harness.judging.metrics import FurtherMetrics
from sim_harness.lockstep.camera import SimulatedCamera
from sim_harness.lockstep.closed_loop import Parts, build_parts, run
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.scenario import Scenario, load_scenario
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, SteeringEstimate

pytestmark = pytest.mark.long
LOOKAHEAD_M = 8.0


class GreyRenderer:
    """A small noisy picture per pose: enough for the image statistics, different in every frame."""

    seed = 0
    road = None

    def render(self, x_m, y_m, yaw_rad, *, station_m, t_s, vehicles, motion, attitude):
        noise = np.random.default_rng(round(t_s * 1e3))
        return noise.integers(40, 220, (24, 32, 3), dtype=np.uint8)


class WatchedCamera(SimulatedCamera):
    """Keeps the truth behind every frame for the estimators of this test."""

    def __init__(self, scenario, road):
        super().__init__(scenario, GreyRenderer(), wheelbase_m=2.5)
        self.road = road
        self.truths = {}

    def shoot(self, truth, *, now_s):
        self.truths[truth.t_s] = truth
        return super().shoot(truth, now_s=now_s)


class Seer:
    """Returns the true lane of a frame; no lane when the frame is black."""

    def __init__(self, name, camera):
        self.name, self.camera = name, camera

    def step(self, frame: Frame, state, *, now_s):
        truth = self.camera.truths[frame.t_s]
        curvature = self.camera.road.curvature_at(truth.station_m)
        ahead = self.camera.road.curvature_at(truth.station_m + LOOKAHEAD_M)
        seen = frame.image.any()
        return SteeringEstimate(
            t_s=frame.t_s,
            estimator=self.name,
            lateral_offset_m=truth.lateral_offset_m if seen else None,
            heading_error_rad=truth.heading_error_rad if seen else None,
            curvature_1pm=ahead if seen else None,
            curvature_rate_1pm2=(ahead - curvature) / LOOKAHEAD_M if seen else None,
            lookahead_m=LOOKAHEAD_M,
            road_wheel_angle_rad=math.atan(1.75 * ahead) if seen else None,
            confidence=0.95 if seen else 0.0,
            lanes_detected=2 if seen else 0,
            lane_width_m=truth.lane_width_m if seen else None,
            latency_ms=None,
            reason="" if seen else "black",
            left_boundary_px=(),
            right_boundary_px=(),
        )


def parts_with_seers(scenario, seed=0, settings=None):
    road = scenario.build_road()
    camera = WatchedCamera(scenario, road)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    limiter = controller.limiter.build()
    return Parts(
        vehicle=SimulatedVehicle(scenario, road, vehicle, limiter, settings or load_simulator(), seed=seed),
        camera=camera,
        estimators={name: Seer(name, camera) for name in scenario.estimators},
        judge=perception.sight.judge.build(),
        supervisor=supervisor.supervisor.build(),
        controller=controller.controller.build(),
    )


def drive(scenario, seed=0, settings=None):
    return run(scenario, seed=seed, parts=parts_with_seers(scenario, seed, settings))


@cache
def whole_drive(name):
    """The drive of a shipped scenario, for all tests that look at it."""
    return drive(load_scenario(name))


@pytest.mark.parametrize("name", ["offset_start", "s_curve", "curve_left_r15", "curve_right_r15"])
def test_a_car_with_a_valid_lane_keeps_it_and_arrives(name):
    result = whole_drive(name)
    assert result.reasons == ()
    assert result.metrics.max_lateral_error_m < 0.45
    assert result.metrics.modes["KEEP"] > 0.5 * result.metrics.duration_s


def test_the_mirrored_road_is_driven_as_the_mirror_image(monkeypatch):
    left = whole_drive("curve_left_r15").trace
    noise = sim_harness.lockstep.sensors._standard_normal
    monkeypatch.setattr(
        "sim_harness.lockstep.sensors._standard_normal",
        lambda seed: ([speed, -angle, -yaw_rate] for speed, angle, yaw_rate in noise(seed)),
    )
    right = drive(load_scenario("curve_right_r15").shorten(20.0)).trace
    count = len(right["t_s"])
    assert abs(right["yaw_rad"][-1] - right["yaw_rad"][0]) > 0.5, "the cars drive through the bend"
    for name in ("lateral_offset_m", "yaw_rad", "command.road_wheel_angle_rad", "decision.heading_error_rad"):
        np.testing.assert_allclose(left[name][:count], -right[name], atol=1e-9)
    for name in ("station_m", "speed_mps", "decision.fear"):
        np.testing.assert_allclose(left[name][:count], right[name], atol=1e-9)


# What is lost to the true lane alone, an estimator or a process, is judged by the suite.
@pytest.mark.parametrize("name", ["frozen_camera", "black_frames"])
def test_after_lost_pictures_the_car_stops_within_its_lane(name):
    result = drive(load_scenario(name))
    assert result.reasons == ()
    assert result.trace["speed_mps"][-1] == 0.0
    assert result.trace["speed_mps"].max() > 2.0


def test_without_the_fault_the_same_run_does_not_stop():
    scenario = load_scenario("frozen_camera").model_copy(update={"faults": ()})
    assert any("expected to stand" in reason for reason in drive(scenario).reasons)


def test_late_frames_are_older_when_they_are_used():
    faults = load_scenario("late_frames").faults
    prompt = whole_drive("s_curve").trace
    late = drive(load_scenario("s_curve").model_copy(update={"duration_s": 8.0, "faults": faults})).trace
    ages = [float(np.nanmin(trace["t_s"] - trace["decision.t_s"])) for trace in (prompt, late)]
    assert ages[0] == pytest.approx(0.02, abs=1e-6)
    assert ages[1] == pytest.approx(0.14, abs=1e-6)  # 0.1 s late is three frames of 0.04 s


def test_a_slow_vehicle_ahead_is_followed_at_a_distance():
    result = drive(load_scenario("lead_slow").shorten(25.0))
    assert result.reasons == ()
    assert result.metrics.collisions == 0
    assert result.metrics.min_time_gap_s is not None


def test_the_same_seed_gives_the_same_trace_and_another_seed_another_one():
    scenario = load_scenario("s_curve").shorten(6.0)
    first, again, other = (drive(scenario, seed).trace.sha256 for seed in (5, 5, 6))
    assert first == again != other


def test_the_trace_hash_covers_the_contents_of_the_columns():
    trace = drive(load_scenario("s_curve").shorten(2.0)).trace
    packed = b"".join(name.encode() + b"\0" + column.tobytes() for name, column in trace.columns.items())
    words = "".join("\0".join((name, *words)) for name, words in trace.words.items())
    assert trace.sha256 == hashlib.sha256(packed + words.encode()).hexdigest()


def test_a_row_has_the_fields_of_the_design_and_then_the_further_scores():
    fields = """scenario seed status reasons duration_s distance_m departures interventions autonomy_percent
        max_lateral_error_m rms_lateral_error_m max_lateral_accel_mps2 max_lateral_jerk_mps3 max_decel_mps2
        collisions min_time_gap_s mean_speed_mps max_fear mean_fear modes causes engaged_percent
        stop_cause realtime_factor trace_sha256 waits_for"""
    further = [field.name for field in dataclasses.fields(FurtherMetrics)]
    assert list(drive(load_scenario("straight").shorten(1.0)).row()) == [*fields.split(), *further]


DARK_FROM_THE_START = "[{kind: black_frames, from_s: 0}]"


@pytest.mark.parametrize(
    ("changes", "status", "reasons"),
    [
        ({}, "not driven", ()),
        ({"must_stand": True}, "passed", ()),
        ({"must_stand": True, "faults": "[]"}, "failed", ("the car went",)),
    ],
)
def test_a_run_in_which_the_car_stands_passes_only_where_it_is_to_stand(changes, status, reasons):
    faults = changes.pop("faults", DARK_FROM_THE_START)
    scenario = load_scenario("straight", {"faults": faults}).shorten(6.0)
    scenario = scenario.model_copy(update={"expect": scenario.expect.model_copy(update=changes)})
    row = drive(scenario).row()
    assert (row["status"], len(row["reasons"])) == (status, len(reasons))
    assert all(start in reason for start, reason in zip(reasons, row["reasons"], strict=True))
    stands = faults == DARK_FROM_THE_START
    assert (row["autonomy_percent"] is None, row["engaged_percent"] == 0.0) == (stands, stands)
    assert (row["stop_cause"] == "starting", row["waits_for"] != "") == (stands, stands)


def test_a_plant_that_understeers_twice_as_much_still_keeps_the_lane():
    scenario = load_scenario("s_curve")
    scenario = Scenario.model_validate(
        {**dict(scenario), "plant": {"vehicle": {"understeer_gradient_rad_per_mps2": 0.0071}}}
    )
    assert drive(scenario).reasons == ()


def with_true_sight(**fields):
    base = dict(description="", tags=["nominal"], road="straight", duration_s=20.0, sight="truth")
    return Scenario.model_validate(base | fields)


def test_with_the_true_lane_no_picture_is_rendered_and_the_lane_is_kept():
    scenario = load_scenario("s_curve", {"sight": "truth"})
    parts = build_parts(scenario, seed=0)
    result = run(scenario, parts=parts)
    assert result.reasons == ()
    assert result.metrics.max_lateral_error_m < 0.15
    assert not parts.estimators


def test_the_parts_of_a_scenario_are_built_where_none_are_given():
    scenario = load_scenario("s_curve", {"sight": "truth"}).shorten(3.0)
    given = run(scenario, parts=build_parts(scenario, seed=0))
    assert given.trace.sha256 == run(scenario).trace.sha256


@pytest.mark.parametrize("side", [1, -1])
def test_a_drifting_car_is_taken_over_at_speed_and_kept_in_its_lane(side):
    """Euro NCAP lane support: 72 km/h, 0.5 m/s; the drift must end within the lane and the speed stays."""
    start = {"station_m": 100, "speed_mps": 20, "drift_mps": 0.5 * side}
    trace = run(with_true_sight(start=start, speed_mps=20, duration_s=8)).trace
    assert trace["t_s"][0] == 0.0
    assert trace["station_m"][0] == pytest.approx(100.0)
    assert 0.1 < trace["lateral_offset_m"].max() * side + trace["lateral_offset_m"].min() * side < 0.6
    assert abs(trace["lateral_offset_m"][-1]) < 0.02
    assert trace["speed_mps"].min() > 19.5
    assert trace.words["mode"][int(trace["mode"][-1])] == "KEEP"


CUT_IN = {"gap_m": 14, "lane": 1, "speed_mps": 6, "phases": [{"kind": "change_lane", "at_s": 2, "over_s": 3}]}


def test_after_a_cut_in_the_time_gap_grows_to_a_safe_one():
    scenario = with_true_sight(start={"speed_mps": 8}, traffic=[CUT_IN], duration_s=25)
    trace = run(scenario).trace
    changing = trace["t_s"][trace["traffic.change_lane"] > 0]
    assert (changing[0], changing[-1]) == (pytest.approx(2.01), pytest.approx(4.99))
    assert np.isnan(trace["lead_gap_m"][trace["t_s"] < 2.5]).all()
    assert trace["collisions"][-1] == 0
    assert trace["lead_gap_m"][-1] / trace["speed_mps"][-1] > 1.5


def test_behind_a_vehicle_that_leaves_the_lane_a_standing_car_is_detected():
    """Cut-out: the sensor measures only the nearest vehicle, the standing car after the other has left."""
    leaver = {"gap_m": 16, "speed_mps": 7, "phases": [{"kind": "change_lane", "at_s": 3, "to_lane": 1}]}
    scenario = with_true_sight(start={"speed_mps": 7}, traffic=[leaver, {"gap_m": 75}], duration_s=40)
    trace = run(scenario).trace
    jumps = np.flatnonzero(np.diff(trace["lead_gap_m"]) > 5.0)
    assert len(jumps) == 1
    assert trace["collisions"][-1] == 0
    assert trace["speed_mps"][-1] < 0.1


def test_conditions_are_judged_and_name_the_event():
    kept, broken = ["time_gap >= 0.5 s", "speed <= 8.5 m/s"], "speed >= 7.9 m/s"
    fields = {"start": {"speed_mps": 8}, "traffic": [CUT_IN], "duration_s": 12}
    (reason,) = run(with_true_sight(expect={"conditions": [*kept, broken]}, **fields)).reasons
    assert "speed >= 7.9 m/s" in reason


def test_two_equally_biased_estimators_are_not_detected():
    """An equal bias of both estimators is not detectable: the car drives off the centre by it at low fear."""
    biases = [
        {"kind": "estimator_bias", "estimator": name, "lateral_m": 0.45, "from_s": 6}
        for name in ("cv", "cnn")
    ]
    alike = run(with_true_sight(faults=biases, lane_width_m=4.0)).trace
    assert alike["lateral_offset_m"][-1] == pytest.approx(-0.45, abs=0.05)
    assert alike["decision.fear"][-1] < 0.3
