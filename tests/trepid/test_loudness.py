"""``--quiet`` and ``--verbose`` of every verb: what is said beside a result; the result itself does not change."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import typer

from trepid.cli import app, main
from trepid.loudness import Loudness, detail, note, speak

SHORT = ["--set", "duration_s=1", "--set", "sight=truth", "--json"]


@pytest.fixture(autouse=True)
def usual() -> Iterator[None]:
    yield
    speak(Loudness.USUAL)


@pytest.fixture
def image(tmp_path: Path) -> Path:
    path = tmp_path / "road.png"
    cv2.imwrite(str(path), np.full((240, 320, 3), 90, np.uint8))
    return path


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    def run(*words: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["trepid", *map(str, words)])
        code = main()
        shown = capsys.readouterr()
        return code, shown.out, shown.err

    return run


def leaves(command: Any) -> Iterator[Any]:
    children = getattr(command, "commands", {})
    if not children:
        yield command
    for name in children:
        yield from leaves(children[name])


def test_every_verb_has_both_options_once() -> None:
    for command in leaves(typer.main.get_command(app)):
        options = [name for parameter in command.params for name in parameter.opts]
        assert [options.count(name) for name in ("--quiet", "-q", "--verbose", "-v")] == [1] * 4, command.name


@pytest.mark.parametrize("words", [["--quiet"], ["-q"]])
@pytest.mark.parametrize("before", [True, False])
def test_quiet_leaves_out_assumptions_before_and_after_the_verb(
    image: Path, say: Any, words: list[str], before: bool
) -> None:
    code, out, err = say("estimate", image, "--json")
    assert code == 0 and "no --camera given" in err
    quiet = say(*words, "estimate", image, "--json") if before else say("estimate", image, "--json", *words)
    assert quiet[0] == 0 and quiet[2] == ""
    first, second = json.loads(out), json.loads(quiet[1])
    assert first | {"latency_ms": 0} == second | {"latency_ms": 0}


def test_quiet_leaves_out_progress_and_keeps_the_exit_code(say: Any) -> None:
    words = ["sim", "run", "straight", "--seeds", "2", *SHORT]
    usual_code, usual_out, usual_err = say(*words)
    code, out, err = say(*words, "--quiet")
    assert (code, len(out.splitlines())) == (usual_code, 2) == (code, len(usual_out.splitlines()))
    assert "[1/2] straight" in usual_err and err == ""


def test_quiet_keeps_warnings_and_errors(tmp_path: Path, image: Path, say: Any) -> None:
    (tmp_path / "broken.png").write_bytes(b"no image")
    code, _, err = say("estimate", tmp_path, "--quiet", "--json")
    assert code == 1 and "broken.png" in err and "left out" in err
    code, out, err = say("-q", "sim", "run", "moon")
    assert (code, out, err.count("\n")) == (2, "", 1)


def test_verbose_names_the_files_that_are_read_and_the_time(say: Any) -> None:
    code, out, err = say("vehicle", "steer", "--curvature", "0.01", "--speed", "8", "--json", "-v")
    assert code == 0 and json.loads(out)["road_wheel_angle_rad"] > 0
    assert "trepid: reads " in err and "vehicle.yaml" in err
    assert err.splitlines()[-1].startswith("trepid ") and err.rstrip().endswith(" s")


def test_verbose_adds_the_place_in_the_code_before_the_line_of_an_error(say: Any) -> None:
    code, _, err = say("sim", "run", "moon", "--verbose")
    assert code == 2 and "Traceback" in err
    assert err.splitlines()[-1] == say("sim", "run", "moon")[2].rstrip()


@pytest.mark.parametrize("words", [["-q", "sim", "list", "-v"], ["sim", "list", "-q", "-v"]])
def test_quiet_and_verbose_exclude_each_other(say: Any, words: list[str]) -> None:
    code, out, err = say(*words)
    assert (code, out) == (2, "")
    assert "exclude each other" in err.splitlines()[-1]


@pytest.mark.parametrize(
    ("loudness", "shown"), [(Loudness.QUIET, ""), (Loudness.USUAL, "n\n"), (Loudness.VERBOSE, "n\nd\n")]
)
def test_notes_and_details_are_said_by_the_loudness(
    loudness: Loudness, shown: str, capsys: pytest.CaptureFixture[str]
) -> None:
    speak(loudness)
    note("n")
    detail("d")
    assert capsys.readouterr() == ("", shown)


def test_the_loudness_of_one_command_does_not_last(say: Any) -> None:
    say("--quiet", "sim", "list")
    assert "reads" not in say("sim", "run", "straight", *SHORT)[2]
    assert "drawn at random" in say("sim", "run", "straight", "--seed", "random", *SHORT)[2]
