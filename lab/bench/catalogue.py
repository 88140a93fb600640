"""The table of benchmarks: ``trepid bench NAME``. A benchmark is imported when it runs."""

import importlib
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple


class Benchmark(NamedTuple):
    """The module of a benchmark, below ``lab.bench``, and one line for ``trepid bench --list``."""

    module: str
    summary: str
    values: str = ""  # of the numbers in its figure, where their names do not give meaning and unit
    pictured: bool = True  # False: its rows have hardly a column in common
    continued: bool = False  # an interrupted one is continued by the same command: its seed is fixed
    own_figure: bool = False  # drawn by the function `draw` of its module instead of as bars


BENCHMARKS = {
    "estimators": Benchmark("frames", "time of each estimator for one frame"),
    "memory": Benchmark(
        "perception.memory", "peak memory of a process that runs an estimator, both, and both under fear"
    ),
    "renderer": Benchmark("frames", "time of a rendered frame"),
    "lockstep": Benchmark("lockstep", "real-time factor of the closed loop"),
    "plants": Benchmark("plants", "steps per second of the vehicle models and their peers"),
    "sweep": Benchmark("sweep", "speed-up of two processes over one"),
    "determinism": Benchmark("sweep", "one trace hash from 100 runs under load"),
    "pipeline": Benchmark(
        "live.pipeline", "a frame from process to process at 30 Hz, beside bare Zenoh; a queue under overload"
    ),
    "faults": Benchmark(
        "live.faults.bench", "faults of real processes: time to the brake, lane, ends, recordings"
    ),
    "live": Benchmark(
        "live.agreement",
        "live drives beside lock-step runs of the same scenarios, on a quiet and on a loaded machine",
        pictured=False,
        continued=True,
    ),
    "soak": Benchmark(
        "live.soak", "half an hour live: memory, files, threads, lost messages of the recorder"
    ),
    "page": Benchmark(
        "live.page",
        "the live page: capture to screen, share of a core, frame to command with and without viewer",
    ),
    "page-answers": Benchmark(
        "live.answers",
        "the live page: from its printed address to answer and picture, a check of the rules, at loads 0 and 8",
        pictured=False,
    ),
    "rc": Benchmark(
        "live.small",
        "the RC car at 20 frames a second, alone and beside other work: estimators missed, share of a core",
        pictured=False,
    ),
    "logbook": Benchmark(
        "logbook.bench",
        "recordings: random moments explained, opening of half an hour, what a crash leaves, replay",
        pictured=False,
    ),
    "dbc": Benchmark(
        "foreign.dbc",
        "DBC files of opendbc that load, and messages that differ from cantools",
        pictured=False,
    ),
    "opendrive": Benchmark(
        "foreign.opendrive",
        "lanes of OpenDRIVE files of other tools that are imported, and those within 2 cm of an evaluation",
        pictured=False,
    ),
    "newcomer": Benchmark("newcomer", "clone, make drive: time until the car drives, disk space"),
    "drive": Benchmark("runs", "one lap live: tracking error, latency, load of each process"),
    "suite": Benchmark("runs", "all scenarios in lock-step: passed, departures, tracking error"),
    "seeds": Benchmark("seeds", "scores with known seeds and with fresh ones"),
    "perception": Benchmark("perception.bench", "every estimator on rendered clips"),
    "sight": Benchmark(
        "perception.sight",
        "sight distance in fog, night, rain and snow, over crests, behind walls and trucks; on real images",
        pictured=False,
    ),
    "within-sight": Benchmark(
        "within_sight",
        "standing and slow vehicles in fog, at night, in rain, beyond crests and walls, at 5 to 25 m/s",
        continued=True,
    ),
    "unknown-camera": Benchmark(
        "perception.unknown_camera",
        "how soon a drive measures the height, the lens and the direction of a camera without a file",
    ),
    "real": Benchmark(
        "real.bench", "estimators and the supervisor on every real drive, beside trivial baselines"
    ),
    "resimulation": Benchmark(
        "real.resimulation",
        "the supervised car in closed loop on footage of real drives and foreign simulators",
    ),
    "imitation": Benchmark(
        "imitation.bench",
        "networks that learn from drives: on unseen simulated roads, alone, on the last fifth of real drives",
        continued=True,
    ),
    "control-lateral": Benchmark(
        "control.lateral",
        "tracking error of the lateral laws and two baselines",
        values="largest distance from the lane centre [m]",
    ),
    "control-mpc": Benchmark("control.mpc", "time of an MPC step, relative to acados"),
    "control-speeds": Benchmark(
        "control.speeds",
        "tracking error from 5 mph to 30 m/s with one tuning",
        values="largest distance from the lane centre [m], by speed [m/s]",
    ),
    "control-deep-steer": Benchmark(
        "control.deep_steer", "the failure of Deep Steer above 5 mph, reproduced"
    ),
    "control-drift": Benchmark(
        "control.drift",
        "overshoot after a drift, as in Euro NCAP LSS",
        values="overshoot relative to the least possible one, by speed of the drift",
    ),
    "control-learning": Benchmark(
        "control.learning", "error with and without learned steering offset and understeer"
    ),
    "control-longitudinal": Benchmark(
        "control.longitudinal", "stopping distance and following of a braking vehicle"
    ),
    "control-ranking": Benchmark(
        "control.speeds",
        "rank correlation of the laws between plants",
        values="root mean square of the distance from the lane centre [m]",
    ),
    "control-robustness": Benchmark(
        "control.robustness",
        "every law on cars with undeclared dead time, lag, gain and noise: tracking error, departures",
        values="largest root mean square of the distance from the lane centre [m]",
    ),
    "control-limits": Benchmark("control.limits", "random drives to the limits of ISO 11270 and R79"),
    "control-random": Benchmark("control.lateral", "1000 cars that differ from their file"),
    "fear-inference": Benchmark("fear.inference", "time of an inference, relative to scikit-fuzzy"),
    "fear-causes": Benchmark("fear.causes", "share of injected faults whose cause is named correctly"),
    "fear-fuzz": Benchmark("fear.fuzz", "broken numbers in messages never lower fear"),
    "fear-supervision": Benchmark(
        "fear.supervision", "supervised car and unsupervised drivers on hard drives"
    ),
    "fear-severity": Benchmark(
        "severity.bench",
        "fear over the grade of every disturbance and fault, by speed: falls, right causes",
        continued=True,
        own_figure=True,
    ),
    "measured-faults": Benchmark(
        "measured.bench",
        "wrong speeds, wheel angles and yaw rates through every wire: lane, and the quantity named",
        continued=True,
    ),
    "security": Benchmark("security", "foreign, malformed and replayed messages that a drive acts upon"),
    "security-flood": Benchmark("flood", "a drive under 100 000 messages a second, with and without keys"),
    "follow-detector": Benchmark("follow.detector", "recall and precision of the lead detector"),
    "follow-runs": Benchmark("follow.runs", "1000 cases of following with a modelled detector"),
    "follow-rendered": Benchmark("follow.runs", "40 cases of following with rendered images"),
    "tracks": Benchmark(
        "perception.tracks",
        "laps on tape: bends of 1.5 to 3 lane widths, ten tapes and floors, a single line; departures, speed",
    ),
    "tiles": Benchmark(
        "foreign.tiles",
        "laps on photographed and drawn floor tiles of Duckietown, in a world of a plug-in: departures, speed",
        pictured=False,
    ),
    "floors": Benchmark(
        "real.floors", "lanes of tape and paint on real and foreign floors, beside lanes drawn by eye"
    ),
    "hills": Benchmark(
        "perception.hills",
        "hills and banks: laps under supervision, lane 15 m ahead beside a flat road, stops behind crests",
        pictured=False,
    ),
    "junctions": Benchmark(
        "perception.junctions",
        "straight on past side roads of ten shapes: departures, lateral error",
        pictured=False,
    ),
    "people": Benchmark(
        "people.bench",
        "people, cyclists and animals that step out, stand aside, ride ahead; their detector on real pictures",
        pictured=False,
    ),
    "study-samplers": Benchmark(
        "study.functions",
        "the samplers of `trepid fear tune` on the 14 functions of the Bat literature, at equal evaluations",
        pictured=False,
        continued=True,
    ),
    "study-optimisers": Benchmark(
        "study.optimisers",
        "the optimisers of the training loop on one network, at equal epochs, four seeds each",
        continued=True,
    ),
    "study-recipes": Benchmark(
        "study.recipes",
        "the samplers of `trepid train --search` on the recipe of a network, at equal evaluations",
        pictured=False,
        continued=True,
    ),
    "study-areas": Benchmark(
        "study.areas",
        "every technique that finds the drivable lane or area on one data set, ranked over its seeds",
        pictured=False,
        continued=True,
    ),
    "study-shrinking": Benchmark(
        "study.areas",
        "right lanes of four techniques on images of 320×240 to 48×36 and in grey, by scene",
        pictured=False,
        continued=True,
    ),
    "study-conditions": Benchmark(
        "study.conditions",
        "autonomy by light, weather, road and speed: vision alone, a network alone, both under fear; what failed",
        continued=True,
    ),
    "study-rules": Benchmark(
        "study.rules",
        "the papers' printed steering rules on the same lines: ranked by their angle and alone in closed loop",
        continued=True,
    ),
    "study-weights": Benchmark(
        "study.weights",
        "the weights of a small network by populations, by gradients, by both, with its units: equal evaluations",
        continued=True,
    ),
    "study-networks": Benchmark(
        "study.networks",
        "networks that steer by their depth and their memory, on the same frames at equal epochs",
        continued=True,
    ),
    "study-corner": Benchmark(
        "study.corner",
        "networks with and without a memory alone through a corner of R = 12 m, trained on the same frames",
        pictured=False,
        continued=True,
    ),
    "study-speed": Benchmark(
        "study.loops",
        "angles of 5 mph at 5 to 25 mph, with and without transposition by understeer",
        values="largest distance from the lane centre [m]",
    ),
    "study-frame-rate": Benchmark(
        "study.loops", "a network of 0.1 s at 1 to 100 Hz, with a queue and with latest-wins"
    ),
    "study-data": Benchmark(
        "study.learned",
        "a driving network trained on 1 to 100 % of the frames, three times each",
        continued=True,
    ),
    "study-size": Benchmark(
        "study.learned", "a driving network for images of 320×240 to 40×30", continued=True
    ),
    "study-initialisation": Benchmark(
        "study.learned", "a driving network by its first weights", continued=True
    ),
    "study-heads": Benchmark(
        "study.learned",
        "a driving network that gives an angle, its error scale too, or one of 15 classes",
        continued=True,
    ),
    "study-histogram": Benchmark(
        "study.learned",
        "a driving network under changed light, with and without histogram matching",
        continued=True,
    ),
    "study-deep-steer": Benchmark(
        "study.papers",
        "Deep Steer's tables 2 to 4 beside its networks and those of Trepid, trained here on the same frames from"
        " the first weights that each row states; without a GPU on smaller frames",
        continued=True,
    ),
    "study-trunks": Benchmark(
        "study.papers",
        "VGG16, VGG19, InceptionV3 and the two recurrent forms of Deep Steer beside a small network: equal frames,"
        " pixels and epochs",
        continued=True,
    ),
    "study-train-your-own": Benchmark(
        "study.train_your_own", "a tub of 3000 frames to a judged network: time of the three commands"
    ),
}
BY_DEFAULT = ("estimators", "renderer", "lockstep", "plants", "sweep")
LONG = {"control-limits", "control-random", "fear-severity"}
"""Benchmarks of half an hour, which their group leaves out."""
GROUPS = ("control", "fear", "follow", "study")


def names_of(name: str) -> list[str]:
    """Benchmarks that ``name`` stands for: itself, or the members of a group such as ``control`` without LONG."""
    if name in GROUPS:
        return [known for known in BENCHMARKS if known.startswith(f"{name}-") and known not in LONG]
    return [name]


def drawing(name: str) -> Callable[[Mapping[str, Any], Path], None]:
    """The function that draws the figure of a benchmark with ``own_figure`` from its measured values to a path."""
    found: Callable[[Mapping[str, Any], Path], None] = importlib.import_module(
        f"lab.bench.{BENCHMARKS[name].module}"
    ).draw
    return found


def function(name: str) -> Callable[..., dict[str, Any]]:
    """The function of a benchmark: ``bench_`` and its name without the group.

    Its parameters are the options of ``trepid bench`` that it takes. It returns its tables: name -> row -> column
    -> value, or name -> value.
    """
    module = importlib.import_module(f"lab.bench.{BENCHMARKS[name].module}")
    group, _, member = name.partition("-")
    call: Callable[..., dict[str, Any]] = getattr(
        module, f"bench_{member if group in GROUPS else name}".replace("-", "_")
    )
    return call
