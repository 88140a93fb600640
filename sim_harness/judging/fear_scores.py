"""Scores of fear as a predictor of departures."""

import numpy as np

from sim_harness.judging.margins import STANDING_MPS, time_gap_s
from sim_harness.judging.trace import USER_GAP, Trace
from supervisor.modes.modes import STARTING
from supervisor.rules.inference import FearRules
from trepid.config import default_file
from trepid.types import Column, Mask

HORIZON_S = 3.0  # fear counts as a prediction at most this long before a departure
AFRAID = "medium"  # the lowest level of fear that affects the drive
SLOWED = 0.9  # speed factor; below it the decision counts as a slow-down
JOINED_S = 1.0  # slow-downs closer than this count as one
CLOSE_GAP_S = 2.0  # a vehicle ahead closer than this is a reason to slow down


def driven_fear(trace: Trace) -> Column:
    """Fear from the start of driving on; NaN before, where fear is 1 for lack of data.

    Driving starts with the first sample whose cause is not ``starting``.
    """
    fear = trace["decision.fear"]
    words = trace.words.get("cause", ())
    if STARTING not in words:
        return fear
    starting = (trace["cause"] == words.index(STARTING)) | np.isnan(fear)
    return np.where(np.logical_and.accumulate(starting), np.nan, fear)


def afraid(trace: Trace) -> Mask:
    """True where fear is at least medium; False where it is unknown."""
    return trace["decision.fear"] >= _afraid_from()


def fear_lead_time_s(trace: Trace) -> float | None:
    """The shortest warning of a departure [s]; None without departures.

    The warning of a departure is the time with a fear of at least medium, without a break, up to the last
    sample before it and since the last intervention: 0 for a departure at low fear.
    """
    t_s, warned = trace["t_s"], afraid(trace)
    leads_s = []
    for sample in np.flatnonzero(np.diff(trace["departures"]) > 0) + 1:
        start = sample
        while (
            start > 0
            and warned[start - 1]
            and trace["interventions"][start - 1] == trace["interventions"][sample - 1]
        ):
            start -= 1
        leads_s.append(float(t_s[sample] - t_s[start]))
    return min(leads_s, default=None)


def fear_and_departure(trace: Trace) -> tuple[Column, Mask]:
    """Fear of each driven sample, and whether a departure followed within 3 s; only where both are known.

    The samples of the last 3 s of a run are unknown unless a departure follows in time. Samples at standstill are
    left out: a standing vehicle does not leave its lane.
    """
    t_s, fear = trace["t_s"], driven_fear(trace)
    departures_s = np.append(t_s[1:][np.diff(trace["departures"]) > 0], np.inf)
    until_s = (
        departures_s[np.searchsorted(departures_s, t_s, side="right").clip(max=len(departures_s) - 1)] - t_s
    )
    followed = until_s <= HORIZON_S + 1e-9
    known = np.isfinite(fear) & (followed | (t_s <= t_s[-1] - HORIZON_S + 1e-9))
    known &= trace["speed_mps"] > STANDING_MPS
    return fear[known], followed[known]


def fear_auroc(*traces: Trace) -> float | None:
    """AUROC of fear against a departure within 3 s, over the samples of all ``traces``."""
    pairs = [fear_and_departure(trace) for trace in traces]
    return auroc(np.concatenate([fear for fear, _ in pairs]), np.concatenate([left for _, left in pairs]))


def auroc(scores: Column, positive: Mask) -> float | None:
    """Probability that a positive has a higher score than a negative, ties counted half; None without both.

    (R - n₊(n₊ + 1)/2) / (n₊·n₋) with R the sum of the ranks of the positives: Hanley and McNeil, The meaning
    and use of the area under a receiver operating characteristic (ROC) curve, Radiology 143 (1982).
    """
    from scipy.stats import rankdata  # a second, which a start does not need

    count = int(positive.sum())
    others = len(positive) - count
    if count == 0 or others == 0:
        return None
    ranks = rankdata(scores)[positive].sum()
    return float((ranks - count * (count + 1) / 2) / (count * others))


def nuisance_slowdowns_per_km(trace: Trace) -> float | None:
    """Slow-downs by fear without a reason, per km; None for a run without distance.

    A slow-down is a stretch in which fear is at least medium and the supervisor allows less than 90 % of the
    speed, while the vehicle moves at its beginning; breaks under 1 s do not end it. It is a nuisance when
    from 3 s before it to 3 s after it there was no departure, intervention or collision, no fault, no
    disturbance, and no vehicle ahead or road user within 2 s. The
    remaining slow-downs are for the road itself and can be justified on a road that is hard to detect: compare the
    score between supervisors on the same road only.
    """
    distance_m = float(trace["station_m"][-1] - trace["station_m"][0])
    if distance_m <= 0.0:
        return None
    t_s, reason = trace["t_s"], _reasons(trace)
    nuisances = 0
    for first, last in _stretches(t_s, afraid(trace) & (trace["decision.speed_factor"] < SLOWED)):
        around = (t_s >= t_s[first] - HORIZON_S) & (t_s <= t_s[last] + HORIZON_S)
        moving = trace["speed_mps"][first] > STANDING_MPS
        nuisances += bool(moving and not reason[around].any())
    return 1000.0 * nuisances / distance_m


def _reasons(trace: Trace) -> Mask:
    """Samples with a reason for fear."""
    reason: Mask = time_gap_s(trace) < CLOSE_GAP_S
    if USER_GAP in trace.columns:
        reason |= trace[USER_GAP] < CLOSE_GAP_S * trace["speed_mps"]
    for count in ("departures", "interventions", "collisions"):
        reason |= np.diff(trace[count], prepend=0.0) > 0
    for name, column in trace.columns.items():
        if name.startswith(("fault.", "disturbance.")):
            reason |= column > 0
    return reason


def _stretches(t_s: Column, flags: Mask) -> list[tuple[int, int]]:
    """First and last sample of every interval; intervals less than JOINED_S apart are joined."""
    stretches: list[tuple[int, int]] = []
    for sample in np.flatnonzero(flags).tolist():
        if stretches and t_s[sample] - t_s[stretches[-1][1]] < JOINED_S:
            stretches[-1] = (stretches[-1][0], sample)
        else:
            stretches.append((sample, sample))
    return stretches


def _afraid_from() -> float:
    """The least fear whose level is AFRAID."""
    actions = FearRules.load(default_file("fear.yaml")).file.fear
    return (actions.low.at + getattr(actions, AFRAID).at) / 2
