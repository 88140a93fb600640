"""The state of a drive as the page shows it: one dictionary of plain values, null where something is not known."""

import json
import math
from typing import Any

from cockpit.page.feed import Feed
from cockpit.page.history import PathHistory, Timelines
from cockpit.page.overlay import overlay
from cockpit.page.stop import Hold
from drive.reason import fired_rules, own_stop, reason, speed_limit_mps, task
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.causes import in_words, line_words
from trepid.messages import Command, CompressedFrame, Decision, Diagnostic, SteeringEstimate, Timing
from trepid.processes.register import END, PROBLEMS, PROCESS, WAITS
from vehicle.driver.stop_button import STOPPED

FRESH_S = 1.0  # older messages are not shown as the present
LATE_BEAT_S = 2.5  # an older heartbeat, or report of times: the process is silent
RULES_SHOWN = 5
OVERLAY_S = 0.15  # estimates and decisions this much older than a picture are not drawn on it
SERIES = ("fear", "speed", "cap", "error", "latency")
"""Timelines before the confidences of the estimators: fear, speed and its cap [m/s], lateral error [m], the time
from frame to actuator [ms]."""


class PageView:
    """What a page shows of the messages of a :class:`Feed`."""

    def __init__(
        self,
        feed: Feed,
        camera: Camera,
        vehicle: Vehicle,
        *,
        holder: str | None,
        what: str,
        drive: str = "",
        no_keep: str = "",
    ) -> None:
        """``holder``: name of the process that obeys the stop button, the one that publishes the vehicle state.

        ``drive``: another text for every drive; ``no_keep``: why the last minutes cannot be kept.
        """
        self._feed, self._camera, self._vehicle, self._holder = feed, camera, vehicle, holder
        self._of_drive = {"what": what, "drive": drive, "no_keep": no_keep}
        self.timelines = Timelines((*SERIES, *feed.estimates))
        self.track = PathHistory(0.5 * vehicle.scale)

    def sample(self, now_s: float) -> None:
        """Add to the timelines and to the driven path when it is time."""
        if not self.timelines.due(now_s):
            return
        feed = self._feed
        state, truth = feed.state.refresh(), feed.truth.refresh()
        state = state if state is not None and now_s - state.t_s <= FRESH_S else None
        truth = truth if truth is not None and now_s - truth.t_s <= FRESH_S else None
        decision = _fresh_decision(feed.decision, now_s)
        fear = decision.fear if decision else None
        self.track.add(state, truth, fear)
        error_m = truth.lateral_offset_m if truth else decision.lateral_offset_m if decision else None
        latency = _spread(_latencies_ms(feed.applied, now_s))
        latency_ms = latency["p50"] if latency else None
        judged = {} if decision is None else dict(zip(decision.inputs, decision.input_values, strict=False))
        confidences = [
            _confidence(list(of_one), now_s) if feed.looking else judged.get(f"{name}_confidence")
            for name, of_one in feed.estimates.items()
        ]
        speed_mps = state.speed_mps if state else None
        cap_mps = self._limit_mps(decision, feed.command.refresh(), now_s) if decision else None
        self.timelines.add(now_s, [fear, speed_mps, cap_mps, error_m, latency_ms, *confidences])

    def state(self, now_s: float) -> dict[str, Any]:
        """Everything but picture, timelines and path."""
        feed = self._feed
        decision, state = _fresh_decision(feed.decision, now_s), feed.state.refresh()
        state = state if state is not None and now_s - state.t_s <= FRESH_S else None
        hold, command = self.hold(now_s), feed.command.refresh()
        reported = {} if feed.report is None else dict(feed.report.values)
        waits = reported.get(WAITS, "")
        stops = self._own_stop(now_s)
        driver = bool(state and state.driver_override)
        speed_mps = None if state is None else state.speed_mps
        shown = None if decision is None else _decision(decision)
        if decision is not None and shown is not None:
            shown["cap"] = self._limit_mps(decision, command, now_s)
        return {
            "now": now_s,
            **self._of_drive,
            "says": "" if waits or feed.report is None else reported.get(PROBLEMS, feed.report.message),
            "waits": waits,
            "because": stops or reason(decision, command=command, driver=driver),
            "task": task(decision, stops=stops, driver=driver),
            "held": hold is not None and hold.held,
            "stops": bool(stops),
            "stands": speed_mps is not None and abs(speed_mps) <= self._vehicle.standstill_mps,
            "speed": speed_mps,
            "true_error": self.track.true,
            "decision": shown,
            "estimates": {name: _estimate(list(of_one), now_s) for name, of_one in feed.estimates.items()},
            "lead": self._lead(now_s),
            "latency": _spread(_latencies_ms(feed.applied, now_s)),
            "processes": self._processes(now_s),
            "pose": self.track.pose,
            "driven": round(self.track.driven_m, 1),
        }

    def hold(self, now_s: float) -> Hold | None:
        """What the vehicle process reports of the stop button; None while it is silent."""
        beat = self._holding_beat(now_s)
        return None if beat is None else Hold(beat.t_s, beat.message.startswith(STOPPED))

    @property
    def end(self) -> str:
        """Why the drive ended and how it was judged, by the last report of the launcher; "" before."""
        report = self._feed.report
        return "" if report is None else dict(report.values).get(END, "")

    def _holding_beat(self, now_s: float) -> Diagnostic | None:
        """The newest heartbeat of the process that obeys the stop button; None while it is silent."""
        beat = self._feed.beats.get(self._holder or "")
        return None if beat is None or abs(now_s - beat.t_s) > LATE_BEAT_S else beat

    def _own_stop(self, now_s: float) -> str:
        """Why this process stops the car, whatever the decision; "": it does not."""
        beat = self._holding_beat(now_s)
        return "" if beat is None else own_stop([beat])

    def _limit_mps(self, decision: Decision, command: Command | None, now_s: float) -> float:
        """The highest speed that supervisor, controller and vehicle process allow [m/s]."""
        return 0.0 if self._own_stop(now_s) else speed_limit_mps(decision, command)

    def overlay_of(self, picture: CompressedFrame) -> dict[str, Any]:
        """The overlay of ``picture``: by the estimates and the decision of its frame, or the last ones before."""
        feed = self._feed
        estimates = (_at(list(of_one), picture.t_s) for of_one in feed.estimates.values())
        lead, road_users = feed.lead.refresh(), feed.road_users.refresh()
        return overlay(
            [estimate for estimate in estimates if estimate is not None],
            self.decision_of(picture),
            lead if lead is not None and abs(picture.t_s - lead.t_s) <= FRESH_S else None,
            self._camera,
            self._vehicle,
            road_users if road_users and abs(picture.t_s - road_users.t_s) <= FRESH_S else None,
        )

    def decision_of(self, picture: CompressedFrame) -> Decision | None:
        """The decision on the frame of ``picture``, or the last one before."""
        decisions = [one for one in self._feed.decisions if one.t_s is not None]
        return max(
            (one for one in decisions if 0.0 <= picture.t_s - (one.t_s or 0.0) <= OVERLAY_S),
            key=lambda one: one.t_s or 0.0,
            default=None,
        )

    def _lead(self, now_s: float) -> dict[str, Any] | None:
        lead = self._feed.lead.refresh()
        if lead is None or lead.distance_m is None or now_s - lead.t_s > FRESH_S:
            return None
        if not math.isfinite(lead.distance_m):
            return None
        return {"distance": lead.distance_m, "speed": lead.speed_mps, "confidence": lead.confidence}

    def _processes(self, now_s: float) -> list[dict[str, Any]]:
        """The rows of the launcher's report; the age grows while the launcher is silent."""
        report = self._feed.report
        rows = [] if report is None else [json.loads(v) for k, v in report.values if k.startswith(PROCESS)]
        for row in rows:
            beat = self._feed.beats.get(row["name"])
            row["age_s"] = round(now_s - beat.t_s, 1) if beat is not None else row["age_s"]
            silent = row["heartbeat"] and (row["age_s"] is None or row["age_s"] > LATE_BEAT_S)
            row["well"] = row["alive"] and not silent and row["health"] in ("", "ok")
        return rows


def _fresh_decision(decision: Decision | None, now_s: float) -> Decision | None:
    return decision if decision is not None and now_s - decision.decided_s <= FRESH_S else None


def _decision(decision: Decision) -> dict[str, Any]:
    return {
        "mode": decision.mode,
        "stop": decision.stop,
        "fear": decision.fear,
        "level": decision.level,
        "cause": decision.cause,
        "cause_words": in_words(decision.cause, decision.part),
        "rules": [[text, round(strength, 3)] for text, strength in fired_rules(decision)][:RULES_SHOWN],
        "inputs": dict(zip(decision.inputs, decision.input_values, strict=False)),
        "source": decision.path_source,
        "sight": decision.sight_m,
        "sight_cause": decision.sight_cause,
        "error": decision.lateral_offset_m,
        "line_warning": decision.line_warning,
        "line_words": line_words(decision.line_warning),
    }


def _estimate(newest_last: list[SteeringEstimate], now_s: float) -> dict[str, Any] | None:
    if not newest_last or now_s - newest_last[-1].t_s > FRESH_S:
        return None
    newest = newest_last[-1]
    return {
        "confidence": newest.confidence,
        "reason": newest.reason,
        "latency_ms": newest.latency_ms,
        "offset": newest.lateral_offset_m,
    }


def _confidence(newest_last: list[SteeringEstimate], now_s: float) -> float | None:
    fresh = newest_last and now_s - newest_last[-1].t_s <= FRESH_S
    return newest_last[-1].confidence if fresh else None


def _at(estimates: list[SteeringEstimate], t_s: float) -> SteeringEstimate | None:
    fitting = [one for one in estimates if 0.0 <= t_s - one.t_s <= OVERLAY_S]
    return max(fitting, key=lambda one: one.t_s, default=None)


def _latencies_ms(applied: Timing | None, now_s: float) -> list[float]:
    """From the capture of a frame to its command at the actuator, of the frames of the last second."""
    if applied is None or now_s - applied.t_s > LATE_BEAT_S:
        return []
    return [1e3 * (sent - frame) for frame, sent in zip(applied.frame_s, applied.sent_s, strict=True)]


def _spread(values: list[float]) -> dict[str, float] | None:
    """Median and greatest of some durations."""
    if not values:
        return None
    return {"p50": round(sorted(values)[len(values) // 2], 2), "max": round(max(values), 2)}
