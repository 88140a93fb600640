"""What is typed for a documented command: the same verb with less of everything, on files that are here.

Every difference from the page stands in this file with its reason, as do the commands that are not tried.
"""

from collections.abc import Mapping
from itertools import pairwise
from typing import NamedTuple

from chessboard_rig import CORNERS
from command_rig import DocumentedCommand, outputs

UNTRIED = {
    "networks fetch twinlitenet": "a download; --file with a network that is here is tried",
    "detector fetch": "a download: tests/perception/lead",
    "calibrate steering": "a car, and hands on it: tests/cockpit/calibration/test_rc_calibration.py",
    "train-lane": "half an hour: scores on thousands of frames, of whatever training: tests/learning/lane",
    "sim run all --seeds 20 --cluster": "machines with Dask; make proof has workers",
}
"""Beginning of a documented command -> what it needs, and where it is tested instead."""
TRIED_ANYWAY = ("networks fetch twinlitenet --file",)
OTHER_PROGRAMS = {
    **dict.fromkeys(
        ("make", "git", "cd"), "a clone, which a wheel is not: tests/test_documented_commands.py"
    ),
    **dict.fromkeys(("python3", ".", "pip", "uv"), "the package index: tests/test_wheel_versions.py"),
    "podman": "an engine of containers: tests/test_release.py",
    "sudo": "a Raspberry Pi",
    **dict.fromkeys(("ros2", "RMW_IMPLEMENTATION=rmw_zenoh_cpp"), "ROS 2: tests/vehicle/ros"),
    "dask": "machines with Dask; make proof has workers",
}
"""Program of a page beside `trepid` and `cp` -> what it needs, and where that is tested instead."""
OF_A_CLONE = "bench"
"""The verb of the laboratory, which is no part of the wheel and says so with exit code 2."""

LEAST = {
    **{"--cases": "2", "--seeds": "1", "--trials": "1", "--workers": "1", "--jobs": "1"},
    **{"--skip": "1", "--at": "1", "--road": "1", "--rounds": "1", "--corners": "1"},
}
"""Option -> the value that it has here: one run takes the way of a hundred, and the files of a reader are short."""
TRUTH = "--set sight=truth --set duration_s"
BOARD = f"{CORNERS[0]}x{CORNERS[1]}"
BROUGHT = {"9x6": BOARD, "FILE": "config/fear.yaml", "FOLDER": "IMG", "best.pth": "best.onnx"}
"""Word of a page -> what a reader has in its place."""


class Form(NamedTuple):
    """How the commands with a beginning differ from the page, and why.

    ``more`` are further options, the last value of an option counts; ``instead`` are files that a reader has, not
    those that the command writes; ``may_fail`` says that exit code 1 is a result as well.
    """

    beginning: str
    reason: str
    more: str = ""
    instead: Mapping[str, str] = {}
    may_fail: bool = False


FORMS = (
    Form("camera calibrate boards/", "the chessboard that is drawn", more=f"--corners {BOARD}"),
    Form("camera calibrate boards/ --corners 9x6 --fisheye", "another lens", instead={"boards/": "fisheye/"}),
    Form(
        "camera calibrate --",
        "the camera of the film, on a straight road",
        instead={
            **{"clip.mp4": "film.mp4", "drive.mcap": "straight.mcap"},
            **{"mine.yaml": "config/camera.yaml", "mycar/camera.yaml": "config/camera.yaml"},
        },
    ),
    Form("camera calibrate --drive", "a drive with bends", instead={"drive.mcap": "bends.mcap"}),
    Form("camera calibrate --camera mine.yaml --drive", "likewise", instead={"drive.mcap": "bends.mcap"}),
    Form("vehicle identify", "a drive with bends", instead={"drive.mcap": "bends.npz"}),
    Form("replay drive.mcap --through supervisor", "rules", instead={"mine.yaml": "config/fear.yaml"}),
    Form("fear explain glare.mcap", "nothing slows a car down within five seconds", may_fail=True),
    Form("doctor", "neither the camera nor the board of the car is here", may_fail=True),
    Form("sim run", "five seconds, in which a car starts and drives", more="--set duration_s=5"),
    Form("sim run circuit --estimator", "a network of one pass over the frames drives badly", may_fail=True),
    Form("sim run s_curve --set speed_mps=2.235", "likewise", may_fail=True),
    Form("sim run carpet", "the page says that this car does not start", may_fail=True),
    Form("sim run cut_in --sample", "a drawn car may change lanes into the side of the other", may_fail=True),
    Form("sim run tight_white", "a small car starts later", more="--set duration_s=10"),
    Form("estimate --estimator steer.onnx", "a tub of a reader", instead={"mytub/images": "tub/images"}),
    Form("sim run all", "one of all", instead={"all": "straight"}),
    Form("sim limits", "two seconds without a camera", more=f"--tolerance 0.5 {TRUTH}=2"),
    Form(
        "sim resimulate",
        "seconds of film of no real road, from one place beside the lane",
        more="--frames 70 --offset 0.5",
        may_fail=True,
    ),
    Form(
        "fear tune",
        "two seconds of one scenario without a camera, in which one trial finds no better rules",
        more=f"--trials 1 --scenarios straight --unseen straight --cases 1 {TRUTH}=2",
        may_fail=True,
    ),
    Form("train --data", "one pass over the frames", more="--set stages.0.epochs=1"),
    Form("train --data tub-data --model steer --out steer.onnx --search", "one trial", more="--trials 1"),
    Form(
        "train --data tub-data --model inception-v3",
        "few frames, as they are large, and one pass of both stages",
        more="--set stages.1.epochs=1",
        instead={"tub-data": "few"},
    ),
    Form("train-lead", "one pass over ten roads", more="--roads 10 --epochs 1 --weights weights"),
    Form(
        "correct",
        "one round of one pass over the frames, and fast drives on a short road",
        more="--rounds 1 --set stages.0.epochs=1 --speed 15",
        instead={"s_curve": "straight"},
    ),
    Form("dataset build", "drives of a reader", instead={"mytub": "tub", "mycar/tub": "tub"}),
    Form("dataset build lap", "five seconds are no data set", instead={"lap.mcap": "straight.mcap"}),
    Form(
        "drive",
        "eight seconds; a machine that does other work may be too slow, which the drive says at its end",
        more="--duration 8 --no-dashboard",
        may_fail=True,
    ),
    Form("drive --car mycar", "the camera and the bus of the car are not here", more="--scenario straight"),
    Form("drive --car myrc", "likewise", more="--scenario circuit"),
)
BESIDE_A_DRIVE = ("status", "record keep", "replay drive.mcap --rate")
"""Beginnings of commands for a running drive."""


def begins(command: DocumentedCommand, *beginnings: str) -> bool:
    return " ".join(command.words[1:]).startswith(beginnings)


def is_tried(command: DocumentedCommand) -> bool:
    """Whether it runs by itself; the others have their reason in UNTRIED or OTHER_PROGRAMS, or need a drive."""
    if command.words[0] != "trepid":
        return command.words[0] == "cp"
    return begins(command, *TRIED_ANYWAY) or not begins(command, *UNTRIED, *BESIDE_A_DRIVE)


def forms_of(command: DocumentedCommand) -> list[Form]:
    return [form for form in FORMS if command.words[0] == "trepid" and begins(command, form.beginning)]


def short_form(command: DocumentedCommand) -> list[str]:
    """The words that are typed, those of FORMS from the general to the particular."""
    forms, written = forms_of(command), outputs(command)
    brought = dict(BROUGHT)
    for form in forms:
        brought |= form.instead
    words = [
        word if option == "--out" or word in written else brought.get(word, LEAST.get(option, word))
        for option, word in pairwise(["", *command.words])
    ]
    return [*words, *(word for form in forms for word in form.more.split())]


def good_codes(command: DocumentedCommand) -> tuple[int, ...]:
    if begins(command, OF_A_CLONE):
        return (2,)
    return (0, 1) if any(form.may_fail for form in forms_of(command)) else (0,)
