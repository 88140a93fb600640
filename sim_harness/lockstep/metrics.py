"""Scores of a run, computed from its trace alone.

Samples hold until the next one, so means and durations are weighted by the time between samples and do not
depend on an even sample rate.
"""

from dataclasses import dataclass

import numpy as np

from sim_harness.lockstep.trace import Column, Trace

INTERVENTION_S = 6.0  # Bojarski et al., End to End Learning for Self-Driving Cars (2016), section 5.2
JERK_WINDOW_S = 0.5  # ISO 11270:2014: lateral jerk is judged as its mean over half a second
MIN_GAP_SPEED_MPS = 0.1  # below it a time gap says nothing


@dataclass(frozen=True, slots=True, kw_only=True)
class Metrics:
    """Scores of one run; None where there is nothing to score."""

    duration_s: float
    distance_m: float  # along the lane centre line
    departures: int  # a wheel over the lane edge
    interventions: int  # re-centred after a departure or beyond 1 m
    autonomy_percent: float
    max_lateral_error_m: float
    rms_lateral_error_m: float
    max_lateral_accel_mps2: float
    max_lateral_jerk_mps3: float
    max_decel_mps2: float
    collisions: int
    min_time_gap_s: float | None
    mean_speed_mps: float
    max_fear: float | None
    mean_fear: float | None
    modes: dict[str, float]  # name -> seconds
    causes: dict[str, float]  # name -> seconds


def measure(trace: Trace) -> Metrics:
    """Scores of ``trace``. Raises ValueError when it spans no time.

    autonomy = 100·(1 - 6 s·interventions/duration), at least 0: Bojarski et al. (2016), section 5.2.
    """
    t_s = trace["t_s"]
    duration_s = float(t_s[-1] - t_s[0]) if len(trace) else 0.0
    if duration_s <= 0.0:
        raise ValueError(f"a trace of {len(trace)} samples over {duration_s} s cannot be scored")
    distance_m = float(trace["station_m"][-1] - trace["station_m"][0])
    interventions = int(trace["interventions"][-1])
    fear = trace["decision.fear"]
    offset_m = trace["lateral_offset_m"]
    return Metrics(
        duration_s=duration_s,
        distance_m=distance_m,
        departures=int(trace["departures"][-1]),
        interventions=interventions,
        autonomy_percent=max(0.0, 100.0 * (1.0 - INTERVENTION_S * interventions / duration_s)),
        max_lateral_error_m=float(np.abs(offset_m).max()),
        rms_lateral_error_m=float(np.sqrt(_time_mean(t_s, offset_m**2) or 0.0)),
        max_lateral_accel_mps2=float(np.abs(trace["lateral_accel_mps2"]).max()),
        max_lateral_jerk_mps3=max_lateral_jerk_mps3(trace),
        max_decel_mps2=max(0.0, float(-trace["longitudinal_accel_mps2"].min())),
        collisions=int(trace["collisions"][-1]),
        min_time_gap_s=min_time_gap_s(trace),
        mean_speed_mps=distance_m / duration_s,
        max_fear=None if np.isnan(fear).all() else float(np.nanmax(fear)),
        mean_fear=_time_mean(t_s, fear),
        modes=_seconds_by_word(trace, "mode"),
        causes=_seconds_by_word(trace, "cause"),
    )


def max_lateral_jerk_mps3(trace: Trace) -> float:
    """Largest magnitude of lateral jerk after a moving mean over 0.5 s (ISO 11270:2014).

    The mean of a derivative is a difference quotient: (a_y(t + 0.5 s) - a_y(t)) / 0.5 s. Windows in which the
    harness re-centred the vehicle are left out: that jump is not driven.
    """
    t_s, accel = trace["t_s"], trace["lateral_accel_mps2"]
    starts = np.flatnonzero(t_s <= t_s[-1] - JERK_WINDOW_S + 1e-9)
    ends_s = t_s[starts] + JERK_WINDOW_S
    ends = np.searchsorted(t_s, ends_s + 1e-9, side="right") - 1
    driven = trace["interventions"][ends] == trace["interventions"][starts]
    change = np.interp(ends_s, t_s, accel) - accel[starts]
    return float(np.abs(change[driven]).max(initial=0.0) / JERK_WINDOW_S)


def min_time_gap_s(trace: Trace) -> float | None:
    """Least bumper-to-bumper gap over speed [s] while moving; 0 in a collision, None without a lead vehicle."""
    gap_m, speed_mps = trace["lead_gap_m"], trace["speed_mps"]
    moving = np.isfinite(gap_m) & (speed_mps > MIN_GAP_SPEED_MPS)
    if not moving.any():
        return None
    return max(0.0, float((gap_m[moving] / speed_mps[moving]).min()))


def _held_s(t_s: Column) -> Column:
    """How long each sample holds [s]; the last one ends the run."""
    return np.append(np.diff(t_s), 0.0)


def _time_mean(t_s: Column, values: Column) -> float | None:
    """Mean over time of the finite ``values``; None when there are none."""
    held_s = np.where(np.isfinite(values), _held_s(t_s), 0.0)
    total_s = held_s.sum()
    return float((np.nan_to_num(values) * held_s).sum() / total_s) if total_s > 0.0 else None


def _seconds_by_word(trace: Trace, label: str) -> dict[str, float]:
    """Seconds for which each word of a label column held, in order of first appearance."""
    held_s, codes = _held_s(trace["t_s"]), trace[label]
    return {word: round(float(held_s[codes == i].sum()), 6) for i, word in enumerate(trace.words[label])}
