"""Networks with and without a memory alone through a corner of R = 12 m (Deep Steer 5.3, N05, N09).

Deep Steer steers by a sequence of images, and names sharp corners as its limit: the camera shows the road from some
metres ahead of the axle on, so that inside of a corner a single image no longer shows the place where the car is. A
memory may hold it. Here both kinds of network learn the same frames, of drives along the exact lane through corners
of RADII_M to either side, on roads of every kind with lines, and then drive
``config/scenarios/sharp_corner_r12.yaml`` alone at 5 mph: no other estimator, no supervision, the newest angle is
the command. Its road is in no training.

The corner is driven as shipped and mirrored, from the centre and from places beside it. Each score is that of the
worst of these drives: ``in the corner [m]`` and ``after it [m]`` are the greatest lateral errors there, and after
it the scenario permits 0.3 m. Drives, data sets, networks and rows are in ``out/study``; the same command continues
an interrupted study.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from lab.bench.imitation.demonstrations import (
    RATE_HZ,
    ROUTE_M,
    SPEED_MPS,
    SPLITS,
    Demonstration,
    driven_set,
    drives_folder,
    on_road,
)
from lab.bench.imitation.training_code import code_of_training, one_stage, train_once
from learning.correcting.alone import drive_alone, scenario_for
from learning.dataset.dataset import Dataset
from learning.judging.evaluate import Bench
from learning.judging.predictions import JudgedModel
from learning.rendered import need_torch
from learning.training.recipe import load_recipe
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import stored_rows
from sim_harness.world.roads.drawn import LEAD_IN_M, UNMARKED, MarkingKind, random_section
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.config import WORK_DIR
from trepid.types import Column

Row = dict[str, Any]
SCENARIO = "sharp_corner_r12"
OFFSETS_M = (-0.3, 0.0, 0.3)  # at the start of the judged drives
CORNER_M, AFTER_M = 35.0, 66.0  # stations from which it bends, and from which it asks for the centre
RADII_M = (10.0, 18.0)
ENTRY_M, ARC_RAD, WIDTH_M = (8.0, 14.0), (0.5, 1.3), (3.0, 3.9)
ROADS, QUICK_ROADS = 400, 160
TRAININGS, QUICK_TRAININGS = 3, 1
EPOCHS, RATE, BATCH = 12, 2.0e-3, 32
WINDOW = 16  # frames: 7 m
# As in `lab.bench.imitation.harness`: labels without noise need no weaker networks.
COMMON = {
    "height_px": "60",
    "width_px": "80",
    "dropout": "0",
    "weight_decay": "0.001",
    "head": "laplace",
    "beta": "1.0",
}
SEQUENCE = {"window": str(WINDOW), "frames_share": str(2 / WINDOW), "batch": str(BATCH // 2)}
NETWORKS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "one frame (steer)": ("steer", {"batch": str(BATCH)}),
    "sequence (steer-lstm)": ("steer-lstm", SEQUENCE),
    "sequence (cnn-lstm)": ("cnn-lstm", SEQUENCE),
}


class CornerTraining(NamedTuple):
    """A network to train on the corners and to drive through the shipped one."""

    data: Path
    network: str
    changes: tuple[tuple[str, str], ...]  # of the recipe
    out: Path


def bench_corner(seed: int, *, jobs: int = 1, quick: bool = False) -> Row:
    """Lateral errors of the networks, the worst of their drives; ``quick``: one training, fewer roads."""
    need_torch("bench study-corner")
    folder = WORK_DIR / "out" / "study" / f"corner-{seed}"
    data = corner_set(folder, roads=QUICK_ROADS if quick else ROADS, seed=seed, jobs=jobs)
    tasks = {
        f"{name}, training {number}": _task(folder, data, network, changes, seed + number)
        for name, (network, changes) in NETWORKS.items()
        for number in range(QUICK_TRAININGS if quick else TRAININGS)
    }
    code = fingerprint(*import_closure([__name__, "learning.correcting.alone"]), "config")
    codes = {name: short_hash(code, task.out.stem) for name, task in tasks.items()}
    rows = dict(
        zip(tasks, stored_rows(folder / "rows.jsonl", judge, tasks, codes=codes, jobs=jobs), strict=True)
    )
    return tables(rows) | {"drives": len(data.file.sources), "frames": len(data.labelled_rows("train"))}


def tables(rows: Mapping[str, Row]) -> Row:
    """The tables of the page, of the rows of the trainings: the median of each network, and all of them."""
    found: dict[str, Row] = {}
    for name in NETWORKS:
        mine = [row for case, row in rows.items() if case.startswith(name)]
        found[name] = {score: round(float(np.median([row[score] for row in mine])), 3) for score in mine[0]}
    return {"median of the trainings": found, "trainings": dict(rows)}


def corner_set(folder: Path, *, roads: int, seed: int, jobs: int) -> Dataset:
    """The data set of the drives through corners, driven and built where it is missing."""
    drives = drives_folder(folder, seed)
    wanted = [_through_corner(drives, seed, number) for number in range(roads)]
    return driven_set(folder, f"corners-{roads}", wanted, SPLITS["random"], jobs)


def _through_corner(drives: Path, seed: int, number: int) -> Demonstration:
    rng = np.random.default_rng((seed, number))
    road = corner_road(rng)
    from_m = rng.uniform(LEAD_IN_M - ROUTE_M / 2, road.length_m - 2 * ROUTE_M)
    return on_road(drives, road, f"{number:04}", number, station_m=from_m, rng=rng)


def corner_road(rng: np.random.Generator) -> Road:
    """A straight, a corner of RADII_M to either side with clothoids, a straight; lines of a random kind."""
    kinds = [kind for kind in MarkingKind if kind not in UNMARKED]
    curvature = float(rng.choice([-1, 1])) / float(rng.uniform(*RADII_M))
    entry_m, exit_m = rng.uniform(*ENTRY_M, 2).tolist()
    settings = RoadSettings(
        name="corner",
        closed=False,
        lane_width_m=float(rng.uniform(*WIDTH_M)),
        sun_azimuth_rad=float(rng.uniform(-np.pi, np.pi)),
        segments=(
            Segment(length_m=LEAD_IN_M),
            Segment(length_m=entry_m, curvature_1pm=(0.0, curvature)),
            Segment(length_m=float(rng.uniform(*ARC_RAD)) / abs(curvature), curvature_1pm=curvature),
            Segment(length_m=exit_m, curvature_1pm=(curvature, 0.0)),
            Segment(length_m=3 * ROUTE_M),
        ),
        sections=(random_section(kinds[int(rng.integers(len(kinds)))], rng),),
    )
    return Road(settings)


def _task(folder: Path, data: Dataset, network: str, changes: Mapping[str, str], seed: int) -> CornerTraining:
    changes = {**COMMON, **changes, "seed": str(seed), "stages": one_stage(EPOCHS, RATE)}
    recipe = load_recipe(network, None, overrides=changes)
    digest = short_hash(code_of_training(network), recipe.model_dump_json(), data.sha256)
    return CornerTraining(
        data.folder, network, tuple(changes.items()), folder / "weights" / f"{network}-{digest}.onnx"
    )


def judge(task: CornerTraining) -> Row:
    """Train a network, unless it is there, and drive it through the corner."""
    data = Dataset.open(task.data)
    recipe = load_recipe(task.network, None, overrides=dict(task.changes))
    train_once(data, task.network, task.out, recipe, "trepid bench study-corner")
    cv2.setNumThreads(1)
    bench, model = Bench(data, "test"), JudgedModel(str(task.out))
    row = bench.row(model, model.predict(data, bench.rows))
    drives = [drive(corner(task.out, offset_m, side)) for side in (1, -1) for offset_m in OFFSETS_M]
    worst = {name: max(one[name] for one in drives) for name in drives[0]}
    return {"test mae [deg]": round(row["mae_deg"], 3), **worst}


def corner(network: Path, offset_m: float, side: int) -> Scenario:
    """SCENARIO alone at SPEED_MPS from ``offset_m`` beside the centre; ``side`` -1: mirrored, a right corner."""
    shipped = load_scenario(SCENARIO)
    changes = {
        "speed_mps": str(SPEED_MPS),
        "start.speed_mps": str(SPEED_MPS),
        "start.offset_m": str(offset_m),
        "camera.rate_hz": str(RATE_HZ),
    }
    for number, segment in enumerate(shipped.segments or ()):
        bend = np.multiply(segment.curvature_1pm, side).tolist()
        changes[f"segments.{number}.curvature_1pm"] = str(bend)
    return scenario_for(SCENARIO, network, changes)


def drive(scenario: Scenario) -> Row:
    """The scores of a drive alone."""
    result = drive_alone(scenario, seed=0)
    station_m, offset_m = (result.trace[name] for name in ("station_m", "lateral_offset_m"))
    inside, after = (station_m >= CORNER_M) & (station_m < AFTER_M), station_m >= AFTER_M
    return {
        "in the corner [m]": greatest(offset_m[inside]),
        "after it [m]": greatest(offset_m[after]),
        "rms [m]": round(result.metrics.rms_lateral_error_m, 3),
        "departures": result.metrics.departures,
        "interventions": result.metrics.interventions,
    }


def greatest(offset_m: Column) -> float:
    """The greatest size [m]; NaN where the car did not come."""
    return round(float(np.abs(offset_m).max()), 3) if len(offset_m) else float("nan")
