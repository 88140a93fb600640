"""Summary of a run for the report page, a few kilobytes that a worker process sends instead of the trace.

Numbers are whole multiples of a step, each as the difference from the previous one; null is absent:
``{"step": 0.01, "d": [500, -3, null, …]}``.
"""

import base64
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sim_harness.judging.conditions.signals import COUNTERS, EVENT_COLUMNS
from sim_harness.judging.fear_scores import afraid
from sim_harness.judging.margins import default_vehicle, time_gap_s
from sim_harness.judging.trace import Trace
from sim_harness.lockstep.closed_loop import Result
from sim_harness.report.film import Film, picture, small_picture
from sim_harness.scenarios.scenario import Scenario
from trepid.types import Column

EVEN_SAMPLES, STRETCHES = 120, 30  # kept samples: evenly spaced ones, and the extremes of every interval
EDGE_POINTS = 240
BEYOND_M = 10.0  # of the route, at both ends of an open road
CALM_AFTER_S = 1.0  # fear before it, without any estimate yet, is left out
LONGEST_GAP_S = 10.0
MOST_FRAMES = 40  # of a run: 8 kB each
SHOWN_RULES, LEAST_STRENGTH = 6, 0.05  # of the rules that fired
BANDS = ("mode", "cause", "section")

Detail = dict[str, Any]


def summarise(scenario: Scenario, result: Result, film: Film | None = None) -> Detail:
    """Path, lane edges, timelines and events of a run, and with a ``film`` its worst frame, ready for JSON."""
    trace = result.trace
    kept = kept_samples(trace)
    t_s = trace["t_s"] - trace["t_s"][0]
    room_m = trace["lane_width_m"] / 2 - default_vehicle().track_m / 2
    series = {
        "t": (t_s, 0.01),
        "x": (trace["x_m"], 0.05),
        "y": (trace["y_m"], 0.05),
        "fear": (trace["decision.fear"], 0.001),
        "speed": (trace["speed_mps"], 0.01),
        "cap": (trace["decision.speed_cap_mps"], 0.01),
        "error": (trace["lateral_offset_m"], 0.001),
        "seen": (trace["decision.lateral_offset_m"], 0.001),
        "room": (room_m, 0.001),
        "gap": (np.minimum(time_gap_s(trace), LONGEST_GAP_S), 0.01),
    }
    return {
        "series": {name: code_differences(values[kept], step) for name, (values, step) in series.items()},
        "bands": {label: _words(trace, label, t_s) for label in BANDS},
        "events": _events(trace, t_s),
        "marks": _marks(trace, t_s),
        "edges": _edges(scenario, trace),
        "glimpses": _glimpses(trace, film) if film else None,
        "frames": _frames(trace, film) if film else None,
        "picture": _picture(trace, film) if film else None,
    }


def kept_samples(trace: Trace) -> NDArray[np.intp]:
    """The kept samples: evenly spaced ones, and the extremes of fear, speed and error in every interval."""
    samples = np.arange(len(trace))
    chosen = [np.linspace(0, len(trace) - 1, EVEN_SAMPLES).round().astype(np.intp)]
    for stretch in np.array_split(samples, min(STRETCHES, len(trace))):
        for name in ("decision.fear", "speed_mps", "lateral_offset_m"):
            values = trace[name][stretch]
            if np.isfinite(values).any():
                chosen.append(stretch[[np.nanargmin(values), np.nanargmax(values)]])
    return np.unique(np.concatenate(chosen))


def worst_sample(trace: Trace) -> tuple[int, str]:
    """The sample to show, and the reason: the last one before the first departure; else that of the greatest fear;
    without any fear that of the largest error."""
    left = np.flatnonzero(np.diff(trace["departures"]) > 0)
    if len(left):
        return int(left[0]), "just before the first departure"
    later = trace["t_s"] - trace["t_s"][0] >= CALM_AFTER_S
    if (afraid(trace) & later).any():
        return int(np.nanargmax(np.where(later, trace["decision.fear"], np.nan))), "at the greatest fear"
    return int(np.argmax(np.abs(trace["lateral_offset_m"]))), "at the largest error"


def code_differences(values: Column, step: float) -> dict[str, Any]:
    """``values`` as differences of whole multiples of ``step``, NaN as None."""
    known = np.isfinite(values)
    whole = np.where(known, np.round(np.where(known, values, 0.0) / step), 0.0).astype(int)
    differences: list[int | None] = [None] * len(values)
    last = 0
    for i in np.flatnonzero(known).tolist():
        differences[i] = int(whole[i]) - last
        last = int(whole[i])
    return {"step": step, "d": differences}


def _words(trace: Trace, label: str, t_s: Column) -> list[list[Any]]:
    """[from, word] of every stretch of a label; None before the first decision."""
    codes = trace[label]
    starts = [0, *(np.flatnonzero(np.diff(codes)) + 1).tolist()]
    words = trace.words[label]
    return [[round(float(t_s[i]), 2), words[int(codes[i])] if codes[i] >= 0 else None] for i in starts]


def _events(trace: Trace, t_s: Column) -> list[list[Any]]:
    """[name, from, to] of faults, disturbances and manoeuvres."""
    events = []
    for name, column in trace.columns.items():
        if name.split(".")[0] not in EVENT_COLUMNS:
            continue
        there = np.concatenate([[False], column > 0, [False]])
        edges = np.flatnonzero(np.diff(there.astype(int)))
        for start, stop in zip(edges[::2], edges[1::2], strict=True):
            end_s = t_s[min(stop, len(t_s) - 1)]
            events.append([name.split(".", 1)[1], round(float(t_s[start]), 2), round(float(end_s), 2)])
    return events


def _marks(trace: Trace, t_s: Column) -> list[list[Any]]:
    """[name, time] of departures, interventions and collisions."""
    marks = []
    for name, count in COUNTERS.items():
        rises = np.diff(trace[count], prepend=0.0) > 0
        marks += [[name, round(float(t), 2)] for t in t_s[rises]]
    return marks


def _edges(scenario: Scenario, trace: Trace) -> list[dict[str, Any]]:
    """x and y of the left edge of the lane, then of the right one, along the route.

    In a world of another package those beside the car at the samples of ``trace``.
    """
    if scenario.world is not None:
        return [code_differences(values, 0.05) for values in _edges_beside(trace)]
    road = scenario.build_road()
    low_m, high_m = 0.0, road.length_m
    if not road.closed:
        low_m = scenario.start.station_m - BEYOND_M
        high_m = scenario.start.station_m + scenario.route_m(road) + BEYOND_M
    stations_m = np.linspace(low_m, high_m, EDGE_POINTS)
    half_m = np.array([road.width_at(station) for station in stations_m.tolist()]) / 2
    edges = [road.positions(stations_m, side * half_m) for side in (1.0, -1.0)]
    return [code_differences(points[:, axis], 0.05) for points in edges for axis in (0, 1)]


def _edges_beside(trace: Trace) -> Iterator[Column]:
    """x and y of the left edge of the lane beside the car, then of the right one."""
    samples = np.linspace(0, len(trace) - 1, min(EDGE_POINTS, len(trace))).round().astype(np.intp)
    course_rad = (trace["yaw_rad"] - trace["heading_error_rad"])[samples]
    half_m, offset_m = trace["lane_width_m"][samples] / 2, trace["lateral_offset_m"][samples]
    for left_m in (half_m - offset_m, -half_m - offset_m):
        yield trace["x_m"][samples] - left_m * np.sin(course_rad)
        yield trace["y_m"][samples] + left_m * np.cos(course_rad)


def _glimpses(trace: Trace, film: Film) -> dict[str, Any]:
    """Times, places of the other vehicles, and the texts and strengths of the rules that fired most strongly.

    ``others``: x, y and yaw of each vehicle; ``fired``: [number of the text, strength in percent] at each time.
    """
    first_s = float(trace["t_s"][0])
    glimpses = [one for one in film.glimpses if one.t_s >= first_s - 1e-6]
    texts: dict[str, int] = {}
    fired = [
        [
            [texts.setdefault(text, len(texts)), round(100 * strength)]
            for text, strength in one.rules[:SHOWN_RULES]
            if strength >= LEAST_STRENGTH
        ]
        for one in glimpses
    ]
    vehicles = len(glimpses[0].others) if glimpses else 0
    places = np.array([one.others for one in glimpses], dtype=np.float64).reshape(len(glimpses), vehicles, 3)
    others = [
        [code_differences(places[:, number, axis], step) for axis, step in enumerate((0.05, 0.05, 0.01))]
        for number in range(vehicles)
    ]
    times = code_differences(np.array([one.t_s for one in glimpses]) - first_s, 0.01)
    vehicle = default_vehicle()
    length_m = vehicle.rear_overhang_m + vehicle.wheelbase_m + vehicle.front_overhang_m
    size = [round(length_m, 2), round(vehicle.track_m, 2), round(vehicle.rear_overhang_m, 2)]
    return {"t": times, "others": others, "size": size, "texts": list(texts), "fired": fired}


def _frames(trace: Trace, film: Film) -> list[list[Any]] | None:
    """[time, data URI] of up to MOST_FRAMES frames, evenly spread; None without pictures."""
    first_s = float(trace["t_s"][0])
    shots = [shot for shot in film.shots if shot.t_s >= first_s - 1e-6 and shot.estimates]
    if not shots:
        return None
    chosen = np.unique(np.linspace(0, len(shots) - 1, MOST_FRAMES).round().astype(int))
    return [[round(shots[i].t_s - first_s, 2), _uri(small_picture(shots[i]))] for i in chosen]


def _uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def _picture(trace: Trace, film: Film) -> dict[str, Any] | None:
    """The worst frame with overlay as a data URI, its time, and the reason; None without pictures."""
    sample, reason = worst_sample(trace)
    shot = film.at(float(trace["t_s"][sample]))
    if shot is None:
        return None
    jpeg, estimator = picture(shot)
    return {
        "uri": _uri(jpeg),
        "t": round(shot.t_s - float(trace["t_s"][0]), 2),
        "why": reason,
        "estimator": estimator,
    }
