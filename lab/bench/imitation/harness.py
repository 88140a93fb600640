"""Networks that learn from simulated drives at 5 mph: judged on roads of no training, and alone in the simulator.

"random" in a name: on random roads as those of the training, but others; else on the shipped, unseen ones. Degrees
are of a steering wheel with the ratio BIN_RATIO, as in Deep Steer. Scenarios with other vehicles are left out: a
network steers, and does not keep a distance.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np

from lab.bench.control.speeds import MPH
from lab.bench.fear.kinds import kinds
from lab.bench.imitation.demonstrations import demonstrations, drive_exactly
from lab.bench.imitation.training_code import code_of_training, one_stage, train_once
from lab.bench.imitation.verdict import (
    AUTONOMY,
    DEPARTURES,
    DRIVEN,
    EXACT,
    FARTHEST,
    KINDS,
    MOVED,
    SHIFTED,
    UNLIKE,
)
from learning.correcting.alone import drive_alone, scenario_for
from learning.dataset.dataset import Dataset
from learning.judging.evaluate import BIN_RATIO, Bench
from learning.judging.predictions import JudgedModel, Predictions
from learning.judging.scores import SHARP_DEG
from learning.pixels import SHIFTS
from learning.training.recipe import Recipe, load_recipe
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.scenario import Scenario, Sight, Tag, list_scenarios, load_scenario
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import Row, stored_rows

CLEAN = {"dropout": "0", "weight_decay": "0.001"}  # labels without noise need no weaker networks
# head: the median of the labels does not follow those of a few frames that do not show the lane
FINE = {"height_px": "96", "width_px": "128", "batch": "32", "beta": "1.0", "head": "laplace", **CLEAN}
PEER = "donkey-linear"
DRIVER = "steer"  # the network that also drives
NETWORKS: Mapping[str, Mapping[str, str]] = {  # network -> changes of its recipe
    PEER: {},
    DRIVER: FINE,
    "steer-motion": {**FINE, "batch": "64"},
    "steer-lstm": {"window": "16", "frames_share": "0.125", **FINE, "batch": "16"},  # 16 frames are 7 m
}
ROADS, EPOCHS = 2000, 4
QUICK_ROADS, QUICK_EPOCHS = 4, 1
RATE, PEER_RATE = 2.0e-3, 1.0e-3  # of learning; that of donkeycar
SPEEDS_MPH, QUICK_SPEEDS_MPH = (5, 10, 15, 20), (20,)
QUICK_SCENARIOS = ("straight", "unmarked_bend")
TAGS = {Tag.NOMINAL, Tag.UNMARKED}
BESIDE = ("cv", "cnn")  # estimators beside the network under supervision
SLACK = 2.5  # of the time for the route there: the supervisor slows down


class RoadTraining(NamedTuple):
    """A network to train on the random roads and to judge on the unseen ones."""

    random: Path
    unseen: Path
    network: str
    recipe: Recipe
    out: Path


class NetworkDrive(NamedTuple):
    """A drive of a network alone, supervised, or with the angles of the demonstrations instead."""

    scenario: Scenario
    driver: Literal["alone", "supervised", "exact"]


def bench_harness(folder: Path, *, quick: bool, seed: int, jobs: int) -> dict[str, dict[str, Row]]:
    """Tables by network, "unseen roads"; by shift, SHIFTED, UNLIKE, MOVED; by scenario, those of the drives."""
    roads = QUICK_ROADS if quick else ROADS
    sets = demonstrations(folder, roads=roads, seed=seed, jobs=jobs)
    tasks = {name: _task(folder, sets, name, changes, quick=quick) for name, changes in NETWORKS.items()}
    judging = fingerprint(*import_closure(["learning.judging.evaluate", __name__]), "config")
    codes = {name: short_hash(task.out.stem, judging) for name, task in tasks.items()}
    rows = stored_rows(folder / "rows.jsonl", judge_training, tasks, codes=codes, jobs=jobs)
    table = dict(zip(tasks, rows, strict=True))
    tables: dict[str, dict[str, Row]] = {"unseen roads": table}
    shifts = {name: row.pop("shifts") for name, row in table.items()}
    for title, score in ((SHIFTED, "coverage_90"), (UNLIKE, "unlike_share"), (MOVED, "moved_deg")):
        tables[title] = {
            shift: {name: found[shift][score] for name, found in shifts.items()} for shift in SHIFTS
        }
    without_image = Bench(sets["unseen"], "test", ratio=BIN_RATIO, trained=sets["random"]).baselines
    table |= {name: dict(row) for name, row in without_image.items()}
    return tables | _drives(folder, tasks[DRIVER].out, quick=quick, jobs=jobs)


def _task(
    folder: Path, sets: Mapping[str, Dataset], name: str, changes: Mapping[str, str], *, quick: bool
) -> RoadTraining:
    stages = one_stage(QUICK_EPOCHS if quick else EPOCHS, PEER_RATE if name == PEER else RATE)
    recipe = load_recipe(name, None, overrides={"stages": stages, **changes})
    digest = short_hash(code_of_training(name), recipe.model_dump_json(), sets["random"].sha256)
    return RoadTraining(
        sets["random"].folder,
        sets["unseen"].folder,
        name,
        recipe,
        folder / "weights" / f"{name}-{digest}.onnx",
    )


def judge_training(task: RoadTraining) -> Row:
    """Train a network, unless it is there, and score it on the unseen roads."""
    data, unseen = Dataset.open(task.random), Dataset.open(task.unseen)
    train_once(data, task.network, task.out, task.recipe, "trepid bench imitation")
    cv2.setNumThreads(1)
    model = JudgedModel(str(task.out))
    benches = [Bench(one, "test", ratio=BIN_RATIO) for one in (data, unseen)]
    found = [model.predict(bench.dataset, bench.rows) for bench in benches]
    alike, row = (bench.row(model, one) for bench, one in zip(benches, found, strict=True))
    sharp = [one["mae_deg"] for one in row["sharpness"] if one["from_deg"] == SHARP_DEG]
    rates = ("rate_rms_degps", "recorded_rate_rms_degps", "rate_error_rms_degps")
    names = ("mae_deg", "rmse_deg", "r2", "slope", *rates, "latency_ms")
    return {name: row[name] for name in names} | {
        f"mae_beyond_{SHARP_DEG:.0f}_deg": sharp[0] if sharp else None,
        "coverage_90": row["uncertainty"]["coverage_90"],
        "mae_random_deg": alike["mae_deg"],
        "coverage_90_random": alike["uncertainty"]["coverage_90"],
        "error_rank_correlation": row["uncertainty"]["risk"]["spearman"],
        "weights": row["parameters"],
        "frames": row["frames"],
        "shifts": judge_shifts(model, benches[1], found[1]),
    }


def judge_shifts(model: JudgedModel, bench: Bench, plain: Predictions) -> dict[str, Row]:
    """Shift -> coverage of the 90 % intervals, share of images outside the network's world, change of the angle.

    ``plain``: the predictions without a shift.
    """
    rows: dict[str, Row] = {}
    for name, shift in SHIFTS.items():
        rng = np.random.default_rng(0)
        found = model.predict(bench.dataset, bench.rows, change=partial(shift, rng=rng))
        stated = bench.row(model, found)["uncertainty"]
        rows[name] = {
            "coverage_90": stated["coverage_90"],
            "unlike_share": stated["outside"],
            "moved_deg": float(np.degrees(np.abs(found.angle_rad - plain.angle_rad).mean())) * BIN_RATIO,
        }
    return rows


def _drives(folder: Path, network: Path, *, quick: bool, jobs: int) -> dict[str, dict[str, Row]]:
    """Scenario -> farthest place beside the centre and autonomy by speed, alone; scores of the other drivers.

    KINDS: driver and speed -> how many of its drives ended how.
    """
    names = QUICK_SCENARIOS if quick else steering_scenarios()
    speeds = QUICK_SPEEDS_MPH if quick else SPEEDS_MPH
    drives = {
        f"{name} {mph} mph": NetworkDrive(_scenario(name, network, mph), driver="alone")
        for name in names
        for mph in speeds
    }
    drives |= {
        f"{name} {mph} mph supervised": NetworkDrive(
            supervised_scenario(name, network, mph), driver="supervised"
        )
        for name in names
        for mph in speeds
    }
    fastest = str(max(speeds) * MPH)
    drives |= {
        f"{name} exact": NetworkDrive(
            load_scenario(name, {"speed_mps": fastest, "start.speed_mps": fastest, "sight": Sight.TRUTH}),
            driver="exact",
        )
        for name in names
    }
    modules = ["learning.correcting.alone", __name__]
    code = fingerprint(*import_closure(modules), "config", "perception/weights")
    codes = dict.fromkeys(drives, f"{code} {network.stem}")
    rows = dict(
        zip(
            drives,
            stored_rows(folder / "drives.jsonl", drive_network, drives, codes=codes, jobs=jobs),
            strict=True,
        )
    )
    titles = {
        FARTHEST: ("", "max_lateral_error_m"),
        AUTONOMY: ("", "autonomy_percent"),
        DEPARTURES: (" supervised", "departures"),
        DRIVEN: (" supervised", "driven_percent"),
    }
    tables = {
        title: {
            name: {f"{mph} mph": rows[f"{name} {mph} mph{driver}"][score] for mph in speeds} for name in names
        }
        for title, (driver, score) in titles.items()
    }
    tables[KINDS] = {
        f"{mode}, {mph} mph": kinds([rows[f"{name} {mph} mph{driver}"] for name in names])
        for mode, driver in (("alone", ""), ("supervised beside cv and cnn", " supervised"))
        for mph in speeds
    }
    return tables | {EXACT.format(max(speeds)): {name: rows[f"{name} exact"] for name in names}}


def steering_scenarios() -> list[str]:
    """The nominal and the unmarked scenarios without other vehicles."""
    found = [one for one in list_scenarios() if not one.traffic and one.sight is Sight.CAMERA]
    return [one.name for one in found if set(one.tags) & TAGS]


def _scenario(name: str, network: Path, mph: float) -> Scenario:
    speed = str(mph * MPH)
    return scenario_for(name, network, {"speed_mps": speed, "start.speed_mps": speed})


def supervised_scenario(name: str, network: Path, mph: float) -> Scenario:
    """The scenario with the network beside BESIDE, and SLACK times the time that its route takes at this speed."""
    speed_mps = mph * MPH
    speed = {"speed_mps": str(speed_mps), "start.speed_mps": str(speed_mps)}
    scenario = load_scenario(name, {**speed, **changes_of([*BESIDE, str(network)])})
    route_s = scenario.route_m(scenario.build_road()) / speed_mps
    return scenario.model_copy(update={"duration_s": max(scenario.duration_s, SLACK * route_s)})


def drive_network(task: NetworkDrive) -> Row:
    """The scores of a drive."""
    match task.driver:
        case "alone":
            result = drive_alone(task.scenario, seed=0)
        case "supervised":
            result = run(task.scenario)
        case "exact":
            result = drive_exactly(task.scenario, seed=0)
    row = result.row()
    route_m = task.scenario.route_m(task.scenario.build_road())
    names = ("autonomy_percent", "max_lateral_error_m", "departures")
    return {name: row[name] for name in names} | {
        "driven_percent": min(100.0, 100.0 * row["distance_m"] / route_m)
    }
