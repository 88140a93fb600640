"""`trepid train-lead`: renders labelled strips, fits the lead network, calibrates it and writes it as ONNX."""

import json
import time
from collections.abc import Sequence
from enum import StrEnum
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from learning.lead.frames import LABEL, MAX_VEHICLES, lead_road
from learning.lead.scores import (
    BANDS_M,
    FrameMatches,
    Match,
    by_distance,
    by_weather,
    calibrate,
    false_leaders,
    match,
    scores,
)
from learning.rendered import SHIPPED, Part, WeightsFolder, cores, need_torch, origin, render_roads, say, ship
from perception.lead.detection import Platt, Record, peaks
from perception.lead.view import COLUMNS, ROWS, STRIPS
from perception.net.session import load_record, open_session
from sim_harness.sweep.pool import imap
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.options import Car

FRAMES_PER_ROAD = 60
HELD_BACK_SHARE, HELD_BACK_ROADS = (
    10,
    50,
)  # a tenth as many roads for validation, as many for the test; at most
MIN_PROBABILITY = 0.3  # least output of a cell that counts
SURE = 0.5
REACH_M = BANDS_M[-1]
Figures = dict[str, float]


class Device(StrEnum):
    """Where the network is fitted."""

    AUTO = "auto"
    CPU = "cpu"
    CUDA = "cuda"


def train_lead(
    roads: Annotated[int, typer.Option(min=10, help="Random roads rendered for training.")] = 150,
    epochs: Annotated[int, typer.Option(min=1, help="Passes over the frames.")] = 20,
    seed: Annotated[int, typer.Option(min=0, help="Seed of roads, augmentation and initial weights.")] = 0,
    jobs: Annotated[
        int | None, typer.Option(min=1, help="Processes that render; the cores of the machine without it.")
    ] = None,
    hills: Annotated[float, typer.Option(min=0, max=1, help="Share of the roads with hills.")] = 0.15,
    start: Annotated[
        Path | None, typer.Option(help="Network that `train-lead` wrote, with its record, to train further.")
    ] = None,
    device: Annotated[
        Device, typer.Option(help="Where the network is fitted; auto: on a GPU that torch can use, if any.")
    ] = Device.AUTO,
    out: Annotated[Path, typer.Option(help="Folder for frames.")] = Path("out/train_lead"),
    weights: WeightsFolder = SHIPPED,
    car: Car = None,
    resume: Annotated[bool, typer.Option("--resume", help="Continue from existing frames.")] = False,
) -> None:
    """Train the lead detector on rendered vehicles and write its weights; needs the extra 'train'."""
    need_torch("train-lead")
    from learning.lead.fit import fit
    from learning.lead.network import export, load_network

    started_s = time.monotonic()
    used, jobs = torch_device(device), jobs or cores()
    held_back = min(roads // HELD_BACK_SHARE, HELD_BACK_ROADS)
    counts = dict(train=roads, validation=held_back, test=held_back)
    before = "" if start is None else f"{load_record(start, Record).command}; "
    part = partial(_part, load(CONFIG_DIR / "camera.yaml", Camera), hills)
    paths = {
        split: list(
            render_roads(
                part, split, count, seed=seed, folder=out, reuse=resume, key=f"hills {hills}", jobs=jobs
            )
        )
        for split, count in counts.items()
    }
    strips, vehicles = _load_frames(paths["train"])
    say(f"fit to {len(strips)} frames on {used}")
    known = None if start is None else load_network(start)
    network = fit(strips, vehicles, epochs=epochs, seed=seed, report=say, device=used, start=known)
    fresh = out / "lead_net.onnx"
    export(network, fresh)
    calibration = calibrate(
        [one for frame in _judge_all(fresh, paths["validation"], jobs) for one in frame.matches]
    )
    command = (
        f"trepid train-lead --roads {roads} --epochs {epochs} --seed {seed} --hills {hills:g} --device {used}"
    )
    command += "" if start is None else f" --start {start.name}"
    record = Record(
        **origin(fresh, before + command),
        parameters=sum(p.numel() for p in network.parameters()),
        calibration=calibration,
        min_probability=MIN_PROBABILITY,
        frames=len(strips),
        **measure_scores(_judge_all(fresh, paths["test"], jobs), calibration),
    )
    ship(fresh, record, weights)
    say(f"{(time.monotonic() - started_s) / 60:.1f} min")
    typer.echo(json.dumps(record.scores, indent=1))


def torch_device(device: Device) -> str:
    """The device of torch that ``device`` means here. Raises InputError for a GPU that is not there."""
    import torch

    there = torch.cuda.is_available()
    if device is Device.CUDA and not there:
        raise InputError("--device cuda: torch finds no GPU here; --device cpu fits without one")
    return Device.CUDA if there and device is not Device.CPU else Device.CPU


def _part(camera: Camera, hills: float, seed: int) -> Part:
    """The frames of the random road ``seed``."""
    road = lead_road(seed, camera, frames=FRAMES_PER_ROAD, hills=hills)
    return dict(
        strips=np.stack([frame.strips for frame in road.samples]),
        vehicles=np.stack([frame.vehicles for frame in road.samples]),
        lane_left_m=np.stack([frame.lane_left_m for frame in road.samples]),
        weather=np.array(road.weather),
    )


def _load_frames(paths: Sequence[Path]) -> tuple[np.ndarray, np.ndarray]:
    """Strips and vehicles of all frames, without a second copy of them in memory."""
    number = len(paths) * FRAMES_PER_ROAD
    strips = np.empty((number, STRIPS, ROWS, COLUMNS, 3), np.uint8)
    vehicles = np.empty((number, MAX_VEHICLES, len(LABEL)), np.float32)
    for index, path in enumerate(paths):
        own = slice(index * FRAMES_PER_ROAD, (index + 1) * FRAMES_PER_ROAD)
        with np.load(path) as part:
            strips[own], vehicles[own] = part["strips"], part["vehicles"]
    return strips, vehicles


def _judge_all(network: Path, paths: Sequence[Path], jobs: int) -> list[FrameMatches]:
    """The detections of ``network`` in the frames of ``paths`` beside the truth."""
    return [frame for frames in imap(partial(judge_road, network), paths, jobs) for frame in frames]


def judge_road(network: Path, path: Path) -> list[FrameMatches]:
    """The detections of ``network`` in the frames of one road beside the truth."""
    runner = open_session(network)
    with np.load(path) as part:
        frames = zip(part["strips"], part["vehicles"], part["lane_left_m"], strict=True)
        weather = tuple(str(name) for name in part["weather"])
    found = []
    for strips, vehicles, lane_left_m in frames:
        cells = runner.run(None, {"strips": strips})[0]
        matches = match(vehicles, peaks(cells, MIN_PROBABILITY), reach_m=REACH_M)
        found.append(FrameMatches(matches, lane_left_m, weather))
    return found


def measure_scores(frames: Sequence[FrameMatches], calibration: Platt) -> dict[str, Any]:
    """The fields ``scores``, ``by_distance`` and ``by_weather`` of the record; detections count from SURE on."""
    frames = [
        frame._replace(matches=[_calibrate_match(one, calibration) for one in frame.matches])
        for frame in frames
    ]
    matches = [one for frame in frames for one in frame.matches]
    whole = scores(matches, min_probability=SURE)
    whole["false_leaders_per_1000_frames"] = false_leaders(frames, min_probability=SURE)
    return dict(
        scores=_round_figures(whole),
        by_distance={
            name: _round_figures(row) for name, row in by_distance(matches, min_probability=SURE).items()
        },
        by_weather={
            name: _round_figures(row) for name, row in by_weather(frames, min_probability=SURE).items()
        },
    )


def _calibrate_match(one: Match, calibration: Platt) -> Match:
    if one.found is None:
        return one
    ahead_m, left_m, width_m, probability = one.found
    return one._replace(found=(ahead_m, left_m, width_m, calibration(probability)))


def _round_figures(figures: Figures) -> Figures:
    return {name: round(value, 4) for name, value in figures.items()}
