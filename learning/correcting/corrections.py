"""The frames of drives alone in which the network drifts, with the angle that leads back, as a data set.

A frame is a correction where the car is at least ``offset_m`` beside the lane centre, or the network at least
``angle_rad`` beside the expert, and in the AROUND_S before and after.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from learning.correcting.alone import EXPERT
from learning.dataset import build as building
from learning.dataset.dataset import Dataset, Split
from learning.dataset.sources.log import Faults, Log
from learning.dataset.sources.recording import read_drive
from learning.dataset.sources.table import TableOptions
from learning.dataset.wheel import WheelOptions
from trepid.clock import nanoseconds
from trepid.messages import SteeringEstimate
from trepid.recording.reader import read_recording
from trepid.recording.scan import leave_out
from trepid.topics import estimate_topic
from trepid.types import Column, Mask

AROUND_S = 1.0
STEADY = "the network keeps the lane here"
ALL_TRAIN = Split(by="time", seed=0, gap_s=0.0, shares={"train": 1.0, "validation": 0.0, "test": 0.0})


@dataclass(frozen=True, slots=True)
class Drift:
    """What is a drift."""

    offset_m: float = 0.15
    angle_rad: float = math.radians(1.0)


def correction_log(path: Path, network: str, drift: Drift, faults: Faults) -> Log:
    """The frames of a drive alone, with the angle of the expert; steady ones are left out. Raises InputError."""
    log = read_drive(path, faults, labels_of=EXPERT)
    keys = (estimate_topic(EXPERT).key, estimate_topic(network).key)
    recorded = read_recording(path, *keys, damage=leave_out)
    expert, driven = (
        {
            nanoseconds(one.t_s): one
            for _, one in recorded.of(estimate_topic(name))
            if not math.isnan(one.confidence)
        }
        for name in (EXPERT, network)
    )

    def column(estimates: dict[int, SteeringEstimate], field: str) -> Column:
        found = [getattr(estimates.get(nanoseconds(t)), field, None) for t in log.t_s.tolist()]
        return np.array(found, dtype=np.float64)  # None: NaN

    beside_m = np.abs(column(expert, "lateral_offset_m"))
    wrong_rad = np.abs(column(driven, "road_wheel_angle_rad") - log.steering)
    drifting = (beside_m >= drift.offset_m) | ~(wrong_rad < drift.angle_rad)
    near = around(log.t_s, drifting & np.isfinite(log.steering))
    log.why = [why or ("" if here else STEADY) for why, here in zip(log.why, near.tolist(), strict=True)]
    return log


def around(t_s: Column, chosen: Mask) -> Mask:
    """Whether each time is within AROUND_S of a chosen one."""
    at_s = t_s[chosen]
    if not len(at_s):
        return np.zeros(len(t_s), bool)
    after = np.clip(np.searchsorted(at_s, t_s), 0, len(at_s) - 1)
    nearest_s = np.minimum(np.abs(at_s[after] - t_s), np.abs(at_s[np.maximum(after - 1, 0)] - t_s))
    return np.asarray(nearest_s <= AROUND_S)


def build_corrections(out: Path, drives: Iterable[Path], network: str, drift: Drift) -> Dataset | None:
    """The data set of the corrections of ``drives``; None where nothing drifts. Raises InputError."""
    faults = Faults(strict=True)
    logs = [correction_log(path, network, drift, faults) for path in drives]
    logs = [log for log in logs if not all(log.why)]
    if not logs:
        return None
    options = building.BuildOptions(wheel=WheelOptions(), split=ALL_TRAIN, table=TableOptions())
    building.build(out, logs, options, faults)
    return Dataset.open(out)
