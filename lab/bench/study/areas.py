"""Where a road may be driven: every technique on one data set, ranked over seeds, and on smaller images (F12, A09).

*Ranking.* The review asks for a comparison of the techniques that identify the drivable area on one data set. The
data set is that of :mod:`lab.bench.perception.clips`: kinds of lines and roads, bends, light, weather, shadows and
traffic; its seed is its version. The techniques are all pipelines of ``config/pipelines.yaml`` that give a lane,
and the estimators of Trepid beside them. The score is the share of frames in which the lane is right
(:func:`lab.bench.perception.scores.correct`); ranks are those of this share on each seed. Intervals are those of
a bootstrap over the seeds.

*Smaller images.* The review warns that a smaller image, or another format, loses information in hard scenes. Each
clip is seen at all SIZES, reduced by areas with the camera reduced alike, and once in grey.

One line a clip in ``out/bench_perception``, or in ``runs/shrinking_<seed>.jsonl``: an interrupted benchmark
continues.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from lab.bench.perception.bench import watch_clips
from lab.bench.perception.clips import (
    CLEAR,
    GAP,
    WARM_UP_FRAMES,
    ClipCase,
    ClipFrame,
    harness_set,
    moments,
)
from lab.bench.perception.scores import (
    Results,
    correct,
    figures,
    given_frames,
    score_clips,
    times_ms,
)
from lab.bench.perception.watch import Looks, watch
from lab.bench.study.passages import mean_and_interval
from perception.techniques.recipe import recipes
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows
from sim_harness.world.roads.drawn import UNMARKED
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, WORK_DIR, load
from trepid.messages import EstimateKind
from trepid.types import Image

Row = dict[str, Any]
SEEDS = 5  # data sets of the ranking
OWN = ("cv", "cnn")
SIZES = ((320, 240), (160, 120), (80, 60), (48, 36))  # smaller ones are refused by every technique
GREY = "320×240, grey"
SHRUNK = ("cv", "canny_auto_hough", "ransac_parabola", "road_colour")
SHRUNK_SEEDS = 1
SCENES = ("clear, marked", "clear, unmarked")


def compared_techniques() -> tuple[str, ...]:
    """OWN, and every pipeline that gives a lane."""
    return (*OWN, *(name for name, recipe in recipes().items() if recipe.kind is EstimateKind.LANE))


def clips_of(seed: int) -> list[ClipCase]:
    """The clips of one data set: every kind of road in clear weather, every disturbance."""
    return [case for case in harness_set(seed, quick=True) if case.condition != GAP]


def bench_areas(seed: int, *, jobs: int = 1) -> Row:
    """The ranking of all techniques over SEEDS data sets."""
    names = compared_techniques()
    found = [watch_clips(clips_of(seed + n), names, seed + n, jobs=jobs) for n in range(SEEDS)]
    return {
        "right lanes, by technique": rank_techniques(found, names),
        "data sets": SEEDS,
        "clips of each": len(found[0]),
        "frames of each": sum(len(clip.truth) - WARM_UP_FRAMES for clip in found[0].values()),
    }


def rank_techniques(found: Sequence[Results], names: Sequence[str]) -> dict[str, Row]:
    """One row a technique, the best mean rank first, of the results on some data sets."""
    shares = np.array([[right_percent(results, name) for name in names] for results in found])
    ranks: NDArray[np.float64] = rankdata(-shares, axis=1)  # data set × technique
    table: dict[str, Row] = {}
    for j, name in enumerate(names):
        share, share_low, share_high = mean_and_interval(shares[:, j].tolist())
        rank, low, high = mean_and_interval(ranks[:, j].tolist())
        table[name] = {
            "mean rank": round(rank, 2),
            "from": round(low, 2),
            "to": round(high, 2),
            "right [%]": round(share, 1),
            "right from": round(share_low, 1),
            "right to": round(share_high, 1),
            **{
                f"{part} [%]": round(float(np.mean([right_percent(one, name, part) for one in found])), 1)
                for part in ("marked", "unmarked", "disturbed")
            },
            "boundary [m]": boundary_m(found, name),
            "ms": round(float(np.mean([times_ms(results, name)["ms_median"] for results in found])), 2),
        }
    return dict(sorted(table.items(), key=lambda one: one[1]["mean rank"]))


def right_percent(results: Results, name: str, part: str = "all") -> float:
    """The share of frames with a right lane on the clips of a part: marked and unmarked ones are clear."""
    looks = score_clips(results, name, [case for case in results if part in ("all", _part(case))])
    return 100.0 * float(np.mean(given_frames(looks) & correct(looks)))


def _part(case: ClipCase) -> str:
    if case.condition != CLEAR:
        return "disturbed"
    return "unmarked" if case.kind in UNMARKED else "marked"


def boundary_m(found: Sequence[Results], name: str) -> float | None:
    """The median over the data sets of the root mean square error of the boundaries; None without any."""
    errors = [figures(score_clips(results, name, results))["boundary_m_rmse"] for results in found]
    known = [error for error in errors if error is not None]
    return round(float(np.median(known)), 3) if known else None


def bench_shrinking(seed: int, *, jobs: int = 1) -> Row:
    """The share of right lanes by scene and size of the image, one table a technique."""
    cases = {f"{case.seed} {case.key}": case for n in range(SHRUNK_SEEDS) for case in clips_of(seed + n)}
    path = WORK_DIR / "runs" / f"shrinking_{seed}.jsonl"
    code = short_hash(fingerprint(*import_closure([__name__]), "config"), *map(estimator_fingerprint, SHRUNK))
    rows = stored_rows(
        path, partial(watch_shrunk, SHRUNK), cases, codes=dict.fromkeys(cases, code), jobs=jobs
    )
    by_scene: dict[str, list[Row]] = {}
    for case, row in zip(cases.values(), rows, strict=True):
        by_scene.setdefault(scene_of(case), []).append(row)
    scenes = sorted(by_scene, key=lambda scene: scene not in SCENES)
    tables = {
        name: {
            scene: {size: percent([row[size][name] for row in by_scene[scene]]) for size in rows[0]}
            for scene in scenes
        }
        | {"all": {size: percent([row[size][name] for row in rows]) for size in rows[0]}}
        for name in SHRUNK
    }
    return {f"{name}, right lanes [%]": table for name, table in tables.items()} | {
        "data sets": SHRUNK_SEEDS,
        "clips": len(cases),
    }


def scene_of(case: ClipCase) -> str:
    """The name of a scene: the disturbance, or clear weather on a marked or an unmarked road."""
    return f"{CLEAR}, {_part(case)}" if case.condition == CLEAR else case.condition.replace("_", " ")


def percent(counts: Sequence[Sequence[int]]) -> float:
    """The share of right frames of counts (right, all)."""
    right, frames = np.sum(counts, axis=0)
    return round(100.0 * float(right) / float(frames), 1)


def watch_shrunk(names: Sequence[str], case: ClipCase) -> Row:
    """Size -> technique -> right frames and all frames of a clip."""
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    clip = list(moments(case, camera, vehicle))
    return {
        size: {
            name: _counts(looks[WARM_UP_FRAMES:])
            for name, looks in watch(seen, names, there, vehicle).looks.items()
        }
        for size, (there, seen) in forms_of(clip, camera)
    }


def forms_of(
    clip: Sequence[ClipFrame], camera: Camera
) -> Iterator[tuple[str, tuple[Camera, list[ClipFrame]]]]:
    """Name of a form -> the camera of its images and the clip in them."""
    for width_px, height_px in SIZES:
        size = (width_px, height_px)
        yield (
            f"{width_px}×{height_px}",
            (
                camera.resize(*size),
                [_with(moment, smaller_image(moment.frame.image, size)) for moment in clip],
            ),
        )
    yield GREY, (camera, [_with(moment, grey(moment.frame.image)) for moment in clip])


def smaller_image(image: Image, size: tuple[int, int]) -> Image:
    """The image at another size (width, height), by areas."""
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)


def grey(image: Image) -> Image:
    """The image without colour, in three equal channels."""
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR).astype(
        np.uint8, copy=False
    )


def _with(moment: ClipFrame, image: Image) -> ClipFrame:
    return replace(moment, frame=replace(moment.frame, image=image))


def _counts(looks: Looks) -> tuple[int, int]:
    return int(np.count_nonzero(given_frames(looks) & correct(looks))), len(looks)
