"""`trepid bench perception`: the harness set and the closed loop, for every estimator."""

from collections.abc import Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from lab.bench.perception.clips import VERSION, ClipCase, harness_set, moments
from lab.bench.perception.drive import bench_drive
from lab.bench.perception.report import draw, write
from lab.bench.perception.scores import Results, parts_of, summary
from lab.bench.perception.store import ClipStore, StoredFrames
from lab.bench.perception.watch import WatchedClip, watch
from perception.estimators import estimators as all_estimators
from perception.estimators import estimators_here, no_estimator
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint
from sim_harness.sweep.store import Store, finish_tasks
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load

FOLDER = Path("out/bench_perception")
PICTURES = (
    "sim_harness/world/render",
    "sim_harness/world/roads",
    "lab/bench/perception/clips.py",
    "config/camera.yaml",
    "config/disturbances.yaml",
)
"""Code and settings that the frames of the set depend on."""
WATCHING = (*PICTURES, "lab/bench/perception/watch.py", "sim_harness/lockstep/oracle.py")
"""Further code that the truth and the errors depend on."""
PARTS = ("set", "drive")


def bench_perception(
    seed: int,
    *,
    estimators: Sequence[str] = (),
    quick: bool = False,
    repeats: int = 1,
    jobs: int = 1,
    keep_frames: bool = False,
    parts: Sequence[str] = ("set",),
    out: Path | None = None,
) -> dict[str, Any]:
    """Tables of all ``parts``: scores per estimator, and details; no ``estimators`` means all that run here."""
    for part in parts:
        if part not in PARTS:
            raise InputError(f"no part {part!r} of bench perception; there are {', '.join(PARTS)}")
    known = all_estimators()
    for name in estimators:
        if name not in known:
            raise InputError(no_estimator(name, known))
    names = tuple(estimators or estimators_here())
    found: dict[str, Any] = {}
    by_group: dict[str, Any] = {}
    if "set" in parts:
        cases = harness_set(seed, quick=quick, repeats=repeats)
        results = watch_clips(cases, names, seed, jobs=jobs, keep_frames=keep_frames)
        by_group = parts_of(results, names)
        found |= summary(results, by_group)
    if "drive" in parts:
        found["drive"] = bench_drive(names, seed, FOLDER, quick=quick, jobs=jobs)
    if out is not None:
        write(out, {"seed": seed, "clips": f"version {VERSION}", **found}, by_group)
        if by_group:
            draw(out, results, by_group, found["ranking"])
    return found


def watch_clips(
    cases: Sequence[ClipCase], names: Sequence[str], seed: int, *, jobs: int = 1, keep_frames: bool = False
) -> Results:
    """Results of the estimators on clips; stored ones are not computed again. Raises WorkerLost."""
    pictures = FOLDER / f"frames-v{VERSION}-{seed}-{fingerprint(*PICTURES)}" if keep_frames else None
    codes = {name: estimator_fingerprint(name) for name in names}
    with Store(FOLDER / f"set-v{VERSION}-{seed}.jsonl") as rows:
        store = ClipStore(rows, fingerprint(*WATCHING), codes)
        missing: dict[ClipCase, tuple[ClipCase, list[str]]] = {}
        for case in cases:
            known = store.read(case)
            left = [name for name in names if known is None or name not in known.looks]
            if left:
                missing[case] = (case, left)
        with closing(finish_tasks(partial(_watch, pictures), missing, jobs)) as results:
            for case, found in results:
                store.write(case, found)
        return {case: known for case in cases if (known := store.read(case)) is not None}


def _watch(pictures: Path | None, wanted: tuple[ClipCase, Sequence[str]]) -> WatchedClip:
    """Results on one clip."""
    case, names = wanted
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    album = StoredFrames(pictures) if pictures else None
    frames = album.read(case, camera.height_px) if album else None
    clip = list(moments(case, camera, vehicle, frames=frames))
    if album and frames is None:
        album.write(case, [moment.frame.image for moment in clip])
    return watch(clip, names, camera, vehicle)
