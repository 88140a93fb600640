"""Criteria of a run, and their judgement."""

from typing import TYPE_CHECKING, Annotated

from pydantic import AfterValidator, Field

from drive.tally import DRIVEN_M, has_driven
from sim_harness.judging.conditions.meaning import parse_condition
from sim_harness.judging.trace import Trace
from trepid.config import Settings
from trepid.types import Positive

if TYPE_CHECKING:  # scipy is slow to import, and the processes of a drive judge nothing
    from sim_harness.judging.metrics import Metrics

STANDSTILL_MPS = 0.01


def _sentence(text: str) -> str:
    parse_condition(text)
    return text


Sentence = Annotated[str, AfterValidator(_sentence)]
"""The text of a valid condition."""


class Expect(Settings):
    """Criteria that a run must satisfy; an absent one is not judged."""

    max_departures: Annotated[int, Field(ge=0)] = 0
    max_interventions: Annotated[int, Field(ge=0)] = 0
    max_collisions: Annotated[int, Field(ge=0)] = 0
    max_lateral_error_m: Positive | None = None
    max_lateral_accel_mps2: Positive | None = None
    max_lateral_jerk_mps3: Positive | None = None
    max_decel_mps2: Positive | None = None
    min_mean_speed_mps: Positive | None = None
    min_time_gap_s: Positive | None = None
    must_finish: bool = False  # drive the whole route
    must_stop_by_s: Positive | None = None  # drive, then stand still from this time to the end of the run
    must_stand: bool = False  # not drive at all: any other run in which the car stands is "not driven"
    conditions: tuple[Sentence, ...] = ()  # sentences over time; grammar: docs/conditions.md

    def shorten(self, duration_s: float) -> "Expect":
        """Without the criteria that need a run longer than ``duration_s``."""
        dropped: dict[str, object] = {"must_finish": False, "min_mean_speed_mps": None, "conditions": ()}
        if self.must_stop_by_s is not None and self.must_stop_by_s > duration_s:
            dropped["must_stop_by_s"] = None
        return self.model_copy(update=dropped)


def judge(expect: Expect, metrics: "Metrics", trace: Trace) -> list[str]:
    """The reasons for which a run failed; empty when it passed."""
    most = {
        "departures": expect.max_departures,
        "interventions": expect.max_interventions,
        "collisions": expect.max_collisions,
        "max_lateral_error_m": expect.max_lateral_error_m,
        "max_lateral_accel_mps2": expect.max_lateral_accel_mps2,
        "max_lateral_jerk_mps3": expect.max_lateral_jerk_mps3,
        "max_decel_mps2": expect.max_decel_mps2,
    }
    least = {"mean_speed_mps": expect.min_mean_speed_mps, "min_time_gap_s": expect.min_time_gap_s}
    reasons = []
    for name, limit in (most | least).items():
        value = getattr(metrics, name)
        if limit is not None and (value is None or (value > limit if name in most else value < limit)):
            found = "unknown" if value is None else f"{value:.4g}"
            reasons.append(f"{name} {found}: expected at {'most' if name in most else 'least'} {limit:.4g}")
    if expect.must_finish and not trace["finished"][-1]:
        reasons.append("the route was not driven to its end")
    if expect.must_stop_by_s is not None:
        reasons += _judge_stop(expect.must_stop_by_s, trace)
    if expect.must_stand and metrics.distance_m >= DRIVEN_M:
        reasons.append(f"the car went {metrics.distance_m:.1f} m: expected to stand (must_stand)")
    conditions = map(parse_condition, expect.conditions)
    return reasons + [c.explain(trace) for c in conditions if c.robustness(trace) < 0]


def is_driven(expect: Expect, metrics: "Metrics") -> bool:
    """Whether the car drove by itself, or was not to: a run in which it stood proves nothing else."""
    return expect.must_stand or has_driven(metrics.distance_m, metrics.engaged_percent)


def _judge_stop(by_s: float, trace: Trace) -> list[str]:
    """Reasons unless the vehicle drove, then stood still from ``by_s`` after the start to the end."""
    elapsed_s = trace["t_s"] - trace["t_s"][0]
    moving = elapsed_s[trace["speed_mps"] > STANDSTILL_MPS]
    if elapsed_s[-1] < by_s:
        return [f"the run ended before {by_s:.4g} s, the latest time for the stop"]
    if len(moving) == 0:
        return ["the vehicle never moved: must_stop_by_s needs a vehicle that drove"]
    if moving[-1] >= by_s:
        return [f"the vehicle moved at {moving[-1]:.2f} s: expected to stand from {by_s:.4g} s on"]
    return []
