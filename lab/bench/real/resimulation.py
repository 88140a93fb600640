"""`trepid bench resimulation`: the supervised car in closed loop on footage that others drove.

Stretches of every drive of the sets are re-projected to the car (:mod:`sim_harness.footage.resimulation`). The path
is that of the yaw rate in the images: lock, trim and lag of the recorded steering are not known. The speed is that
of the log or of the sequence, else that of the ground in the images, in the metres of the assumed camera
(:mod:`sim_harness.footage.visual_motion`).

Every run is one line in ``runs/resimulation.jsonl``; stored ones are not repeated, so that an interrupted benchmark
continues.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import groupby, pairwise, product
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from lab.bench.real import sets
from lab.bench.real.frames import Picture, Stretches, cart_drive, donkey_drive, udacity_drive, video
from lab.bench.real.look import supervised_estimators
from lab.bench.real.supervision import cause_shares
from sim_harness.footage.clip import ClipFrames
from sim_harness.footage.reprojection import PoseChange
from sim_harness.footage.resimulation import Resimulation, resimulate
from sim_harness.footage.visual_motion import speed_mps
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint, import_closure
from sim_harness.sweep.store import Row, stored_rows
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, WORK_DIR, InputError, load

PARTS = Stretches(4, 150)
PAUSE_S = 0.5  # a longer time between two frames ends a stretch
LEAST_S = 6.0  # of a stretch
STARTS_M = (0.0, 0.5, -0.5)  # left of the recorded path
FOOTAGE: dict[str, Callable[[Path], Iterator[Picture]]] = {
    "camvid_road": sets.camvid_clip,
    "highway_udacity_p1": lambda folder: video(folder / "solidWhiteRight.mp4"),
    "running_track_cart": lambda folder: cart_drive(folder, parts=PARTS),
    "donkey_sim_carpet": lambda folder: donkey_drive(folder, parts=PARTS),
    "donkey_indoor_track": lambda folder: donkey_drive(folder, parts=PARTS),
    "udacity_sim_track": lambda folder: udacity_drive(folder, parts=PARTS),
}
"""Folder of the set -> its frames."""
SPEEDS_MPS = {"highway_udacity_p1": sets.HIGHWAY_MPS}


@dataclass(frozen=True)
class Stretch:
    """A part of a drive."""

    drive: ClipFrames
    assumed: bool  # the camera is self-calibrated


class Run(NamedTuple):
    """One run: a part of a set from a start."""

    folder: str  # of the set
    part: int
    left_m: float  # of the recorded path

    @property
    def name(self) -> str:
        """The set."""
        return Path(self.folder).name


def bench_resimulation(*, data: Path | None = None, jobs: int = 1) -> dict[str, Any]:
    """Scores of the supervised car by set, over all parts and starts. Raises InputError without any set."""
    folder = sets.data_folder(data)
    there = [str(folder / name) for name in FOOTAGE if (folder / name).is_dir()]
    if not there:
        raise InputError(f"{folder}: none of the sets {', '.join(FOOTAGE)}")
    runs = [Run(*one) for one in product(there, range(PARTS.number), STARTS_M)]
    keys = {f"{one.name} {one.part} {one.left_m:+g} m of {one.folder}": one for one in runs}
    rows = stored_rows(
        WORK_DIR / "runs" / "resimulation.jsonl",
        driven_row,
        keys,
        codes=dict.fromkeys(keys, _code()),
        jobs=jobs,
    )
    by_set: dict[str, list[Row]] = {}
    for one, row in zip(runs, rows, strict=True):
        if row["runs"]:
            by_set.setdefault(one.name, []).append(row)
    return {"by_set": {name: scores(driven) for name, driven in by_set.items()}}


def _code() -> str:
    """Hash of what a row depends on."""
    code = fingerprint(*import_closure([__name__]), "config")
    return f"{' '.join(map(estimator_fingerprint, supervised_estimators()))} {code}"


@cache
def _stretches(folder: str) -> list[Stretch]:
    """Those of a set; a process reads each set once."""
    cv2.setNumThreads(1)
    path = Path(folder)
    return list(stretches_of(path.name, FOOTAGE[path.name](path)))


def driven_row(run: Run) -> Row:
    """The stored row of a run; that of a part which its set does not have says so."""
    stretches = _stretches(run.folder)
    if run.part >= len(stretches):
        return {"runs": 0}
    one = stretches[run.part]
    driven = resimulate(
        one.drive,
        load(CONFIG_DIR / "vehicle.yaml", Vehicle),
        start=PoseChange(left_m=run.left_m),
        estimators=supervised_estimators(),
        assumed=one.assumed,
    )
    return row_of(one, driven)


def row_of(stretch: Stretch, driven: Resimulation) -> Row:
    """The row of a run over a stretch: that of the run, its speed, its causes of fear, its exact duration."""
    own = {"runs": 1, "speed_mps": float(stretch.drive.speed_mps.mean()), "causes": list(driven.causes)}
    return driven.row() | own | {"duration_s": driven.duration_s}


def stretches_of(name: str, pictures: Iterator[Picture]) -> Iterator[Stretch]:
    """The longest part without a pause of every drive, where it lasts LEAST_S and its speed is known."""
    for _, group in groupby(pictures, key=lambda picture: picture.drive):
        part = _longest(list(group))
        t_s = np.array([picture.t_s for picture in part]) - part[0].t_s
        if t_s[-1] < LEAST_S:
            continue
        images, camera = [picture.image for picture in part], part[0].camera
        logged = [picture.speed_mps for picture in part if picture.speed_mps is not None]
        mean_mps = SPEEDS_MPS.get(name) or (float(np.mean(logged)) if logged else None)
        mean_mps = mean_mps or speed_mps(images, t_s, camera)
        if mean_mps is None:
            continue
        speeds = np.array(logged) if len(logged) == len(part) else np.full(len(part), mean_mps)
        yield Stretch(ClipFrames(part[0].drive, images, t_s, speeds, camera), part[0].assumed)


def _longest(pictures: Sequence[Picture]) -> Sequence[Picture]:
    """The longest part without a pause."""
    times_s = np.array([picture.t_s for picture in pictures])
    ends = [0, *(np.flatnonzero(np.diff(times_s) > PAUSE_S) + 1).tolist(), len(pictures)]
    first, last = max(pairwise(ends), key=lambda part: part[1] - part[0])
    return pictures[first:last]


def scores(rows: Sequence[Row]) -> dict[str, float | str | None]:
    """Means over the runs, the autonomy over those in which the car drove; the path is the recorded one."""

    def mean(name: str) -> float | None:
        values = [row[name] for row in rows if row[name] is not None]
        return float(np.mean(values)) if values else None

    return {
        "runs": len(rows),
        "duration_s": float(sum(row["duration_s"] for row in rows)),
        "mean_speed_mps": mean("speed_mps"),
        "engaged_percent": mean("engaged_percent"),
        "interventions": sum(row["interventions"] for row in rows),
        "stops": sum(row["stops"] for row in rows),
        "autonomy_where_engaged_percent": mean("autonomy_percent"),
        "rms_from_path_m": mean("rms_offset_m"),
        "mean_fear": mean("mean_fear"),
        "fear_causes": cause_shares([cause for row in rows for cause in row["causes"]]),
        "lane_seen_percent": mean("lane_seen_percent"),
    }
