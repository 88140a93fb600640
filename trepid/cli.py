"""The command line: every verb of Trepid, mounted from the package that implements it.

Exit codes: 0 good, 1 ran and failed its criterion, 2 bad usage, configuration or input (one clear line).
With ``--json`` standard output carries JSON only; progress and logs go to standard error.
"""

import errno
import os
import re
import sys
import time
import traceback
from collections import UserDict
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from io import TextIOWrapper
from typing import Annotated, Any, NamedTuple

import typer
from rich.markup import escape
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from trepid import __version__
from trepid.config import BAD_INPUT, INTERRUPTED, InputError
from trepid.loudness import Loudness, detail, loudness, speak, warn
from trepid.packages import check_packages

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors of a disk that takes no more."""


class Verb(NamedTuple):
    """A command, or a group of commands, of another package."""

    module: str
    name: str = "app"
    help: str = ""  # in the list of verbs, which imports none of them; the first sentence of a command

    def load(self) -> Any:
        """The function of the command, or the Typer application of the group."""
        return getattr(import_module(self.module), self.name)


VERBS = {
    "drive": Verb(
        "drive.cli",
        "drive",
        "Drive with all processes (camera, perception, supervisor, controller, vehicle) over Zenoh.",
    ),
    "init": Verb(
        "cockpit.car.init",
        "init",
        "Write the folder of a new car: commented YAML files that override the defaults field by field.",
    ),
    "doctor": Verb(
        "cockpit.car.cli",
        "doctor",
        "Check the machine and the car, with a remedy for each fault; exit code 1 when a check fails.",
    ),
    "sim": Verb("sim_harness.cli", help="Run scenarios in lock-step, faster than real time."),
    "estimate": Verb(
        "sim_harness.footage.estimate_cli",
        "estimate",
        "Estimate the lane, or find the vehicle ahead, in images, folders of images, videos and recordings.",
    ),
    "camera": Verb(
        "cockpit.calibration.camera_cli", help="Calibrate a camera: its lens and how it is mounted."
    ),
    "detector": Verb("perception.lead.detector_cli", help="Detectors of vehicles on real roads."),
    "networks": Verb(
        "learning.segments.cli", help="Segmentation networks of lane lines and drivable area, for real roads."
    ),
    "calibrate": Verb("cockpit.calibration.rc_cli", help="Calibrate the pulses of an RC car, live."),
    "fear": Verb("cockpit.rulebook.cli", help="Check, show and explain fuzzy rule files."),
    "vehicle": Verb(
        "cockpit.calibration.vehicle_cli",
        help="Steering angles of the bicycle model, vehicle parameters from a log, margins of steering.",
    ),
    "ros": Verb("vehicle.ros.cli", help="The messages as a ROS 2 package."),
    "keys": Verb("vehicle.keys.cli", help="Certificates of the processes of a car."),
    "dataset": Verb("learning.dataset.cli", help="Data sets of recorded drives: build, look at, convert."),
    "train": Verb(
        "learning.training.cli",
        "train",
        "Train a network to steer from the frames of a data set; needs the extra 'train'.",
    ),
    "quantise": Verb(
        "learning.training.cli",
        "quantise",
        "Convert a driving network to 8 bits where this pays; needs the extra 'train'.",
    ),
    "correct": Verb(
        "learning.correcting.cli",
        "correct",
        "Let a network drive alone in the simulator, label where it drifts, train again; needs the extra 'train'.",
    ),
    "train-lane": Verb(
        "learning.lane.train",
        "train",
        "Train the CNN estimator on rendered roads and write its weights; needs the extra 'train'.",
    ),
    "evaluate": Verb(
        "learning.judging.cli",
        "evaluate",
        "Judge driving networks on recorded angles, beside predictions without an image, on one core.",
    ),
    "train-lead": Verb(
        "learning.lead.train",
        "train_lead",
        "Train the lead detector on rendered vehicles and write its weights; needs the extra 'train'.",
    ),
    "record": Verb("trepid.recording.cli", help="Keep the last minutes of a drive."),
    "replay": Verb(
        "cockpit.replay.cli",
        "replay",
        "Play a recording onto the bus, or run nodes on its inputs again and show what differs.",
    ),
    "export": Verb(
        "cockpit.export.cli",
        "export",
        "Export a recording as table, video, figure, tub of donkeycar, LeRobot data set, or for Foxglove.",
    ),
    "compare": Verb(
        "cockpit.compare.cli",
        "compare",
        "Compare two recordings, traces, files of stored runs, or folders of them, side by side.",
    ),
    "status": Verb(
        "cockpit.status.cli",
        "status",
        "Show the processes of a running drive: up, rate, age of the last heartbeat, CPU, restarts, message.",
    ),
    "service": Verb(
        "cockpit.status.cli",
        "service",
        "Write a systemd unit that drives a car, with readiness and watchdog notifications.",
    ),
    "bench": Verb(
        "lab.bench.cli",
        "bench",
        "Measure time and accuracy of the parts, relative to a peer in the same run.",
    ),
}
ADDED = {"fear": {"tune": Verb("sim_harness.tuning.cli", "tune")}}  # to the group of a lower package

EXAMPLES = {
    "drive": "trepid drive --scenario cut_in --duration 60 --record drive.mcap",
    "init": "trepid init mycar --like shuttle",
    "doctor": "trepid doctor --car mycar",
    "sim list": "trepid sim list --tag traffic",
    "sim run": "trepid sim run circuit s_curve --seeds 4 --jobs 2 --report runs.html",
    "sim limits": "trepid sim limits cut_in --corners 8",
    "sim resimulate": "trepid sim resimulate clip.mp4 --speed 25",
    "sim schema": "trepid sim schema",
    "sim disturbances": "trepid sim disturbances --picture kinds.png",
    "sim leads": "trepid sim leads --picture leads.png",
    "sim road show": "trepid sim road show town --picture town.png",
    "sim road export": "trepid sim road export town town.xodr",
    "sim road import": "trepid sim road import town.xodr town.yaml",
    "estimate": "trepid estimate --annotate out.png road.jpg",
    "camera import": "trepid camera import camera_info.yaml --out mycar/camera.yaml --force",
    "camera calibrate": "trepid camera calibrate boards/ --out mycar/camera.yaml --force",
    "detector list": "trepid detector list",
    "detector fetch": "trepid detector fetch objectron",
    "calibrate steering": "trepid calibrate steering --car mycar",
    "fear schema": "trepid fear schema",
    "fear export": "trepid fear export config/fear.yaml",
    "fear import": "trepid fear import rules.fcl --like config/fear.yaml",
    "fear check": "trepid fear check mycar/fear.yaml",
    "fear show": "trepid fear show config/fear.yaml --surface disagreement separation speed=8",
    "fear explain": "trepid fear explain config/fear.yaml lane_confidence=0.3 speed=8",
    "fear tune": "trepid fear tune config/fear.yaml --trials 40 --out tuned.yaml",
    "vehicle steer": "trepid vehicle steer --vehicle config/vehicle.yaml --curvature 0.05 --speed 8",
    "vehicle identify": "trepid vehicle identify drive.mcap",
    "vehicle margins": "trepid vehicle margins",
    "ros package": "trepid ros package ~/ros2_ws/src",
    "keys create": "trepid keys create mycar/keys",
    "train-lane": "trepid train-lane --out out/train",
    "train": "trepid train --data drives --model pilotnet --out net.onnx",
    "quantise": "trepid quantise net.onnx --data drives --out net-8.onnx",
    "correct": "trepid correct --data drives --model steer --scenario s_curve --rounds 3 --out net.onnx",
    "train-lead": "trepid train-lead --out out/lead",
    "dataset build": "trepid dataset build drives mycar/tub --lock-deg 25",
    "dataset show": "trepid dataset show drives --picture drives.png",
    "dataset export": "trepid dataset export drives mytub --as tub",
    "evaluate": "trepid evaluate net.onnx --data drives",
    "record keep": "trepid record keep --out near-miss.mcap",
    "replay": "trepid replay drive.mcap --through supervisor --rules config/fear.yaml",
    "export": "trepid export drive.mcap drive.csv --rate 20",
    "compare": "trepid compare before.mcap after.mcap --picture both.png",
    "status": "trepid status",
    "service": "trepid service mycar --out ~/.config/systemd/user",
    "bench": "trepid bench control --save docs/results",
}
"""The words of a verb -> an example, which its help shows."""


def _chosen(wanted: Loudness, given: bool) -> None:
    if not given:
        return
    if loudness() not in (Loudness.USUAL, wanted):
        raise typer.BadParameter("--quiet and --verbose exclude each other")
    speak(wanted)


Quiet = Annotated[
    bool,
    typer.Option(
        "--quiet",
        "-q",
        callback=lambda given: _chosen(Loudness.QUIET, given),
        is_eager=True,
        expose_value=False,
        help="Say only results, warnings and errors: no progress, no assumptions.",
    ),
]
Verbose = Annotated[
    bool,
    typer.Option(
        "--verbose",
        "-v",
        callback=lambda given: _chosen(Loudness.VERBOSE, given),
        is_eager=True,
        expose_value=False,
        help="Say also the files that are read and the time taken, and the place in the code of an error.",
    ),
]


def loudness_options() -> list[Any]:
    """The parameters ``--quiet`` and ``--verbose`` of a command."""

    def verb(quiet: Quiet = False, verbose: Verbose = False) -> None:
        pass

    app = typer.Typer(add_completion=False)
    app.command()(verb)
    return list(typer.main.get_command(app).params)


class Mounted(UserDict[str, Any]):
    """Commands of the verb ``group``, by name; a :class:`Verb` among them is imported at its first use."""

    def __init__(self, commands: Mapping[str, Any], group: str = "") -> None:
        super().__init__(commands)
        self._group = group

    def __getitem__(self, name: str) -> Any:  # a command of Typer, whose type is private
        found = self.data[name]
        return _mounted(name, self._group, found) if isinstance(found, Verb) else found


@cache
def _mounted(name: str, group: str, verb: Verb) -> Any:
    target, mount = verb.load(), typer.Typer()
    if isinstance(target, typer.Typer):
        mount.add_typer(target, name=name, help=verb.help)
    else:
        mount.command(name)(target)
    command = typer.main.get_group(mount).commands[name]
    _describe(command, f"{group} {name}".strip())
    if name in ADDED:
        command.commands = Mounted({**command.commands, **ADDED[name]}, name)  # type: ignore[attr-defined]
    return command


def _describe(command: Any, words: str) -> None:
    """Prepare the help of ``command`` and below, which is called by ``words``: an example, and plain paragraphs.

    A line break inside a paragraph of a docstring is a space. Rich takes a unit such as [m] for a style and drops
    it, so that brackets are escaped.
    """
    for described in (command, *command.params):
        if getattr(described, "help", None):
            described.help = escape(re.sub(r"(?<!\n)\n(?!\n)", " ", described.help))
    for name, child in getattr(command, "commands", {}).items():
        _describe(child, f"{words} {name}")
    if not hasattr(command, "commands"):
        command.params.extend(loudness_options())
    if words in EXAMPLES:
        command.epilog = escape(f"Example: {EXAMPLES[words]}")


class Verbs(TyperGroup):
    """The group of all verbs, each imported when it is used."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings | {"commands": Mounted(VERBS)})

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help with the texts of the table: the verbs take seconds to import."""
        listed = TyperGroup(name=self.name, help=self.help, params=self.params)
        listed.commands.update({name: TyperCommand(name, help=verb.help) for name, verb in VERBS.items()})
        listed.format_help(ctx, formatter)


app = typer.Typer(
    cls=Verbs,
    name="trepid",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


@app.callback(invoke_without_command=True)
def root(
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """A camera lane keeper for research vehicles, with a fuzzy supervisor of its estimates."""
    if version:
        typer.echo(f"trepid {__version__}")
        raise typer.Exit


def _discard_output() -> None:
    """Discard all further output, also at exit."""
    if sys.stdout is not None:  # closed
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def main() -> int:
    """Run the command line; return the exit code."""
    started_s = time.perf_counter()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, TextIOWrapper):  # names may contain characters that the terminal cannot print
            stream.reconfigure(errors="backslashreplace")
    try:
        code = _run()
    except OSError as error:
        code = _unwritten(error)
    code = _flushed(code)
    if code == 0:
        detail(f"trepid {__version__}: {time.perf_counter() - started_s:.2f} s")
    return code


def _run() -> int:
    """Run the verb of the command line; return the exit code. Raises OSError."""
    try:
        speak(Loudness.USUAL)
        check_packages()
        result = app(prog_name="trepid", standalone_mode=False)
    except (InputError, TyperException) as error:
        detail(traceback.format_exc().rstrip())
        text = error.format_message() if isinstance(error, TyperException) else str(error)
        warn("trepid:", *text.replace(": Value error, ", ": ").split())  # pydantic's words
        return BAD_INPUT
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except BrokenPipeError:  # the reader of the output has ended, e.g. `| head`
        _discard_output()
        return 0
    return result if isinstance(result, int) else 0


def _flushed(code: int) -> int:
    """Write what is left of the output; the exit code, which is ``code`` unless a good run cannot be written."""
    try:
        if sys.stdout is not None:  # closed
            sys.stdout.flush()
    except KeyboardInterrupt:
        _discard_output()
        return INTERRUPTED
    except BrokenPipeError:
        _discard_output()
    except OSError as error:
        if code == 0:
            return _unwritten(error)
        _discard_output()
    return code


def _unwritten(error: OSError) -> int:
    """Report a full disk; the exit code. Raises every other error again."""
    if error.errno not in FULL:
        raise error
    _discard_output()
    where = "" if error.filename is None else f"{error.filename}: "
    warn(f"trepid: {where}cannot write: {error.strerror}")
    return BAD_INPUT
