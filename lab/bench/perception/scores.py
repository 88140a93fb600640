"""Scores of estimators from their results on the clips of the harness set, by group of clips and as tables."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lab.bench.perception.clips import CLEAR, GAP, WARM_UP_FRAMES, ClipCase
from lab.bench.perception.watch import Looks, WatchedClip
from learning.lane.scores import auroc, expected_calibration_error
from sim_harness.world.roads.drawn import UNMARKED, BendShape, MarkingKind
from trepid.types import Mask

Numbers = NDArray[np.floating]
TOLERANCE_M = 0.30  # of the lane centre, at the axle and ahead: a third of the room of a 1.4 m car in 3.3 m
TOLERANCE_RAD = np.radians(2.0)  # of the road-wheel angle, as for the confidence
MAIN_CONDITIONS = ("rain", "snow", "night", "tree_shadows", "building_shadows", "bridge_shadows", "glare")
DRIVABLE_GRADES = (1, 2, 3)  # beyond, the lane itself is hidden for part of the frames
# With paint on both sides:
CLEAN = (
    MarkingKind.WHITE,
    MarkingKind.YELLOW,
    MarkingKind.DOUBLE,
    MarkingKind.DASHED,
    MarkingKind.CONCRETE,
    MarkingKind.MULTI_LANE,
)

SHOWN = ("all", "clear", "marked", "unmarked")
WORST = 12

Results = Mapping[ClipCase, WatchedClip]
Row = dict[str, float | None]


def given_frames(looks: Looks) -> Mask:
    """Frames with an estimate, right or wrong."""
    return np.isfinite(looks["angle_rad"]) & np.isfinite(looks["offset_m"])


def correct(looks: Looks) -> Mask:
    """Estimates whose lane centre is within TOLERANCE_M of the true one, at the axle and ahead."""
    with np.errstate(invalid="ignore"):
        return (np.abs(looks["offset_m"]) <= TOLERANCE_M) & (np.abs(looks["aim_m"]) <= TOLERANCE_M)


def score_clips(results: Results, name: str, cases: Iterable[ClipCase]) -> Looks:
    """Results of an estimator on the clips ``cases``, without the warm-up."""
    parts = [results[case].looks[name][WARM_UP_FRAMES:] for case in cases]
    return np.concatenate(parts) if parts else np.empty(0, results[next(iter(results))].looks[name].dtype)


def figures(looks: Looks) -> Row:
    """Rates in percent of the frames; errors of all estimates, and of right ones."""
    seen = given_frames(looks)
    right = seen & correct(looks)
    said = looks[seen]
    row: Row = {
        "frames": len(looks),
        "given_pct": _percent(seen),
        "correctness_pct": _percent(right[seen]),
        "detected_pct": _percent(right),
    }
    for field, name, scale in (
        ("offset_m", "offset_m", 1.0),
        ("heading_rad", "heading_deg", 180 / np.pi),
        ("curvature_1pm", "curvature_1pm", 1.0),
        ("width_share", "width_pct", 100.0),
        ("angle_rad", "angle_deg", 180 / np.pi),
    ):
        row[f"{name}_rmse"] = _rms(scale * said[field])
        row[f"{name}_median"] = _median(np.abs(scale * said[field]))
        row[f"{name}_rmse_when_right"] = _rms(scale * looks[right][field])
    sides = np.concatenate([said["left_m"], said["right_m"]])
    row["boundary_m_rmse"], row["boundary_m_median"] = _rms(sides), _median(sides)
    return row | confidence_figures(said)


def confidence_figures(said: Looks) -> Row:
    """Calibration of the confidence as the probability of a wheel angle within two degrees."""
    if not len(said):
        return {"ece": None, "auroc": None, "bad_angles_pct": None}
    good = np.abs(said["angle_rad"]) <= TOLERANCE_RAD
    confidence = said["confidence"].astype(float)
    both = bool(good.any() and not good.all())
    return {
        "ece": expected_calibration_error(confidence, good),
        "auroc": auroc(confidence, good) if both else None,
        "bad_angles_pct": _percent(~good),
    }


def times_ms(results: Results, name: str) -> dict[str, float]:
    """Processor time per frame: median and 99th percentile [ms], and the median over that of the bare chain."""
    times_s, bare_s = (
        np.concatenate([watched.looks[name][field] for watched in results.values()])
        for field in ("time_s", "bare_chain_s")
    )
    p50, p99 = np.percentile(times_s, (50, 99)) * 1e3
    return {
        "ms_median": float(p50),
        "ms_p99": float(p99),
        "times_bare_chain": float(p50 / np.median(bare_s) / 1e3),
    }


def gap_figures(results: Results, name: str) -> Row:
    """30 m without paint: the median and the worst over clips of the largest drift, and the answered share."""
    drifts, shares = [], []
    for case, watched in results.items():
        if case.condition == GAP:
            looks = watched.looks[name][watched.truth["in_gap"]]
            seen = given_frames(looks)
            shares.append(seen.mean())
            if seen.any():
                drifts.append(np.abs(looks["offset_m"][seen]).max())
    return {
        "gap_drift_m_median": float(np.median(drifts)) if drifts else None,
        "gap_drift_m_worst": float(max(drifts)) if drifts else None,
        "gap_given_pct": 100 * float(np.mean(shares)) if shares else None,
    }


def one_line_figures(results: Results, name: str) -> Row:
    """Bias of the wheel angle with one line: the mean over roads of the absolute mean of a clip's error."""
    cases = [case for case in results if case.condition == CLEAR and case.kind is MarkingKind.ONE_LINE]
    clips = [
        looks["angle_rad"][given_frames(looks)]
        for case in cases
        if len(looks := score_clips(results, name, [case]))
    ]
    angles = [float(np.mean(clip)) for clip in clips if len(clip)]
    pooled = np.concatenate(clips) if clips else np.empty(0)
    return {
        "one_line_bias_deg": float(np.degrees(np.mean(np.abs(angles)))) if angles else None,
        "one_line_mean_deg": float(np.degrees(np.mean(pooled))) if len(pooled) else None,
    }


def groups(cases: Iterable[ClipCase]) -> dict[str, list[ClipCase]]:
    """Groups of clips: all, clear by road and shape, every disturbance by grade and at drivable grades."""
    cases = list(cases)
    clear = [case for case in cases if case.condition == CLEAR]
    parts = {
        "all": [case for case in cases if case.condition != GAP],
        "clear": clear,
        "clean": [case for case in clear if case.kind in CLEAN],
        "marked": [case for case in clear if case.kind not in UNMARKED],
        "unmarked": [case for case in clear if case.kind in UNMARKED],
    }
    parts |= {f"clear, {kind}": [case for case in clear if case.kind is kind] for kind in MarkingKind}
    parts |= {f"clear, {shape}": [case for case in clear if case.shape is shape] for shape in BendShape}
    kinds = list(dict.fromkeys(case.condition for case in cases if case.grade))
    for kind in kinds:
        own = [case for case in cases if case.condition == kind]
        parts[kind] = [case for case in own if case.grade in DRIVABLE_GRADES]
        parts |= {
            f"{kind} {grade}": [case for case in own if case.grade == grade]
            for grade in sorted({c.grade for c in own})
        }
    return {name: part for name, part in parts.items() if part}


def parts_of(results: Results, names: Sequence[str]) -> dict[str, dict[str, Row]]:
    """The figures of every estimator in every group of clips."""
    parts = groups(results)
    return {
        name: {part: figures(score_clips(results, name, cases)) for part, cases in parts.items()}
        for name in names
    }


def summary(results: Results, parts: dict[str, dict[str, Row]]) -> dict[str, Any]:
    """``ranking``: the main figures of every estimator, best first; ``detected``: percent by condition; and the
    worst clips of the first estimator."""
    ranking = {name: main_figures(results, name, rows) for name, rows in parts.items()}
    order = sorted(ranking, key=lambda name: -(ranking[name]["all_detected_pct"] or 0.0))
    detected = {part: {name: parts[name][part]["detected_pct"] for name in order} for part in parts[order[0]]}
    first = next(iter(parts))
    return {
        "ranking": {name: ranking[name] for name in order},
        "detected, percent": detected,
        f"worst clips of {first}, percent detected": worst(results, first),
    }


def main_figures(results: Results, name: str, parts: dict[str, Row]) -> Row:
    """One row: rates by condition, errors, confidence, time."""
    row: Row = {f"{part}_detected_pct": parts[part]["detected_pct"] for part in SHOWN if part in parts}
    row["correctness_pct"] = parts["all"]["correctness_pct"]
    row["given_pct"] = parts["all"]["given_pct"]
    row |= {f"{part}_detected_pct": parts[part]["detected_pct"] for part in MAIN_CONDITIONS if part in parts}
    clean = parts.get("clean", {})
    for key in ("offset_m", "heading_deg", "curvature_1pm", "width_pct", "angle_deg"):
        row[f"clean_{key}_rmse"] = clean.get(f"{key}_rmse")
        row[f"clean_{key}_rmse_when_right"] = clean.get(f"{key}_rmse_when_right")
        row[f"clean_{key}_median"] = clean.get(f"{key}_median")
    row["unmarked_boundary_m_rmse"] = parts.get("unmarked", {}).get("boundary_m_rmse")
    row |= gap_figures(results, name) | one_line_figures(results, name)
    row["ece"], row["auroc"] = parts["all"]["ece"], parts["all"]["auroc"]
    return row | times_ms(results, name)


def worst(results: Results, name: str) -> dict[str, float]:
    """The clips with the lowest share of right frames, and that share in percent."""
    rates = {
        case.key: 100 * float(np.mean(correct(score_clips(results, name, [case]))))
        for case in results
        if case.condition != GAP
    }
    return dict(sorted(rates.items(), key=lambda item: item[1])[:WORST])


def _percent(flags: Mask) -> float | None:
    return 100 * float(np.mean(flags)) if len(flags) else None


def _rms(values: Numbers) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(values, dtype=float)))) if len(values) else None


def _median(values: Numbers) -> float | None:
    values = values[np.isfinite(values)]
    return float(np.median(values)) if len(values) else None
