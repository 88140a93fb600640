"""The command line: every verb is there, and bad usage is one line and exit code 2."""

import errno
import io
import json
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from trepid import __version__, plugins
from trepid.cli import app, examples, verbs
from trepid.cli import main as trepid_main
from trepid.config import CONFIG_DIR, ROOT, InputError
from trepid.packages import PACKAGES


def trepid(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "trepid", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_help_names_every_verb() -> None:
    shown = trepid("--help").stdout
    for verb in ("drive", "sim", "estimate", "fear", "vehicle", "train", "bench"):
        assert f"{verb} " in shown


def commands(name: str, command: Any) -> Iterator[tuple[str, Any]]:
    """Every command below ``command`` that runs, with its full name."""
    children = getattr(command, "commands", {})
    if not children:
        yield name, command
    for child in children:
        yield from commands(f"{name} {child}".strip(), children[child])


def words(shown: str) -> str:
    """The text of a help page without its frames and line breaks."""
    return " ".join(shown.replace("│", " ").split())


def test_the_help_of_every_verb_shows_its_texts_with_the_units_in_brackets() -> None:
    with_brackets = 0
    for name, command in commands("", typer.main.get_command(app)):
        shown = words(CliRunner().invoke(app, [*name.split(), "--help"]).stdout)
        for parameter in command.params:
            brackets = re.findall(r"\[[^\]]*\]", (getattr(parameter, "help", None) or "").replace("\\", ""))
            with_brackets += bool(brackets)
            assert all(text in shown for text in brackets), f"trepid {name} --help: {parameter.help}"
    assert with_brackets > 5
    assert "Speed [m/s]; negative: reverse." in words(trepid("vehicle", "steer", "--help").stdout)


def test_the_help_of_every_verb_ends_with_an_example_that_the_verb_accepts() -> None:
    root = typer.main.get_command(app)
    found = dict(commands("", root))
    shown_examples = {**examples(), **{name: verb.example for name, verb in verbs().items() if verb.example}}
    assert set(shown_examples) == set(found)
    for name, command in found.items():
        shown = words(CliRunner().invoke(app, [*name.split(), "--help"]).stdout)
        assert shown.endswith(f"Example: {shown_examples[name]}")
        program, *arguments = shlex.split(shown_examples[name])
        assert program == "trepid" and arguments[: len(name.split())] == name.split()
        parser = command.make_parser(typer.Context(command))
        parser.parse_args(arguments[len(name.split()) :])  # raises for an unknown option


def test_a_line_break_in_a_docstring_does_not_break_a_line_of_the_help() -> None:
    shown = CliRunner().invoke(app, ["sim", "run", "--help"], env={"COLUMNS": "400"}).stdout
    assert "of the same type. Rows of --json" in shown


@pytest.mark.parametrize(
    ("typed", "completions"), [("trepid si", {"sim"}), ("trepid sim run --see", {"--seed", "--seeds"})]
)
def test_a_shell_completes_verbs_and_options(typed: str, completions: set[str]) -> None:
    typing = {"_TREPID_COMPLETE": "complete_bash", "COMP_WORDS": typed, "COMP_CWORD": str(typed.count(" "))}
    done = subprocess.run(
        [sys.executable, "-m", "trepid"],
        cwd=ROOT,
        env=os.environ | typing,
        capture_output=True,
        text=True,
        check=False,
    )
    assert set(done.stdout.split()) == completions


def test_the_version_is_printed() -> None:
    assert trepid("--version").stdout.strip() == f"trepid {__version__}"


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["fly"], "No such command 'fly'"),
        (["drive", "--duration", "soon"], "--duration"),
        (["drive", "--duration", "nan"], "--duration"),
        (["drive", "--scenario", "moon"], "no scenario 'moon'; "),
        (["drive", "--scenario", "biased_cnn"], "estimator_bias acts in lock-step only"),
        (["drive", "--set", "cruise_speed_mps=fast"], "--set cruise_speed_mps"),
        (["sim", "run", "moon.yaml"], "moon.yaml"),
        (["estimate", "moon.jpg"], "moon.jpg"),
        (["estimate", "--estimator", "oracle", "moon.jpg"], "no estimator 'oracle'; "),
        (["fear", "check", "moon.yaml"], "moon.yaml"),
        (["bench", "pipelin"], "no benchmark 'pipelin'; did you mean 'pipeline'?"),
        (["sim", "run", "circuit", "--set", "road=circut"], "no road 'circut'; did you mean 'circuit'?"),
        (["sim", "list", "--tag", "trafic"], "no scenario has the tag 'trafic'; did you mean 'traffic'?"),
    ],
)
def test_bad_usage_is_reported_in_one_line_with_exit_code_2(
    arguments: list[str], text: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["trepid", *arguments])
    code = trepid_main()
    out, err = capfd.readouterr()
    assert_reported(code, out, err, text)


@pytest.mark.parametrize("verb", ["drive", "sim"])
def test_a_separate_process_reports_the_same(verb: str) -> None:
    done = trepid(verb, *(["run", "moon.yaml"] if verb == "sim" else ["--scenario", "moon"]))
    assert_reported(done.returncode, done.stdout, done.stderr, "moon")


def assert_reported(code: int, out: str, err: str, text: str) -> None:
    assert (code, out) == (2, "")
    (line,) = [line for line in err.splitlines() if not line.startswith("trepid drive: ")]  # progress
    assert text in line
    assert line.startswith("trepid: ")


@pytest.mark.parametrize("words", [["--version"], ["--help"], ["fear", "show", "config/fear.yaml"]])
def test_output_to_a_full_disk_ends_with_one_line_and_exit_code_2(words: list[str]) -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "trepid", *words],
            cwd=ROOT,
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == "trepid: cannot write: No space left on device\n"


@pytest.mark.parametrize(
    ("ending", "code", "said"),
    [
        (InputError("bad.yaml: no"), 2, "trepid: bad.yaml: no\n"),
        (KeyboardInterrupt(), 130, ""),
        (1, 1, ""),
        (0, 2, "trepid: cannot write: No space left on device\n"),
    ],
)
def test_an_exit_code_other_than_0_stays_where_a_full_disk_takes_no_output(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], ending: Any, code: int, said: str
) -> None:
    def run(**_: object) -> Any:
        print("half of the output")
        if isinstance(ending, BaseException):
            raise ending
        return ending

    monkeypatch.setattr("trepid.cli.app", run)
    with Path("/dev/full").open("w") as full:
        monkeypatch.setattr(sys, "stdout", full)
        assert trepid_main() == code
    assert capfd.readouterr().err == said


def test_an_interrupt_while_the_output_is_written_ends_with_130(monkeypatch: pytest.MonkeyPatch) -> None:
    class Slow(io.StringIO):
        def flush(self) -> None:
            raise KeyboardInterrupt

        def fileno(self) -> int:
            return spare.fileno()

    monkeypatch.setattr("trepid.cli.app", lambda **_: 0)
    with Path(os.devnull).open("w") as spare:
        monkeypatch.setattr(sys, "stdout", Slow())
        assert trepid_main() == 130


def test_a_full_disk_under_another_file_is_reported_with_its_name(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refuse(**_: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "drive.csv")

    monkeypatch.setattr("trepid.cli.app", refuse)
    with Path(os.devnull).open("w") as output:
        monkeypatch.setattr(sys, "stdout", output)
        assert trepid_main() == 2
    assert capfd.readouterr().err == "trepid: drive.csv: cannot write: No space left on device\n"


def test_a_closed_standard_error_leaves_standard_output_to_the_result() -> None:
    words = shlex.join([sys.executable, "-m", "trepid", "fear", "check", "missing.yaml"])
    done = subprocess.run(f"{words} 2>&-", shell=True, cwd=ROOT, stdout=subprocess.PIPE, check=False)
    assert (done.returncode, done.stdout) == (2, b"")


def test_an_error_that_a_full_disk_takes_no_line_about_has_its_exit_code() -> None:
    with Path("/dev/full").open("w") as full:
        words = [sys.executable, "-m", "trepid", "fear", "check", "missing.yaml"]
        done = subprocess.run(words, cwd=ROOT, stdout=subprocess.PIPE, stderr=full, check=False)
    assert (done.returncode, done.stdout) == (2, b"")


def test_the_bicycle_model_answers_in_json() -> None:
    vehicle = str(CONFIG_DIR / "vehicle.yaml")
    done = trepid("vehicle", "steer", "--vehicle", vehicle, "--curvature", "0.05", "--speed", "8", "--json")
    row = json.loads(done.stdout)
    assert row["road_wheel_angle_rad"] == pytest.approx(
        row["kinematic_road_wheel_angle_rad"] + row["understeer_rad"]
    )
    assert row["understeer_rad"] == pytest.approx(0.00356 * 0.05 * 64)


def test_the_list_of_verbs_imports_none_of_them_and_shows_their_own_texts() -> None:
    code = "import sys; from trepid.cli import main; main(); print(*sys.modules, sep='\\n', file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code, "--help"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    names = done.stderr.splitlines()
    named = {
        text for package in (*PACKAGES, "lab") for text in (package, f"{package}.offers")
    }  # names and texts of verbs
    imported = {name.split(".")[0] for name in names if name not in named}
    heavy = {"numpy", "scipy", "cv2", "zenoh", "skfuzzy", "matplotlib", "lab", *PACKAGES} - {"trepid"}
    assert imported.isdisjoint(heavy)
    shown = words(done.stdout)
    for name, verb in verbs().items():
        command = typer.main.get_command(app).commands[name]  # type: ignore[attr-defined]
        assert verb.help, name
        assert command.help.replace("\\", "").split("\n\n")[0].replace("\n", " ") == verb.help
        assert f"{name} {verb.help}" in shown


@pytest.fixture
def verbs_of_others(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[EntryPoint]]:
    """The verbs that other packages add; none at first."""
    points: list[EntryPoint] = []
    monkeypatch.setattr(plugins, "entry_points", lambda group: points)
    plugins.added_entry_points.cache_clear()
    yield points
    plugins.added_entry_points.cache_clear()


def test_a_verb_of_the_laboratory_says_how_to_install_it_where_it_is_missing(
    verbs_of_others: list[EntryPoint],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", ["trepid", "bench", "lockstep"])
    code = trepid_main()
    assert_reported(code, *capfd.readouterr(), "pip install -e lab")


@pytest.mark.parametrize(
    ("value", "problem"),
    [("no_such_package:VERB", "cannot be imported"), ("json:dumps", "expected a trepid")],
)
def test_a_broken_verb_of_another_package_is_named_and_stops_no_other(
    value: str,
    problem: str,
    verbs_of_others: list[EntryPoint],
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    verbs_of_others.append(EntryPoint("juggle", value, plugins.Group.VERBS))
    for arguments in (["juggle"], ["--help"], ["sim", "list", "--tag", "traffic"]):
        monkeypatch.setattr(sys, "argv", ["trepid", *arguments])
        code = trepid_main()
        out, err = capfd.readouterr()
        if arguments == ["juggle"]:
            assert_reported(code, out, err, problem)
        else:
            assert code == 0
            assert ("juggle" in out) == (arguments == ["--help"])


@pytest.mark.parametrize("verb", [["drive"], ["sim", "run"], ["fear", "explain"], ["bench"], ["estimate"]])
def test_the_help_of_a_verb_does_not_import_what_only_some_runs_need(verb: list[str]) -> None:
    code = "import sys; from trepid.cli import main; main(); print(*sys.modules, file=sys.stderr)"
    done = subprocess.run(
        [sys.executable, "-c", code, *verb, "--help"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    rare = {"matplotlib", "skfuzzy.control", "control", "torch", "casadi", "optuna", "distributed"}
    assert rare.isdisjoint(done.stderr.split()), rare & set(done.stderr.split())


def test_a_choice_that_does_not_exist_is_named_in_plain_words(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["trepid", "export", "drive.mcap", "out", "--to", "nothing"])
    assert trepid_main() == 2
    said = capsys.readouterr().err
    assert "Invalid value for '--to': 'nothing' is not one of 'csv'" in said and said.count("\n") == 1
