"""`trepid bench perception`: the harness set, the real sets and the closed loop, for every estimator."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

from perception.estimators import estimators, no_estimator
from sim_harness.bench.perception.clips import VERSION, Case, harness_set, moments
from sim_harness.bench.perception.drive import bench_drive
from sim_harness.bench.perception.figures import draw
from sim_harness.bench.perception.options import PerceptionOptions
from sim_harness.bench.perception.real.bench import bench_real, data_folder
from sim_harness.bench.perception.report import write
from sim_harness.bench.perception.scores import Results
from sim_harness.bench.perception.store import ClipStore, Pictures
from sim_harness.bench.perception.summary import parts_of, summary
from sim_harness.bench.perception.watch import Watched, watch
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint
from sim_harness.sweep.pool import Lost, WorkerLost, imap_unordered
from sim_harness.sweep.store import Store
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.vehicle import Vehicle

FOLDER = Path("out/bench_perception")
PICTURES = (
    "sim_harness/world/render",
    "sim_harness/world/roads",
    "sim_harness/bench/perception/clips.py",
    "config/camera.yaml",
    "config/disturbances.yaml",
)
"""Code and settings that the frames of the set depend on."""
WATCHING = (*PICTURES, "sim_harness/bench/perception/watch.py", "sim_harness/lockstep/oracle.py")
"""Further code that the truth and the errors depend on."""
PARTS = ("set", "real", "drive")
REPORT_EVERY_S = 10.0


def names_of(options: PerceptionOptions) -> tuple[str, ...]:
    """The estimators to measure. Raises InputError with the nearest names."""
    known = estimators()
    for name in options.estimators:
        if name not in known:
            raise InputError(no_estimator(name, known))
    return options.estimators or tuple(known)


def bench_perception(options: PerceptionOptions) -> dict[str, Any]:
    """Tables of all parts: scores per estimator, and details."""
    for part in options.parts:
        if part not in PARTS:
            raise InputError(f"no part {part!r} of bench perception; there are {', '.join(PARTS)}")
    names = names_of(options)
    found: dict[str, Any] = {}
    parts: dict[str, Any] = {}
    if "set" in options.parts:
        results = watched(options)
        parts = parts_of(results, names)
        found |= summary(results, parts)
    if "real" in options.parts:
        real = bench_real(names, data_folder(options.data), FOLDER, quick=options.quick)
        found |= {f"real: {name}": rows for name, rows in real.items()}
    if "drive" in options.parts:
        found["drive"] = bench_drive(names, options.seed, FOLDER, quick=options.quick, jobs=options.jobs)
    if options.out is not None:
        write(options.out, {"seed": options.seed, "clips": f"version {VERSION}", **found}, parts)
        if parts:
            draw(options.out, results, parts, found["ranking"])
    return found


def watched(options: PerceptionOptions) -> Results:
    """Results of the estimators on the harness set; stored ones are not computed again. Raises WorkerLost."""
    with Store(FOLDER / f"set-v{VERSION}-{options.seed}.jsonl") as rows:
        codes = {name: estimator_fingerprint(name) for name in names_of(options)}
        return _watched(options, ClipStore(rows, fingerprint(*WATCHING), codes))


def _watched(options: PerceptionOptions, store: ClipStore) -> Results:
    pictures = (
        FOLDER / f"frames-v{VERSION}-{options.seed}-{fingerprint(*PICTURES)}" if options.keep_frames else None
    )
    cases = harness_set(options.seed, quick=options.quick, repeats=options.repeats)
    done: dict[Case, Watched] = {}
    missing: list[tuple[Case, tuple[str, ...]]] = []
    for case in cases:
        known = store.read(case)
        names = tuple(name for name in names_of(options) if known is None or name not in known.looks)
        if known is not None and not names:
            done[case] = known
        else:
            missing.append((case, names))
    progress = _Progress(len(cases), len(done))
    lost: list[str] = []
    for case, found in _all(partial(_watch, pictures), missing, options.jobs):
        if isinstance(found, Lost):
            lost.append(f"{case.key}: its process {found.reason}")
            continue
        store.write(case, found)
        known = store.read(case)
        assert known is not None
        done[case] = known
        progress.step()
    if lost:
        raise WorkerLost(f"{len(lost)} clips have no result, first {lost[0]}; the same command continues")
    return {case: done[case] for case in cases}


def _watch(pictures: Path | None, wanted: tuple[Case, tuple[str, ...]]) -> Watched:
    """Results on one clip."""
    case, names = wanted
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    album = Pictures(pictures) if pictures else None
    frames = album.read(case, camera.height_px) if album else None
    clip = list(moments(case, camera, vehicle, frames=frames))
    if album and frames is None:
        album.write(case, [moment.frame.image for moment in clip])
    return watch(clip, names, camera, vehicle)


def _all(
    call: Callable[[tuple[Case, tuple[str, ...]]], Watched],
    wanted: Sequence[tuple[Case, tuple[str, ...]]],
    jobs: int,
) -> Iterator[tuple[Case, Watched | Lost]]:
    """``call`` of each, in this process or on ``jobs`` processes, as they finish."""
    if jobs == 1:
        yield from ((one[0], call(one)) for one in wanted)
        return
    with closing(imap_unordered(call, {one[0]: one for one in wanted}, jobs)) as results:
        yield from results


class _Progress:
    """Progress on standard error."""

    def __init__(self, total: int, known: int) -> None:
        self._total, self._done, self._new = total, known, 0
        self._started_s = self._reported_s = time.monotonic()
        print(f"perception: {total} clips, {known} of them on file", file=sys.stderr, flush=True)

    def step(self) -> None:
        """Count a finished clip."""
        self._done, self._new, now_s = self._done + 1, self._new + 1, time.monotonic()
        if now_s - self._reported_s >= REPORT_EVERY_S:
            self._reported_s = now_s
            left_s = (now_s - self._started_s) / self._new * (self._total - self._done)
            print(
                f"perception: {self._done}/{self._total} clips, {left_s / 60:.1f} min left",
                file=sys.stderr,
                flush=True,
            )
