"""Comfort of a run: lateral jerk by two standards, and steering wheel reversals.

Re-centring by the harness is a jump in the trace: intervals that span one are left out.
"""

import math
from collections.abc import Iterator

import numpy as np

from sim_harness.judging.margins import default_vehicle
from sim_harness.judging.trace import Trace
from trepid.types import Column

JERK_WINDOW_S = 0.5  # ISO 11270:2014 and UN R79: lateral jerk is judged as its mean over half a second
R79_RATE_HZ = 100.0  # UN R79 rev. 4, annex 8: sampling rate of at least 100 Hz ...
R79_ORDER, R79_CUTOFF_HZ = 4, 0.5  # ... and the filter of the lateral acceleration
REVERSAL_ORDER, REVERSAL_CUTOFF_HZ = 2, 0.6  # Markkula and Engström (2006), for visual load
REVERSAL_GAP_RAD = math.radians(2.0)  # at the steering wheel


def max_lateral_jerk_mps3(trace: Trace) -> float:
    """Largest magnitude of lateral jerk after a moving mean over 0.5 s (ISO 11270:2014).

    The mean of a derivative is a difference quotient: (a_y(t + 0.5 s) - a_y(t)) / 0.5 s.
    """
    return max((_max_mean_jerk(t_s, accel) for t_s, accel in _driven_stretches(trace)), default=0.0)


def max_r79_jerk_mps3(trace: Trace) -> float:
    """The same for a_y after a fourth-order Butterworth low-pass of 0.5 Hz, sampled at 100 Hz.

    UN R79 rev. 4, annex 8 (ACSF of category B1): "the 500 ms moving average of the time derivation of the
    filtered lateral acceleration", at most 5 m/s³. The filter is causal and starts settled on the first
    value.
    """
    from scipy.signal import butter, sosfilt, sosfilt_zi  # half a second, which a start does not need

    sections = butter(R79_ORDER, R79_CUTOFF_HZ, fs=R79_RATE_HZ, output="sos")
    worst = 0.0
    for t_s, accel in _driven_stretches(trace):
        even_s = np.arange(t_s[0], t_s[-1] + 1e-9, 1.0 / R79_RATE_HZ)
        even = np.interp(even_s, t_s, accel)
        filtered, _ = sosfilt(sections, even, zi=sosfilt_zi(sections) * even[0])
        worst = max(worst, _max_mean_jerk(even_s, filtered))
    return worst


def steering_reversals_per_min(trace: Trace) -> float | None:
    """Swings of the steering wheel by at least 2° per minute; None for runs shorter than a second.

    Markkula and Engström, A steering wheel reversal rate metric for assessing effects of visual and cognitive
    secondary task load (2006), the method of SAE J2944 (2015): the angle is filtered forth and back by a
    second-order Butterworth low-pass of 0.6 Hz; between its stationary points every rise by the gap or more
    counts, and every fall. The angle is that of the road wheels, as reported, times the steering ratio.
    """
    from scipy.signal import butter, filtfilt

    t_s, duration_s = trace["t_s"], float(trace["t_s"][-1] - trace["t_s"][0])
    if duration_s < 1.0:
        return None
    ratio = default_vehicle().steering_ratio
    rate_hz = (len(trace) - 1) / duration_s
    even_s = np.linspace(t_s[0], t_s[-1], len(trace))
    angle_rad = ratio * np.interp(even_s, t_s, trace["road_wheel_angle_rad"])
    if rate_hz > 4.0 * REVERSAL_CUTOFF_HZ:
        angle_rad = filtfilt(*butter(REVERSAL_ORDER, REVERSAL_CUTOFF_HZ, fs=rate_hz), angle_rad)
    return 60.0 * count_reversals(angle_rad, REVERSAL_GAP_RAD) / duration_s


def count_reversals(angle_rad: Column, gap_rad: float) -> int:
    """Rises and falls by at least ``gap_rad`` between stationary points; both ends count as such."""
    turns = np.flatnonzero(np.diff(np.sign(np.diff(angle_rad)))) + 1
    points = angle_rad[[0, *turns, len(angle_rad) - 1]]
    return _count_rises(points, gap_rad) + _count_rises(-points, gap_rad)


def _count_rises(points: Column, gap: float) -> int:
    count, low = 0, points[0]
    for point in points[1:]:
        if point - low >= gap:
            count += 1
            low = point
        low = min(low, point)
    return count


def _driven_stretches(trace: Trace) -> Iterator[tuple[Column, Column]]:
    """Times and lateral accelerations between interventions at least half a second apart."""
    jumps = np.flatnonzero(np.diff(trace["interventions"])) + 1
    for part in np.split(np.arange(len(trace)), jumps):
        t_s = trace["t_s"][part]
        if t_s[-1] - t_s[0] >= JERK_WINDOW_S - 1e-9:
            yield t_s, trace["lateral_accel_mps2"][part]


def _max_mean_jerk(t_s: Column, accel: Column) -> float:
    """Largest magnitude of (a(t + 0.5 s) - a(t)) / 0.5 s."""
    starts = np.flatnonzero(t_s <= t_s[-1] - JERK_WINDOW_S + 1e-9)
    change = np.interp(t_s[starts] + JERK_WINDOW_S, t_s, accel) - accel[starts]
    return float(np.abs(change).max(initial=0.0) / JERK_WINDOW_S)
