"""Scores of a run, computed from its trace alone.

Samples hold until the next one, so means and durations are weighted by the time between samples and do not
depend on an even sample rate.
"""

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drive.tally import autonomy_percent, has_driven
from sim_harness.judging.comfort import max_lateral_jerk_mps3, max_r79_jerk_mps3, steering_reversals_per_min
from sim_harness.judging.fear_scores import (
    driven_fear,
    fear_auroc,
    fear_lead_time_s,
    nuisance_slowdowns_per_km,
)
from sim_harness.judging.margins import (
    lane_edge_distance_m,
    time_gap_s,
    time_to_collision_s,
    time_to_crossing_s,
)
from sim_harness.judging.trace import USER_GAP, Trace
from supervisor.modes.modes import DRIVING, STARTING
from trepid.messages import Mode
from trepid.types import Column


@dataclass(frozen=True, slots=True, kw_only=True)
class Metrics:
    """The scores of every run; None where there is nothing to score."""

    duration_s: float
    distance_m: float  # along the lane centre line
    departures: int  # a wheel over the lane edge
    interventions: int  # re-centred after a departure or beyond 1 m; in a live drive also by a person
    autonomy_percent: float | None  # None for a car that did not drive
    max_lateral_error_m: float
    rms_lateral_error_m: float
    max_lateral_accel_mps2: float
    max_lateral_jerk_mps3: float
    max_decel_mps2: float
    collisions: int
    min_time_gap_s: float | None
    mean_speed_mps: float
    max_fear: float | None  # from the start of driving on
    mean_fear: float | None
    modes: dict[str, float]  # name -> seconds
    causes: dict[str, float]  # name -> seconds
    engaged_percent: float  # share of the time in a mode that drives
    stop_cause: str | None  # of the last stop; None without a stop after the start


def measure(trace: Trace) -> Metrics:
    """Scores of ``trace``. Raises ValueError when it spans no time.

    A car that did not drive (:func:`~drive.tally.has_driven`) has no autonomy.
    """
    t_s = trace["t_s"]
    duration_s = float(t_s[-1] - t_s[0]) if len(trace) else 0.0
    if duration_s <= 0.0:
        raise ValueError(f"a trace of {len(trace)} samples over {duration_s} s cannot be scored")
    distance_m = float(trace["station_m"][-1] - trace["station_m"][0])
    interventions = int(trace["interventions"][-1])
    fear = driven_fear(trace)
    engaged_percent = _engaged_share_percent(trace)
    offset_m = trace["lateral_offset_m"]
    return Metrics(
        duration_s=duration_s,
        distance_m=distance_m,
        departures=int(trace["departures"][-1]),
        interventions=interventions,
        autonomy_percent=autonomy_percent(interventions, duration_s)
        if has_driven(distance_m, engaged_percent)
        else None,
        max_lateral_error_m=float(np.abs(offset_m).max()),
        rms_lateral_error_m=float(np.sqrt(_time_mean(t_s, offset_m**2) or 0.0)),
        max_lateral_accel_mps2=float(np.abs(trace["lateral_accel_mps2"]).max()),
        max_lateral_jerk_mps3=max_lateral_jerk_mps3(trace),
        max_decel_mps2=max(0.0, float(-trace["longitudinal_accel_mps2"].min())),
        collisions=int(trace["collisions"][-1]),
        min_time_gap_s=_least(time_gap_s(trace)),
        mean_speed_mps=distance_m / duration_s,
        max_fear=None if np.isnan(fear).all() else float(np.nanmax(fear)),
        mean_fear=_time_mean(t_s, fear),
        modes=_seconds_by_word(trace, "mode"),
        causes=_seconds_by_word(trace, "cause"),
        engaged_percent=engaged_percent,
        stop_cause=_stop_cause(trace),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class FurtherMetrics:
    """Further scores of one run, each defined where it is computed; None where there is nothing to score.

    In a lock-step run the car is re-centred in the period in which it leaves the lane, so that the least lane edge
    distance is that of the last sample inside the lane.
    """

    max_r79_jerk_mps3: float
    steering_reversals_per_min: float | None
    min_time_to_crossing_s: float | None
    min_lane_edge_distance_m: float
    min_time_to_collision_s: float | None
    min_road_user_gap_m: float | None
    fear_lead_time_s: float | None
    fear_auroc: float | None
    nuisance_slowdowns_per_km: float | None


def measure_further(trace: Trace) -> FurtherMetrics:
    """Further scores of ``trace``, which must span some time."""
    return FurtherMetrics(
        max_r79_jerk_mps3=max_r79_jerk_mps3(trace),
        steering_reversals_per_min=steering_reversals_per_min(trace),
        min_time_to_crossing_s=_least(time_to_crossing_s(trace)),
        min_lane_edge_distance_m=float(lane_edge_distance_m(trace).min()),
        min_time_to_collision_s=_least(time_to_collision_s(trace)),
        min_road_user_gap_m=_least(trace[USER_GAP]) if USER_GAP in trace.columns else None,
        fear_lead_time_s=fear_lead_time_s(trace),
        fear_auroc=fear_auroc(trace),
        nuisance_slowdowns_per_km=nuisance_slowdowns_per_km(trace),
    )


def _least(values: Column) -> float | None:
    """The least of the finite ``values``; None when there are none: absent, or never to come."""
    finite = values[np.isfinite(values)]
    return float(finite.min()) if len(finite) else None


def _hold_times_s(t_s: Column) -> Column:
    """How long each sample holds [s]; the last one ends the run."""
    return np.append(np.diff(t_s), 0.0)


def _time_mean(t_s: Column, values: Column) -> float | None:
    """Mean over time of the finite ``values``; None when there are none."""
    held_s = np.where(np.isfinite(values), _hold_times_s(t_s), 0.0)
    total_s = held_s.sum()
    return float((np.nan_to_num(values) * held_s).sum() / total_s) if total_s > 0.0 else None


def _has_mode(trace: Trace, modes: Collection[str]) -> NDArray[np.bool_]:
    """For every sample, whether its decision has one of ``modes``; False before the first decision."""
    return np.isin(trace["mode"], [i for i, word in enumerate(trace.words["mode"]) if word in modes])


def _engaged_share_percent(trace: Trace) -> float:
    """Share of the time in a mode that drives [%]."""
    held_s = _hold_times_s(trace["t_s"])
    return float(100.0 * held_s[_has_mode(trace, DRIVING)].sum() / held_s.sum())


def _stop_cause(trace: Trace) -> str | None:
    """The cause with which the last stop began; None without a stop but that in which a supervisor starts."""
    stopped = _has_mode(trace, {Mode.STOP})
    began = np.flatnonzero(stopped & ~np.append(False, stopped[:-1]))
    cause = trace.words["cause"][int(trace["cause"][began[-1]])] if len(began) else None
    return None if cause == STARTING and not stopped[-1] else cause


def _seconds_by_word(trace: Trace, label: str) -> dict[str, float]:
    """Seconds for which each word of a label column held, in order of first appearance."""
    held_s, codes = _hold_times_s(trace["t_s"]), trace[label]
    return {word: round(float(held_s[codes == i].sum()), 6) for i, word in enumerate(trace.words[label])}


MEANINGS = {
    "status": "passed when the run satisfied all its criteria; not driven when it did, but the car stood",
    "duration_s": "simulated time of the run",
    "distance_m": "distance along the lane centre line",
    "departures": "a wheel was over the edge of the lane",
    "interventions": "the car was re-centred after a departure or beyond 1 m, or a person took over",
    "collisions": "contacts with other vehicles",
    "autonomy_percent": "100 (1 - 6 s x interventions / duration)",
    "max_lateral_error_m": "greatest distance of the rear axle from the lane centre",
    "rms_lateral_error_m": "root mean square distance of the rear axle from the lane centre",
    "max_lateral_accel_mps2": "greatest lateral acceleration at the rear axle",
    "max_lateral_jerk_mps3": "greatest lateral jerk, mean over 0.5 s (ISO 11270)",
    "max_r79_jerk_mps3": "greatest lateral jerk of the filtered acceleration (UN R79)",
    "max_decel_mps2": "greatest deceleration",
    "min_time_gap_s": "least gap to the vehicle ahead, divided by the own speed",
    "mean_speed_mps": "distance divided by time",
    "max_fear": "greatest fear from the start of driving",
    "mean_fear": "mean fear over time, from the start of driving",
    "modes": "time in each mode of the supervisor",
    "causes": "time with each cause of fear",
    "engaged_percent": "share of the time in a mode that drives",
    "stop_cause": "the cause with which the last stop began",
    "waits_for": "what the car waits for at the end",
    "realtime_factor": "simulated time divided by computing time",
    "trace_sha256": "hash of all samples; equal for bit-identical runs",
    "steering_reversals_per_min": "swings of the steering wheel by at least 2 degrees (SAE J2944)",
    "min_time_to_crossing_s": "least time until a wheel crosses the edge of the lane with the steering held",
    "min_lane_edge_distance_m": "least distance of a wheel from the edge of the lane; negative beyond it",
    "min_road_user_gap_m": "least distance from a person, cyclist or animal; 0 in contact",
    "min_time_to_collision_s": "least gap divided by the closing speed",
    "fear_lead_time_s": "shortest time of at least medium fear before a departure",
    "fear_auroc": "probability that fear is higher before a departure than elsewhere",
    "nuisance_slowdowns_per_km": "slow-downs by fear without a reason in the scenario",
}
