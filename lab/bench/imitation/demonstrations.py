"""Simulated drives at 5 mph to learn from: on random roads, and on shipped ones that are only tested.

The driver follows the exact lane, from a start beside the centre on the random roads, and turns the wheel as the
feed-forward law (:mod:`controller.laws.feedforward`) does at AS_MPS: a network repeats these angles at every speed
up to it, where the lag of the car is four times as long a way. The labels are the measured steering, as in every
recording. Drives and data sets are kept under a hash of the code and of all else that they depend on.
"""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from controller.laws.feedforward import Feedforward
from controller.laws.law import Acting
from lab.bench.control.contestants import nominal, shipped_settings
from lab.bench.control.speeds import MPH
from learning.correcting.alone import EXPERT
from learning.dataset.build import built_once
from learning.dataset.dataset import Dataset, Split
from learning.drawn_frames import drawn_road, random_road
from learning.rendered import say
from sim_harness.lockstep.closed_loop import Instant, Result, Witness, build_parts, run
from sim_harness.lockstep.oracle import Oracle
from sim_harness.lockstep.recording import recording
from sim_harness.lockstep.unsupervised import FollowedLane, UnsupervisedDriver
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash
from sim_harness.sweep.store import finish_tasks
from sim_harness.world.roads.road import Road
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.clothoid import Lane
from trepid.files.whole import write_whole
from trepid.messages import Decision, SimTruth, SteeringEstimate

SPEED_MPS = 5 * MPH
AS_MPS = 20 * MPH
RATE_HZ = 5.0  # of the camera: 0.45 m between two frames
OFFSET_M, HEADING_RAD = 0.3, 0.1  # deviations at the start: the way back to the centre is learned there
SETTLED_S = 0.8  # after the start the wheel, straight at first, has the angle that the lane asks for
ROUTE_M, END_M = 24.0, 15.0  # of a random road that is driven, and behind it
UNSEEN: Mapping[str, Mapping[str, str]] = {  # scenario -> changes
    "circuit": {"start.station_m": "120", "distance_m": "300", "duration_s": "200"},
    "curve_left_r15": {"duration_s": "110"},
    "s_curve": {"duration_s": "110"},
    "unmarked_bend": {"duration_s": "110"},
}
SPLITS = {
    "random": Split(by="route", seed=1, gap_s=1.0, shares={"train": 0.78, "validation": 0.12, "test": 0.1}),
    "unseen": Split(by="time", seed=1, gap_s=1.0, shares={"train": 0.0, "validation": 0.0, "test": 1.0}),
}


class Demonstration(NamedTuple):
    """A drive, and the file of its recording."""

    scenario: Scenario
    seed: int
    path: Path


def demonstrations(folder: Path, *, roads: int, seed: int, jobs: int) -> dict[str, Dataset]:
    """The data sets "random", of drives on ``roads`` random roads, and "unseen"; made where they are missing."""
    drives = drives_folder(folder, seed)
    wanted = {
        "random": [_on_random_road(drives, seed, number) for number in range(roads)],
        "unseen": [_on_shipped_road(drives, name, changes) for name, changes in UNSEEN.items()],
    }
    return {name: driven_set(folder, name, group, SPLITS[name], jobs) for name, group in wanted.items()}


def drives_folder(folder: Path, seed: int) -> Path:
    """Where the drives of a seed are, in ``folder``, under a hash of the code."""
    code = fingerprint(*import_closure([__name__]), "config")
    drives = folder / f"drives-{short_hash(code, str(seed))}"
    drives.mkdir(parents=True, exist_ok=True)
    return drives


def driven_set(folder: Path, name: str, wanted: list[Demonstration], split: Split, jobs: int) -> Dataset:
    """The data set ``name`` of drives in a :func:`drives_folder`, driven and built where they are missing."""
    missing = {one.path.stem: one for one in wanted if not one.path.is_file()}
    for drive, row in finish_tasks(demonstrate, missing, jobs):
        say(
            f"{drive}: {row['distance_m']:.0f} m, at most {row['max_lateral_error_m']:.2f} m beside the centre"
        )
    paths = [one.path for one in wanted]
    digest = short_hash(split.model_dump_json(), *map(str, paths))  # the folder has the hash of the code
    return built_once(folder / f"{name}-{digest}", paths, split)


def _on_random_road(drives: Path, seed: int, number: int) -> Demonstration:
    rng = np.random.default_rng((seed, number))
    road = (drawn_road if rng.random() < 0.5 else random_road)(rng)
    station_m = rng.uniform(0.0, road.length_m - ROUTE_M - END_M)
    return on_road(drives, road, f"{number:04}", number, station_m=station_m, rng=rng)


def on_road(
    drives: Path, road: Road, name: str, seed: int, *, station_m: float, rng: np.random.Generator
) -> Demonstration:
    """A drive of ROUTE_M along ``road`` from ``station_m`` on, which begins beside the centre."""
    start = {
        "start.offset_m": f"{rng.normal(0.0, OFFSET_M):.3f}",
        "start.heading_rad": f"{rng.normal(0.0, HEADING_RAD):.4f}",
        "start.station_m": f"{station_m:.1f}",
    }
    text = road.settings.model_dump_json(exclude_defaults=True)  # JSON is YAML
    name = f"{name}-{short_hash(text, *start.values())}"
    write_whole(drives / f"road-{name}.yaml", text.encode())
    changes = {
        "road": str(drives / f"road-{name}.yaml"),
        "start.speed_mps": str(SPEED_MPS),
        "distance_m": str(ROUTE_M),
    }
    return Demonstration(_scenario("straight", changes | start), seed, drives / f"random-{name}.mcap")


def _on_shipped_road(drives: Path, name: str, changes: Mapping[str, str]) -> Demonstration:
    return Demonstration(_scenario(name, changes), 0, drives / f"{name}.mcap")


def _scenario(source: str, changes: Mapping[str, str]) -> Scenario:
    fixed = {"speed_mps": str(SPEED_MPS), "camera.rate_hz": str(RATE_HZ), "estimators": json.dumps(["cv"])}
    return load_scenario(source, {**fixed, **changes})


def demonstrate(task: Demonstration) -> dict[str, float]:
    """Drive along the exact lane and record from SETTLED_S on; the scores of the drive."""
    scenario, seed, path = task
    partial = path.with_suffix(".partial")
    partial.unlink(missing_ok=True)
    with recording(partial, scenario) as witness:

        def watch_settled(now: Instant) -> None:
            if now.truth.t_s >= SETTLED_S:
                witness(now)

        metrics = drive_exactly(scenario, seed=seed, witness=watch_settled).metrics
    partial.replace(path)
    return {"distance_m": metrics.distance_m, "max_lateral_error_m": metrics.max_lateral_error_m}


def drive_exactly(scenario: Scenario, *, seed: int, witness: Witness | None = None) -> Result:
    """Drive at constant set speed along the arcs of :func:`followed_lane`."""
    parts = build_parts(scenario, seed=seed)
    vehicle = nominal()
    oracle = Oracle(EXPERT, parts.vehicle.road, vehicle)
    law = Feedforward(shipped_settings().lateral.feedforward, vehicle)
    newest: FollowedLane | None = None

    def choice(_: Decision, __: object) -> FollowedLane | None:
        return newest

    def watch(now: Instant) -> None:
        nonlocal newest
        newest = followed_lane(now.truth, oracle.step(now.truth), law, vehicle)
        if witness is not None:
            witness(now)

    speed_mps = scenario.speed_mps or SPEED_MPS
    driver = UnsupervisedDriver(parts.supervisor, EXPERT, choice, cruise_speed_mps=speed_mps)
    parts = replace(parts, supervisor=driver, lead=None)  # type: ignore[arg-type]
    return run(scenario, seed=seed, parts=parts, witness=watch)


def followed_lane(
    truth: SimTruth, exact: SteeringEstimate, law: Feedforward, vehicle: Vehicle
) -> FollowedLane | None:
    """The arc that ``law`` follows at AS_MPS, of the lane ``exact`` at ``truth``."""
    assert exact.curvature_rate_1pm2 is not None  # of an Oracle
    bend_1pm = truth.curvature_1pm
    lane = Lane(truth.lateral_offset_m, truth.heading_error_rad, bend_1pm, exact.curvature_rate_1pm2)
    # the law reads lane and speed only
    now = Acting(lane, AS_MPS, wheel_rad=0.0, curvature_1pm=0.0, steady_1pm=0.0, seen=lane)
    angle_rad = road_wheel_angle(law.curvature(now, dt_s=0.0), wheelbase_m=vehicle.wheelbase_m)
    return FollowedLane.arc(replace(exact, road_wheel_angle_rad=angle_rad), wheelbase_m=vehicle.wheelbase_m)
