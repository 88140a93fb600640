"""What estimators and supervisor make of every frame of footage, and their rows."""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cockpit.footage.annotate import number
from cockpit.footage.api import brings_camera
from cockpit.footage.frames import (
    CameraFor,
    FrameResult,
    Sheet,
    Step,
    Unread,
    results,
)
from cockpit.footage.lane_rows import estimate_fields
from cockpit.footage.sources import Footage, Source
from perception.estimators import name_of
from perception.lead.finder import LeadFinder, lead_finder, lead_settings
from sim_harness.footage.clip import read_log
from sim_harness.footage.fear_picture import draw_fear
from sim_harness.footage.onlooker import FrameJudgement, GivenSpeed, Onlooker, RecordedStates, StateOf
from supervisor.supervisor import SupervisorSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.loudness import note
from trepid.recording.csv_file import column_names, read_rows
from trepid.recording.interpolation import GAP_S, between
from trepid.recording.notes import CRUISE
from trepid.recording.notes import number as number_of
from trepid.recording.reader import read_recording
from trepid.recording.scan import leave_out
from trepid.topics import VEHICLE_STATE
from trepid.types import Array

COLUMNS = (
    "file",
    "frame",
    "t s",
    "fear",
    "level",
    "cause",
    "mode",
    "path",
)  # then estimators, the leader and the sight
YAW = "yaw_rate_radps"
SILENT_ROWS = 2.5  # a longer time without a row, in usual times between rows, is a silence of the log


@dataclass(frozen=True)
class GivenMotion:
    """Speed and, where known, yaw rate over the time since the first frame; NaN: not logged."""

    speed_mps_at: Callable[[float], float]
    yaw_radps_at: Callable[[float], float] | None
    top_mps: float
    logged: bool  # measured by the car


def given_motion(speed_mps: float | None, log: Path | None) -> GivenMotion | None:
    """The motion of --speed or --speeds; None without either. Raises InputError."""
    if log is None:
        return None if speed_mps is None else GivenMotion(lambda _: speed_mps, None, speed_mps, logged=False)
    if speed_mps is not None:
        raise InputError("give --speed or --speeds, not both")
    t_s, speeds_mps = read_log(log)
    yaws = _yaw_rates(log, len(t_s))
    return GivenMotion(
        _interpolate_log(t_s, speeds_mps),
        None if yaws is None else _interpolate_log(t_s, np.array(yaws)),
        float(speeds_mps.max()),
        logged=True,
    )


def _interpolate_log(t_s: Array, values: Array) -> Callable[[float], float]:
    """``values`` over the time since the first row; NaN outside the log, and in silences of SILENT_ROWS rows."""
    since_s = t_s - t_s[0]
    gap_s = max(GAP_S, SILENT_ROWS * float(np.median(np.diff(t_s)))) if len(t_s) > 1 else GAP_S
    late_s = since_s[-1] + gap_s  # the last value holds as long as a gap may be
    since_s, values = np.append(since_s, late_s), np.append(values, values[-1])
    return lambda at_s: float(between(np.array([at_s]), since_s, values, gap_s=gap_s * (1 + 1e-9))[0])


def _yaw_rates(log: Path, count: int) -> list[float] | None:
    """The column yaw_rate_radps of ``log``, NaN where a cell is empty; None without it. Raises InputError."""
    rows = read_rows(log)
    header = column_names(rows[0], (YAW,))
    if YAW not in header:
        return None
    column, found = header.index(YAW), []
    for line, row in ((row.line, row.cells) for row in rows[1 : count + 1]):
        cell = row[column].strip() if column < len(row) else ""
        try:
            found.append(float(cell) if cell else math.nan)
        except ValueError as error:
            raise InputError(f"{log}:{line}:1: expected a yaw rate [rad/s], got {cell!r}") from error
    return found


def fear_results(
    inputs: Iterable[Path],
    camera_for: CameraFor,
    unread: Unread,
    assumed: bool,
    motion: GivenMotion | None,
    detector: Path | None,
    names: Sequence[str],
    *,
    drive_fps: float | None = None,
) -> Iterator[FrameResult[FrameJudgement]]:
    """What estimators, lead detector and supervisor make of every frame. Raises InputError.

    ``names``: estimators, or files of driving networks. ``assumed``: no camera is given, and those of images and
    videos are self-calibrated. Without a ``motion`` the speed of ``config/supervisor.yaml`` is assumed and
    reported. A recording brings its own camera and states.
    """
    step = partial(_step, motion, detector, assumed, names)
    return results(inputs, camera_for, step, unread, drive_fps=drive_fps)


def _step(
    given: GivenMotion | None,
    detector: Path | None,
    assumed: bool,
    names: Sequence[str],
    source: Source,
    camera: Camera,
) -> Step[FrameJudgement]:
    """A fresh onlooker for ``source``."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    state_of, cruise_mps = _states(given, source, camera, vehicle)
    finder = _finder(detector, source, camera, vehicle)
    onlooker = Onlooker(
        camera,
        vehicle,
        state_of,
        cruise_speed_mps=cruise_mps,
        finder=finder,
        assumed=assumed and not brings_camera(source),
        names=names,
    )
    return onlooker.step


def _states(
    given: GivenMotion | None, source: Source, camera: Camera, vehicle: Vehicle
) -> tuple[StateOf, float | None]:
    """States of the vehicle, and the cruise speed [m/s] (None: that of the settings)."""
    if given is None and isinstance(source, Footage):
        recorded = read_recording(source.path, VEHICLE_STATE.key, damage=leave_out)
        states = [state for _, state in recorded.of(VEHICLE_STATE)]
        if not states:
            raise InputError(f"{source.path}: holds no {VEHICLE_STATE.key}; give --speed or --speeds")
        return RecordedStates(states), number_of(source.head.notes, CRUISE)
    if given is None:
        cruise_mps = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).cruise_speed_mps * vehicle.scale
        note(f"{source.path}: no --speed given: {cruise_mps:g} m/s assumed")
        return GivenSpeed(camera, vehicle, lambda _: cruise_mps), None
    states_at = GivenSpeed(camera, vehicle, given.speed_mps_at, given.yaw_radps_at, logged=given.logged)
    return states_at, given.top_mps if given.top_mps > 0 else None


def _finder(detector: Path | None, source: Source, camera: Camera, vehicle: Vehicle) -> LeadFinder | None:
    """The finder with the detector that is named; the embedded one for recordings only."""
    settings = lead_settings(detector)
    if settings.detector is None and not isinstance(source, Footage):
        return None
    return lead_finder(settings, camera, vehicle)


def as_row(one: FrameResult[FrameJudgement]) -> dict[str, Any]:
    """The JSON object of one frame."""
    seen, decision = one.result, one.result.decision
    return {
        "file": str(one.path),
        "frame": one.number,
        "t_s": round(one.t_s, 6),
        "fear": decision.fear,
        "level": decision.level,
        "cause": decision.cause,
        "mode": str(decision.mode),
        "path_source": decision.path_source,
        "sources": list(decision.sources),
        "trust": list(decision.trust),
        "disagreement_mps2": decision.disagreement_mps2,
        "lead_distance_m": seen.lead.distance_m if seen.lead else None,
        "sight_m": seen.statistics.sight_m,
        "sight_sigma_m": seen.statistics.sight_sigma_m,
        "sight_cause": seen.statistics.sight_cause,
        "latency_ms": one.latency_ms,
        "estimates": {
            name: estimate_fields(found, found.latency_ms) for name, found in seen.estimates.items()
        },
    }


def _cells(one: FrameResult[FrameJudgement]) -> list[str]:
    seen, decision = one.result, one.result.decision
    return [
        one.path.name,
        str(one.number),
        f"{one.t_s:.2f}",
        f"{decision.fear:.2f}",
        decision.level,
        decision.cause,
        str(decision.mode),
        decision.path_source,
        *(f"{found.confidence:.2f}" for found in seen.estimates.values()),
        number(seen.lead.distance_m if seen.lead else None, "{:.0f}"),
        number(seen.statistics.sight_m, "{:.0f}"),
        seen.statistics.sight_cause,
    ]


def fears(names: Iterable[str]) -> Sheet[FrameJudgement]:
    """The sheet of what estimators called ``names`` and the supervisor make of frames. Raises InputError."""
    return Sheet(
        as_row=as_row,
        columns=(*COLUMNS, *map(name_of, names), "lead m", "sight m", "by"),
        left={"file", "level", "cause", "mode", "path", "by"},
        cells=_cells,
        draw=draw_fear,
    )
