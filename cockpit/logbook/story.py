"""The explanation of any moment of a recording: fear, rules, their inputs, and the course of a slow-down.

A slow-down is a clear fall of the speed cap of the supervisor. Where only the measured speed fell, the controller
braked below the cap, as it does for bends, and the explanation states that. Elsewhere the moment is calm, and the
explanation states what would raise fear to its next level: for each input alone, the value at which the rules
reach it.
"""

import math
from itertools import groupby
from typing import Any

import numpy as np

from cockpit.logbook.recall import Recall, of_valid
from cockpit.logbook.slowdowns import CLEAR, DEEP, SlowDown, nearest, significant, slow_downs
from drive.reason import fired_rules
from supervisor.rules.inference import FearRules, Values
from supervisor.rules.rule_file import LEVELS
from supervisor.situation.added import CONFIDENCE, RATED_AS, rating_names
from trepid.messages import Decision, Stop
from trepid.types import Column

_PRECISION = 1e-4  # of the range of an input


def next_level(rules: FearRules, fear: float) -> str | None:
    """The level above that of ``fear``; None at the highest."""
    above = rules.level_index(fear) + 1
    return LEVELS[above] if above < len(LEVELS) else None


def raising(rules: FearRules, values: Values) -> list[tuple[str, float, str]]:
    """Each input that alone would raise fear to a higher level, the value from which it does, and the cause then.

    The inputs are moved towards the worst end of their range, the others held; that which needs the smallest share
    of its range comes first. Empty at the highest level, to which also every missing input leads.
    """
    level = rules.level_index(rules.evaluate(values).fear)
    found = []
    for name, spec in rules.inputs.items():
        low, high = spec.range
        value = values.get(name)
        if value is None or level == len(LEVELS) - 1:
            continue
        calm, worse = min(max(value, low), high), spec.worst
        if not _rises(rules, values, name, worse, level):
            continue
        while abs(worse - calm) > _PRECISION * (high - low):
            middle = (calm + worse) / 2
            calm, worse = (calm, middle) if _rises(rules, values, name, middle, level) else (middle, worse)
        cause = rules.evaluate({**values, name: worse}).cause
        found.append((abs(worse - value) / (high - low), name, worse, cause))
    return [(name, worse, cause) for _, name, worse, cause in sorted(found)]


def _rises(rules: FearRules, values: Values, name: str, value: float, level: int) -> bool:
    return rules.level_index(rules.evaluate({**values, name: value}).fear) > level


BEFORE_S = 10.0  # length of the timeline before the slow-down
AROUND_S = 0.5  # of the given time
STEADY_S = 0.2  # shorter states are left out of the timeline, unless they stop the vehicle
MOST_MOMENTS = 14
_MEASURED_CLEAR = 0.1  # of the cruise speed: the measured speed is noisier than the cap

Story = dict[str, Any]
"""The output of ``trepid fear explain RECORDING --at T --json``; docs/recordings.md lists the fields."""


@of_valid
def story(drive: Recall, at_s: float) -> Story:
    """Why the vehicle slowed down around ``at_s``, or did not. Raises ValueError for a time outside of it."""
    first_s = drive.recorded.first_s - drive.zero_s
    last_s = drive.recorded.last_s - drive.zero_s
    if not first_s - 1e-3 <= at_s <= last_s + 1e-3:
        raise ValueError(f"the recording runs from {first_s:.1f} to {last_s:.1f} s")
    by_supervisor = _cap_falls(drive)
    by_speed = slow_downs(_hold_last(drive.speed_mps), _MEASURED_CLEAR * drive.cruise_mps)
    head: Story = {
        "file": str(drive.recorded.path),
        "at_s": at_s,
        "from_s": round(first_s, 3),
        "to_s": round(last_s, 3),
        "complete": drive.recorded.complete,
        "rules_from": drive.rules_from,
        "corridor": drive.corridor,
        "slowed_by": None,
    }
    slow = nearest(by_supervisor, drive.t_s, at_s)
    if slow is not None:
        return head | {"slowed_by": "supervisor"} | _by_supervisor(drive, slow, at_s)
    slow = nearest(by_speed, drive.t_s, at_s)
    if slow is not None:
        return head | {"slowed_by": "controller"} | _by_controller(drive, slow)
    others = {round(float(drive.t_s[s.before]), 1) for s in (*by_supervisor, *by_speed)}
    nearest_s = sorted(others, key=lambda other_s: abs(other_s - at_s))[:3]
    return head | {"others_s": nearest_s} | _calm(drive, at_s)


def _hold_last(speed_mps: Column) -> Column:
    """The last known speed where it is unknown, which is no slow-down; 0 before the first one."""
    places = np.where(np.isfinite(speed_mps), np.arange(len(speed_mps)), -1)
    last = np.maximum.accumulate(places)
    return np.where(last >= 0, speed_mps[last], 0.0)


@of_valid
def overview(drive: Recall) -> list[Story]:
    """Every slow-down by the supervisor: its course, mode, cause and fear."""
    found = []
    for slow in _cap_falls(drive):
        decision = drive.decisions[_worst(drive, slow)]
        judged = _fields(decision, "mode", "cause", "part", "fear")
        found.append({**_course(drive, slow), **judged, "limited_by": decision.limited_by})
    return found


def _cap_falls(drive: Recall) -> list[SlowDown]:
    """The slow-downs of the speed cap."""
    found = slow_downs(drive.cap_mps, CLEAR * drive.cruise_mps)
    return significant(found, drive.cap_mps, DEEP * drive.cruise_mps)


def _fields(message: object, *names: str) -> Story:
    return {name: getattr(message, name) for name in names}


def _moment(drive: Recall, index: int) -> Story:
    """Decision ``index``, with its rules and their inputs."""
    decision = drive.decisions[index]
    return {
        "moment_s": _at(drive, index),
        **_fields(decision, "mode", "stop", "fear", "level", "cause", "part", "speed_cap_mps", "waits_for"),
        **_fields(decision, "road_user", "road_user_m", "line_warning", "line_crossing_s"),
        "limited_by": decision.limited_by,
        "said": drive.decision_sentence(index),
        "rules": _rules(drive, decision),
        "inputs": _inputs(drive, index),
        "repeats": drive.repeats(index),
        "sight": _sight(drive, index),
        "estimates": _estimates(drive, index),
    }


def _sight(drive: Recall, index: int) -> Story | None:
    """How far the image showed lane and ground; None where it did not say."""
    statistics = drive.statistics_at(index)
    if statistics is None or statistics.sight_m is None:
        return None
    return _fields(statistics, "sight_m", "sight_sigma_m", "sight_cause")


def _calm(drive: Recall, at_s: float) -> Story:
    """The newest decision at ``at_s``, the first one before it, and what would raise its fear to the next level."""
    index = drive.index_at(at_s)
    decision = drive.decisions[index]
    by = drive.rules_of(decision)
    values = dict(zip(decision.inputs, decision.input_values, strict=True))
    fear = max(decision.fear, by.evaluate(values).fear) if values else decision.fear
    return {
        **_moment(drive, index),
        "decision_age_s": round(at_s - float(drive.t_s[index]), 3),
        "cruise_mps": drive.cruise_mps,
        "speed_mps": _known_or_none(drive.speed_mps[index]),
        "next_level": next_level(by, fear),
        "raised_by": _raising_inputs(drive, index, by, values) if values else None,
        "timeline": _timeline(drive, at_s - BEFORE_S, index),
    }


def _raising_inputs(drive: Recall, index: int, by: FearRules, values: Values) -> list[Story]:
    """The inputs that alone would raise fear, with their value and the one from which they do."""
    return [
        {
            "name": name,
            "value": _known_or_none(values[name]),
            "from": worse,
            **_fields(by.inputs[name], "unit", "meaning"),
            "of": _origins(drive, index, by, name, values[name]),
            "cause": cause,
        }
        for name, worse, cause in raising(by, values)
    ]


def _explain(drive: Recall, slow: SlowDown, index: int) -> Story:
    """The slow-down with the decision that explains it."""
    begun_s = float(drive.t_s[slow.before])
    return {
        "slow_down": _course(drive, slow),
        **_moment(drive, index),
        "timeline": _timeline(drive, begun_s - BEFORE_S, slow.end),
    }


def _by_supervisor(drive: Recall, slow: SlowDown, at_s: float) -> Story:
    """The decision with the greatest fear during the fall, or within the second around a later ``at_s``."""
    index = _worst(drive, slow)
    if drive.t_s[slow.lowest] < at_s and (at_s <= drive.t_s[slow.end] or not slow.is_over):
        last = min(drive.index_at(at_s + AROUND_S), slow.end)
        index = _greatest_fear(drive, range(drive.index_at(at_s - AROUND_S), last + 1))
    return {**_explain(drive, slow, index), "end": _end(drive, slow, index)}


def _by_controller(drive: Recall, slow: SlowDown) -> Story:
    """Path and command at the hardest braking of a slow-down below the speed cap."""
    span = range(slow.before, slow.lowest + 1)
    index = min(span, key=lambda i: float(np.nan_to_num(drive.accel_mps2[i])))
    state = drive.state_at(index)
    return {
        **_explain(drive, slow, index),
        "commanded_accel_mps2": _known_or_none(drive.accel_mps2[index]),
        "driver_override": bool(state and state.driver_override),
        "sharpest_curvature_1pm": max(abs(drive.decisions[i].curvature_1pm or 0.0) for i in span),
    }


def _worst(drive: Recall, slow: SlowDown) -> int:
    """The decision with the greatest fear while the speed fell."""
    return _greatest_fear(drive, range(slow.before + 1, slow.lowest + 1))


def _greatest_fear(drive: Recall, indices: range) -> int:
    """Index of the greatest fear, of equal ones the first."""
    return max(indices, key=lambda i: (drive.decisions[i].fear, -i))


def _course(drive: Recall, slow: SlowDown) -> Story:
    speeds = drive.speed_mps[slow.before : slow.end + 1]
    full = np.flatnonzero(drive.cap_mps[: slow.before + 1] >= (1.0 - CLEAR) * drive.cruise_mps)
    return {
        "cruise_mps": drive.cruise_mps,
        "full_speed_until_s": _at(drive, int(full[-1])) if len(full) else None,
        "from_s": _at(drive, slow.before + 1),
        "lowest_s": _at(drive, slow.lowest),
        "until_s": _at(drive, slow.end) if slow.is_over else None,
        "cap_before_mps": float(drive.cap_mps[slow.before]),
        "cap_lowest_mps": float(drive.cap_mps[slow.lowest]),
        "speed_before_mps": _known_or_none(drive.speed_mps[slow.before]),
        "speed_lowest_mps": None if np.isnan(speeds).all() else float(np.nanmin(speeds)),
    }


def _rules(drive: Recall, decision: Decision) -> list[Story]:
    """The rules that fired, by their contribution to fear: strength times the position of their level."""
    by = drive.rules_of(decision)
    at = {rule.text: by.file.fear.all[rule.harm].at for rule in by.rules}
    rules = [
        {"text": text, "strength": strength, "adds": strength * at.get(text, 1.0)}
        for text, strength in fired_rules(decision)
    ]
    return sorted(rules, key=lambda rule: -rule["adds"])


def _origins(drive: Recall, index: int, by: FearRules, name: str, value: float | None) -> list[str]:
    """The estimators whose confidence the input ``name`` has; [] for another input.

    Several share the rules of one name, and the input has the confidence of the surest.
    """
    if value is None or not name.endswith(CONFIDENCE):
        return []
    seen = drive.estimates_at(index)
    rated = rating_names({one: estimate.kind for one, estimate in seen.items()}, by, RATED_AS)
    return [
        one
        for one, estimate in seen.items()
        if rated[one] + CONFIDENCE == name and math.isclose(estimate.confidence, value, abs_tol=1e-9)
    ]


def _inputs(drive: Recall, index: int) -> list[Story]:
    """The inputs of those rules and the missing inputs: value, unit, and degrees of their sets."""
    decision = drive.decisions[index]
    values = dict(zip(decision.inputs, decision.input_values, strict=True))
    if not values:
        return []  # older recordings do not contain the inputs
    by = drive.rules_of(decision)
    about = {rule.text: rule.inputs for rule in by.rules if rule.harm > 0}
    named = [name for text in decision.rules for name in by.inputs if name in about.get(text, ())]
    named += [name for name, value in values.items() if _known_or_none(value) is None]
    degrees = by.memberships(values)
    return [
        {
            "name": name,
            "value": _known_or_none(values.get(name)),
            **_fields(by.inputs[name], "unit", "meaning"),
            "of": _origins(drive, index, by, name, values.get(name)),
            "sets": {level: degree for level, degree in degrees[name].items() if degree > 0},
        }
        for name in dict.fromkeys(named)
        if name in by.inputs
    ]


def _estimates(drive: Recall, index: int) -> list[Story]:
    """Every estimate and its trust."""
    decision = drive.decisions[index]
    trust = dict(zip(decision.sources, decision.trust, strict=True))
    return [
        {
            "estimator": name,
            "age_s": decision.decided_s - estimate.t_s,
            **_fields(
                estimate, "lateral_offset_m", "heading_error_rad", "curvature_1pm", "confidence", "reason"
            ),
            "trust": trust.get(name, 0.0),
        }
        for name, estimate in drive.estimates_at(index).items()
    ]


def _timeline(drive: Recall, from_s: float, last: int) -> list[Story]:
    """Changes of mode, stop, cause and source of the path from ``from_s`` to decision ``last``."""
    first = drive.index_at(from_s)
    moments: list[Story] = []
    for state, group in groupby(
        range(first, last + 1),
        key=lambda i: _fields(drive.decisions[i], "mode", "stop", "cause", "path_source"),
    ):
        stretch = list(group)
        i, j = stretch[0], stretch[-1]
        lasting = drive.t_s[min(j + 1, last)] - drive.t_s[i] >= STEADY_S
        kept = lasting or i == first or j == last or state["stop"] is not Stop.NONE
        if kept and not (moments and state.items() <= moments[-1].items()):
            fear = max(d.fear for d in drive.decisions[i : j + 1])
            part = drive.decisions[i].part
            moments.append(
                {
                    "t_s": _at(drive, i),
                    **state,
                    "part": part,
                    "fear": fear,
                    "cap_mps": float(drive.cap_mps[j]),
                }
            )
    return moments[:MOST_MOMENTS]


def _end(drive: Recall, slow: SlowDown, worst: int) -> Story:
    """The time at which fear allowed more speed again, and the inputs then and at the greatest fear."""
    allowed = drive.cap_mps[slow.before] / drive.cruise_mps if drive.cruise_mps else 0.0
    relief = None
    for i in range(slow.end, worst, -1):
        decision = drive.decisions[i]
        factor = drive.rules_of(decision).speed_factor(decision.fear)
        if decision.stop is not Stop.NONE or factor < allowed - CLEAR:
            break
        relief = i
    if relief is None:
        return {"relief_s": None, "back_s": None, "cause": None, "changes": []}
    decision = drive.decisions[relief]
    now = dict(zip(decision.inputs, decision.input_values, strict=True))
    return {
        "relief_s": _at(drive, relief),
        "back_s": _at(drive, slow.end) if slow.is_over else None,
        "cause": decision.cause,
        "changes": [
            {
                "name": item["name"],
                "unit": item["unit"],
                "was": item["value"],
                "is": _known_or_none(now.get(item["name"])),
            }
            for item in _inputs(drive, worst)
            if item["value"] != _known_or_none(now.get(item["name"]))
        ],
    }


def _at(drive: Recall, index: int) -> float:
    return round(float(drive.t_s[index]), 3)


def _known_or_none(value: float | None) -> float | None:
    """``value``, or None where it is missing or not finite (null in JSON)."""
    return float(value) if value is not None and math.isfinite(value) else None
