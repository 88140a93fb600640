"""Timelines, the driven path, the overlay, the message to a viewer and the idle page, without a browser."""

import json
import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from live_page_rig import truth
from message_rig import SHUTTLE, decision, estimate, state

from cockpit.page.feed import Feed
from cockpit.page.history import KEPT, MAX_POINTS, SAMPLE_S, PathHistory, Timelines
from cockpit.page.hub import HEADER, Hub, Viewer, pack_state
from cockpit.page.overlay import PATH_M, lane_px, lead_px, overlay, path_px, people_px
from cockpit.page.server import LONGEST_REASON, closing_reason
from cockpit.page.stop import RELEASE_S, REPEAT_S, UNDELIVERED_S, StopSender
from cockpit.page.view import LATE_BEAT_S, PageView
from drive.reason import DRIVER, NO_DECISION
from trepid.bus import Bus
from trepid.car.camera import Camera
from trepid.causes import OWN_STOPS
from trepid.config import CONFIG_DIR, load
from trepid.messages import Diagnostic, Health, LeadVehicle, RoadUsers, StopRequest, Timing
from trepid.processes.register import END, PROBLEMS, WAITS
from trepid.processes.settings import LAUNCHER
from trepid.topics import CAMERA_COMPRESSED, DECISION, DIAGNOSTICS, SIM_TRUTH, TIMING, VEHICLE_STATE
from trepid.wire import to_cdr
from vehicle.driver.stop_button import STOPPED

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


def test_timelines_are_due_at_their_rate_and_hold_the_newest_samples():
    lines = Timelines(("fear",))
    due = [now for now in np.arange(0.0, 2.0, 0.02) if lines.due(float(now))]
    assert len(due) == pytest.approx(2.0 / SAMPLE_S, abs=1)
    for number in range(KEPT + 10):
        lines.add(float(number), [math.nan if number % 2 else 0.5])
    assert len(lines.since(0)) == KEPT and lines.since(lines.count) == []
    assert lines.since(lines.count - 2) == [[KEPT + 8.0, 0.5], [KEPT + 9.0, None]]


def test_the_path_of_a_circle_by_speed_and_yaw_rate_closes():
    track, turns, radius_m, speed_mps = PathHistory(), 1, 20.0, 5.0
    period_s = 2 * math.pi * turns * radius_m / speed_mps
    for t_s in np.linspace(0.0, period_s, 300):
        track.add(state(float(t_s), speed_mps=speed_mps, yaw_rate_radps=speed_mps / radius_m), None, 0.1)
    x_m, y_m, yaw_rad = track.pose
    assert math.hypot(x_m, y_m) < 0.1 and yaw_rad == pytest.approx(2 * math.pi, abs=0.01)
    points = np.array([point[:2] for point in track.since(-1, 0)[1]])
    assert np.hypot(points[:, 0], points[:, 1] - radius_m) == pytest.approx(radius_m, rel=0.01)
    assert track.driven_m == pytest.approx(2 * math.pi * radius_m, rel=0.02)


def test_the_path_is_the_true_one_where_there_is_one_and_is_not_invented_without_measurement():
    track = PathHistory()
    track.add(state(0.0), truth(0.0, 12.0, 0.0), None)
    track.add(state(0.1), None, None)
    assert track.pose == (12.0, 0.0, 0.0) and track.true
    unknown = PathHistory()
    unknown.add(state(0.0, yaw_rate_radps=None), None, 0.1)
    assert unknown.pose is None and unknown.count == 0


def test_a_long_path_is_thinned_and_every_viewer_learns_it():
    track = PathHistory()
    for number in range(2 * MAX_POINTS):
        track.add(None, truth(0.1 * number, float(number), 0.0), 0.2)
    assert track.count <= MAX_POINTS and track.thinned >= 1
    anew, points = track.since(0, 10)
    assert anew and points[0][0] == 0.0 and points[-1][0] == pytest.approx(2 * MAX_POINTS, abs=5)
    assert track.since(track.thinned, track.count) == (False, [])


def test_the_drawn_path_lies_on_the_road_where_the_decision_has_it():
    outline = np.array(path_px(decision(lateral_offset_m=0.4), CAMERA, SHUTTLE))
    road = CAMERA.road_from_pixel(outline)
    left, right = road[: len(road) // 2], road[len(road) // 2 :][::-1]
    near = left[:, 0] < 12.0
    assert (left + right)[near, 1] / 2 == pytest.approx(-0.4, abs=0.05)
    assert (left - right)[near, 1] == pytest.approx(PATH_M, abs=0.06)
    assert path_px(decision(lateral_offset_m=None), CAMERA, SHUTTLE) is None


def test_a_lane_without_boundaries_is_drawn_from_its_state():
    drawn = lane_px(estimate(lateral_offset_m=0.0, heading_error_rad=0.0, lane_width_m=3.0), CAMERA, SHUTTLE)
    left, right = (CAMERA.road_from_pixel(drawn[side])[0] for side in ("left", "right"))
    assert left[1] == pytest.approx(1.5, abs=0.1) and right[1] == pytest.approx(-1.5, abs=0.1)
    nothing = estimate(lateral_offset_m=None, confidence=0.0)
    assert lane_px(nothing, CAMERA, SHUTTLE) == {"left": [], "right": [], "confidence": 0.0}


def test_the_box_of_the_vehicle_ahead_stands_on_the_road_and_is_absent_with_it():
    lead = LeadVehicle(t_s=0.0, distance_m=10.0, lateral_m=1.0, speed_mps=None, confidence=1.0)
    left, top, right, bottom = lead_px(lead, CAMERA, SHUTTLE)
    x_m, y_m = CAMERA.road_from_pixel([(left + right) / 2, bottom])[0]
    assert x_m == pytest.approx(SHUTTLE.wheelbase_m + SHUTTLE.front_overhang_m + 10.0, abs=0.5)
    assert y_m == pytest.approx(1.0, abs=0.05) and top < bottom
    gone = LeadVehicle(t_s=0.0, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)
    assert overlay([], None, gone, CAMERA, SHUTTLE)["lead"] is None


def test_people_stand_on_the_road_as_high_as_their_kind_and_the_nearest_is_drawn_last():
    users = RoadUsers(
        t_s=0.0,
        kinds=("person", "animal", "cyclist"),
        x_m=(12.0, 30.0, -4.0),
        y_m=(-1.0, 2.0, 0.0),
        x_mps=(0.0,) * 3,
        y_mps=(0.0,) * 3,
        confidences=(0.9,) * 3,
    )
    far, near = people_px(users, CAMERA, SHUTTLE)
    assert (far["kind"], near["kind"]) == ("animal", "person")
    left, top, right, bottom = near["box"]
    assert CAMERA.road_from_pixel([(left + right) / 2, bottom])[0] == pytest.approx((12.0, -1.0), abs=0.1)
    depth_m = 12.0 - CAMERA.x_m
    assert (bottom - top) * depth_m / CAMERA.fy_px == pytest.approx(1.8, abs=0.05)
    assert near["distance"] == pytest.approx(12.0 - SHUTTLE.wheelbase_m - SHUTTLE.front_overhang_m, abs=0.05)
    assert overlay([], None, None, CAMERA, SHUTTLE)["people"] == []


def test_a_point_that_is_not_finite_is_not_drawn():
    odd = estimate(left_boundary_px=((60.0, 230.0), (math.nan, 150.0)), right_boundary_px=((math.inf, 1.0),))
    drawn = lane_px(odd, CAMERA, SHUTTLE)
    assert drawn["left"] == [[60.0, 230.0]] and drawn["right"] == []


@pytest.mark.parametrize("distance_m", [math.nan, math.inf])
def test_a_vehicle_ahead_at_a_distance_that_is_not_finite_is_absent(distance_m):
    air, _, view, _ = idle_page()
    lead = LeadVehicle(
        t_s=air.now_s, distance_m=distance_m, lateral_m=0.0, speed_mps=None, confidence=math.nan
    )
    view._feed.lead.message = lead
    assert view.state(air.now_s)["lead"] is None
    assert lead_px(lead, CAMERA, SHUTTLE) is None


def test_an_unknown_number_reaches_a_viewer_as_null_at_any_depth():
    message = pack_state({"inputs": {"age": math.nan, "offset": 0.25}, "line": [(1.0, math.inf)]}, b"jpeg")
    (length,) = HEADER.unpack_from(message)
    assert json.loads(message[HEADER.size : HEADER.size + length]) == {
        "inputs": {"age": None, "offset": 0.25},
        "line": [[1.0, None]],
    }
    assert message[HEADER.size + length :] == b"jpeg"


class Air:
    """A bus without a network on which every topic subscribed to has a new message; counts the subscriptions."""

    def __init__(self) -> None:
        self.now_s = 100.0
        self.open: list[str] = []
        self.stops: list[StopRequest] = []
        self.beats: list[Any] = []
        self.times: list[Any] = []

    def stream(self, topic: object) -> Any:
        sent = {DIAGNOSTICS: self.beats, TIMING: self.times}[topic]
        return SimpleNamespace(drain=lambda: [(sent.pop(0), self.now_s) for _ in list(sent)])

    def beat(self, process: str, message: str, t_s: float | None = None, **values: str) -> None:
        """A heartbeat of ``process``, sent now or at ``t_s``."""
        t_s = self.now_s if t_s is None else t_s
        told = tuple(values.items())
        self.beats.append(
            Diagnostic(t_s=t_s, process=process, health=Health.WARN, message=message, values=told)
        )

    def publisher(self, _: object) -> Any:
        return self.stops.append

    def tap(self, key: str, *, kept: int) -> Any:
        self.open.append(key)
        return SimpleNamespace(drain=lambda: self._newest(key), close=lambda: self.open.remove(key))

    def _newest(self, key: str) -> list[tuple[str, bytes, float]]:
        now_s = self.now_s
        sent: dict[str, Any] = {
            DECISION.key: decision(
                t_s=now_s, decided_s=now_s, fear=0.25, inputs=("cv_confidence",), input_values=(0.75,)
            ),
            VEHICLE_STATE.key: state(now_s, speed_mps=4.0, yaw_rate_radps=0.0),
        }
        return [(key, to_cdr(sent[key]), now_s)] if key in sent else []


def idle_page() -> tuple[Air, Hub, PageView, StopSender]:
    air = Air()
    bus = cast(Bus, air)
    feed = Feed(bus, ["cv"])
    view, stop = (
        PageView(feed, CAMERA, SHUTTLE, holder="car", what="test"),
        StopSender(bus, lambda: air.now_s),
    )
    return air, Hub(feed, view, stop, lambda: air.now_s), view, stop


def test_without_a_viewer_the_page_receives_the_drive_for_moments_only_and_its_timelines_go_on():
    air, hub, view, _ = idle_page()
    subscribed_s, began_s, keys = 0.0, air.now_s, set()
    while air.now_s < began_s + 20.0:
        pause_s = hub.turn()
        subscribed_s += pause_s if air.open else 0.0
        keys |= set(air.open)
        air.now_s += pause_s
    assert subscribed_s < 0.1 * 20.0 and keys == {DECISION.key, VEHICLE_STATE.key, SIM_TRUTH.key}
    samples = view.timelines.since(0)
    assert len(samples) >= 18
    assert samples[-1][1:] == [0.25, 4.0, *samples[-1][3:-1], 0.75]  # fear, speed, confidence of cv
    assert view.track.driven_m == pytest.approx(4.0 * 20.0, abs=8.0)


def test_a_viewer_gets_every_topic_from_its_first_turn_on_and_none_stays_after_it():
    air, hub, _, _ = idle_page()
    hub.turn()
    viewer = Viewer()
    hub.viewers.add(viewer)
    hub.turn()
    assert len(air.open) == len(set(air.open)) == 8 and CAMERA_COMPRESSED.key in air.open
    hub.viewers.discard(viewer)
    for _ in range(4):
        air.now_s += hub.turn()
    assert CAMERA_COMPRESSED.key not in air.open


def test_a_stop_without_a_viewer_is_repeated_as_often_as_with_one():
    air, hub, _, stop = idle_page()
    hub.turn()
    stop.press(True)
    began_s = air.now_s
    while air.now_s < began_s + 2.0:
        pause_s = hub.turn()
        assert pause_s <= REPEAT_S
        air.now_s += pause_s
    assert len(air.stops) >= 0.5 * 2.0 / REPEAT_S


def test_a_stop_that_nobody_acknowledges_is_repeated_without_end_and_reported_as_undelivered():
    air, hub, _, stop = idle_page()
    stop.press(True)
    began_s, undelivered_s = air.now_s, []
    while air.now_s < began_s + 60.0:
        air.now_s += hub.turn()
        if stop.is_undelivered:
            undelivered_s.append(air.now_s - began_s)
    assert air.stops[-1].stop and air.stops[-1].t_s > air.now_s - 2 * REPEAT_S
    assert undelivered_s[0] == pytest.approx(UNDELIVERED_S, abs=2 * REPEAT_S)
    assert undelivered_s == sorted(undelivered_s) and stop.pending
    stop.press(True)  # in despair, again
    assert stop.is_undelivered
    stop.press(False)
    assert not stop.is_undelivered and not air.stops[-1].stop


def test_a_viewer_learns_that_a_stop_is_not_delivered():
    air, hub, _, stop = idle_page()
    viewer = Viewer()
    hub.viewers.add(viewer)
    stop.press(True)
    found = []
    for after_s in (0.0, UNDELIVERED_S + 0.1):
        air.now_s += after_s
        viewer.acknowledge()
        hub.turn()
        (length,) = HEADER.unpack_from(viewer.next)
        shown = json.loads(viewer.next[HEADER.size : HEADER.size + length])
        found.append((shown["stopping"], shown["stop_undelivered"]))
    assert found == [(True, False), (True, True)]


def test_only_a_present_heartbeat_of_the_vehicle_process_reports_that_the_car_is_held():
    air, hub, view, _ = idle_page()

    def is_held(process: str, message: str, age_s: float) -> bool:
        air.now_s += 10.0
        air.beat(process, message, air.now_s - age_s)
        hub.turn()
        return bool(view.state(air.now_s)["held"])

    assert is_held("car", STOPPED, 0.5) and is_held("car", f"{STOPPED}; the car reports no state", 0.5)
    assert not is_held("car", STOPPED, LATE_BEAT_S + 0.1) and not is_held("car", STOPPED, -60.0)
    assert not is_held("cnn", STOPPED, 0.5) and not is_held("car", "", 0.5)
    air.beat("car", STOPPED)
    hub.turn()
    assert view.state(air.now_s)["held"]
    air.now_s += LATE_BEAT_S + 0.1
    assert not view.state(air.now_s)["held"]


def test_a_stop_is_acknowledged_only_by_what_the_vehicle_process_reports_after_the_press():
    air, hub, _, stop = idle_page()
    air.beat("car", STOPPED)  # of a stop that was released since
    hub.turn()
    air.now_s += 0.1
    stop.press(True)
    for process, t_s in (("cnn", air.now_s + 0.2), ("car", air.now_s)):
        air.now_s += 1.5 * REPEAT_S
        air.beat(process, STOPPED, t_s)
        hub.turn()
        assert stop.pending
    assert len(air.stops) == 3
    air.now_s += REPEAT_S
    air.beat("car", STOPPED)
    hub.turn()
    assert not stop.waiting


def test_a_release_ends_when_it_is_reported_or_old():
    for reported in (True, False):
        air, hub, _, stop = idle_page()
        stop.press(False)
        air.now_s += 0.2
        if reported:
            air.beat("car", "")
        hub.turn()
        assert stop.waiting != reported
        air.now_s += RELEASE_S
        hub.turn()
        assert not stop.waiting


def test_the_time_from_frame_to_actuator_is_absent_when_no_frame_is_applied_any_more():
    air, hub, view, _ = idle_page()
    frames = (air.now_s - 0.1, air.now_s - 0.06)
    sent = (frames[0] + 0.020, frames[1] + 0.022)
    report = Timing(
        t_s=air.now_s, process="vehicle", frame_s=frames, published_s=frames, received_s=frames, began_s=frames,
        sent_s=sent,
    )  # fmt: skip
    air.times.append(report)
    hub.turn()
    view.sample(air.now_s)
    latency = view.timelines.names.index("latency")
    assert view.state(air.now_s)["latency"] == {"p50": 22.0, "max": 22.0}
    assert view.timelines.since(0)[-1][latency] == 22.0
    air.now_s += LATE_BEAT_S + 0.1
    hub.turn()
    view.sample(air.now_s)
    assert view.state(air.now_s)["latency"] is None and view.timelines.since(0)[-1][latency] is None


def test_the_driver_has_the_car_only_by_a_present_state():
    air, _, view, _ = idle_page()
    view._feed.state.message = state(air.now_s, speed_mps=4.0, driver_override=True)
    assert view.state(air.now_s)["because"] == DRIVER
    shown = view.state(air.now_s + 2.0)
    assert (shown["because"], shown["speed"]) == (NO_DECISION, None)


@given(st.text(alphabet="aé😀 ", max_size=200))
def test_why_a_drive_ended_fits_the_closing_frame_and_is_cut_only_where_it_must_be(text: str):
    kept = closing_reason(text)
    assert len(kept.encode()) <= LONGEST_REASON
    assert kept == text if len(text.encode()) <= LONGEST_REASON else text.startswith(kept.removesuffix("…"))


def test_the_page_knows_why_the_drive_ended_by_the_last_report_of_the_launcher():
    air, _, view, _ = idle_page()
    assert view.end == ""
    air.beat(LAUNCHER, "driving", **{PROBLEMS: ""})
    view._feed.poll()
    assert view.end == ""
    air.beat(LAUNCHER, "the drive has ended", **{END: "its 30 s are over; passed"})
    view._feed.poll()
    assert view.end == "its 30 s are over; passed"


def test_before_its_beginning_the_page_has_what_the_drive_waits_for_and_no_second_line_about_it():
    air, _, view, _ = idle_page()
    words = "waiting for the start of the scenario"
    air.beat(LAUNCHER, words, **{PROBLEMS: words, WAITS: words})
    view._feed.poll()
    shown = view.state(air.now_s)
    assert (shown["waits"], shown["says"]) == (words, "")
    air.beat(LAUNCHER, "cruise speed", **{PROBLEMS: "cnn exited"})
    view._feed.poll()
    shown = view.state(air.now_s)
    assert (shown["waits"], shown["says"]) == ("", "cnn exited")


def test_the_banner_gets_what_a_standing_car_waits_for_and_the_words_of_the_stop_button():
    air, _, view, _ = idle_page()
    words = "starting: waits for the estimate of cnn (none for 3.1 s)"
    view._feed.decisions.append(decision(t_s=air.now_s, decided_s=air.now_s, waits_for=words))
    assert view.state(air.now_s)["because"] == words
    for said in (STOPPED, *OWN_STOPS):
        air.beat("car", said)
        view._feed.poll()
        shown = view.state(air.now_s)
        assert (shown["because"], shown["stops"], shown["decision"]["cap"]) == (said, True, 0.0)
