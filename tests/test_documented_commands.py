"""The commands in README.md, CONTRIBUTING.md, docs/*.md and the help: each one parses, and the quick ones run.

A synopsis, and a command in running text, must name an existing verb and existing options.
"""

import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import typer
from command_rig import MAKE, SYNOPSIS, TREPID, TYPED, DocumentedCommand, commands_of, outputs, resolve
from short_form_rig import BESIDE_A_DRIVE, FORMS, OTHER_PROGRAMS, TRIED_ANYWAY, UNTRIED, begins, is_tried
from typer.exceptions import TyperException

from trepid.cli import main
from trepid.config import CAR, ROOT, use_car

SHORT = ["--set", "sight=truth", "--set", "duration_s=1"]
"""A second on the exact lane, without rendering."""

EXECUTED: dict[str, Callable[[list[str]], list[str] | None]] = {
    "sim list": lambda words: words,
    "sim run": lambda words: None if _many_runs(words) else [*words, *SHORT],
    "sim road export": lambda words: words,
    "sim schema": lambda words: words,
    "fear check": lambda words: words,
    "fear schema": lambda words: words,
    "fear show": lambda words: words,
    "fear explain": lambda words: words,
    "fear export": lambda words: words,
    "estimate": lambda words: words,
    "vehicle steer": lambda words: words,
    "vehicle margins": lambda words: words,
}
"""Verb -> the words that are really executed for a documented command; None: the command is only parsed.

A command is only parsed, too, when its verb is not listed, when it stands in running text, or when one of its input
files does not exist.
"""


@pytest.fixture(autouse=True)
def any_car(monkeypatch: pytest.MonkeyPatch) -> None:
    """``--car mycar`` of a page names a folder that does not exist here; tests/test_your_car.py makes one.

    A car that exists is used until the test ends.
    """
    monkeypatch.setenv(CAR, "")
    used = "trepid.options.use_car"
    monkeypatch.setattr(used, lambda folder: use_car(folder) if folder.is_dir() else None)


def place(command: DocumentedCommand) -> str:
    return command.place


def options_of(command: typer.core.TyperCommand) -> set[str]:
    return {name for parameter in command.params for name in (*parameter.opts, *parameter.secondary_opts)}


def check(documented: DocumentedCommand) -> None:
    """Raise what the command line raises for these words; no command is executed."""
    verb, command, rest = resolve(documented.words[1:])
    if documented.inline or SYNOPSIS.search(" ".join(rest)):
        named = set(re.findall(r"--[a-z][a-z-]*", " ".join(rest)))
        assert named <= options_of(command) | {"--help"}, (
            f"{verb}: no {', '.join(named - options_of(command))}"
        )
        return
    with suppress(typer.Exit):  # of --help
        command.make_context(verb, list(rest))


@pytest.mark.parametrize("command", TREPID, ids=place)
def test_a_documented_command_parses(command: DocumentedCommand) -> None:
    check(command)


@pytest.mark.parametrize("command", MAKE, ids=place)
def test_a_documented_target_exists(command: DocumentedCommand) -> None:
    done = subprocess.run(
        [shutil.which("make") or "make", "--dry-run", *command.words[1:]],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def words_to_execute(command: DocumentedCommand) -> list[str] | None:
    """The words to execute for a documented command; None where it is only parsed."""
    words = command.words[1:]
    verb, _, rest = resolve(words)
    if command.inline or verb not in EXECUTED or SYNOPSIS.search(" ".join(rest)):
        return None
    files = [word for word in rest if re.fullmatch(r"[\w./-]+\.(yaml|mcap|jpg|png|mp4|onnx)", word)]
    outputs = {
        rest[i + 1] for i, word in enumerate(rest[:-1]) if word in ("--out", "--picture", "--annotate")
    }
    if any(not (ROOT / file).is_file() for file in files if file not in outputs):
        return None
    if any(word.isupper() for word in rest if not word.startswith("-")):  # FILE stands for a file
        return None
    return EXECUTED[verb](words)


def _many_runs(words: list[str]) -> bool:
    return not set(words).isdisjoint({"all", "--cluster", "--tag", "--sample", "--seeds", "--resume"})


EXECUTABLE = [(command, words) for command in TREPID if (words := words_to_execute(command)) is not None]


@pytest.mark.parametrize(("command", "words"), EXECUTABLE, ids=[place(command) for command, _ in EXECUTABLE])
def test_a_quick_documented_command_runs(
    command: DocumentedCommand, words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "config").symlink_to(ROOT / "config")
    (tmp_path / "docs").symlink_to(ROOT / "docs")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", ["trepid", *words])
    assert main() in (0, 1), command.text  # 2 is bad usage


def test_the_pages_document_commands_of_which_some_are_executed() -> None:
    assert len(TREPID) >= 10
    assert {"make drive", "make test"} <= {" ".join(command.words[:2]) for command in MAKE}
    assert len(EXECUTABLE) >= 3


@pytest.mark.parametrize(
    "text",
    [
        "trepid fly",
        "trepid sim runs all",
        "trepid sim run all --seedz 3",
        "trepid sim run all --jobs many",
        "trepid vehicle steer --curvature 0.05",
        "trepid vehicle identify LOG [--known-ration]",
    ],
)
def test_a_wrong_command_would_be_found(text: str) -> None:
    page = f"```console\n{text}  # a comment\n```\n"
    (command,) = commands_of(Path("page.md"), page)
    with pytest.raises((AssertionError, TyperException)):
        check(command)


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="an installation is no clone")
def test_what_documented_commands_write_in_a_clone_is_ignored_by_git() -> None:
    paths = sorted({path for one in TYPED if one.words[0] == "trepid" for path in outputs(one)})
    folders = [path if Path(path).suffix else f"{path}/" for path in paths]
    asked = subprocess.run(
        ["git", "check-ignore", "--no-index", *folders], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert sorted(set(folders) - set(asked.stdout.split())) == []
    assert {"drive.mcap", "mycar/", "runs/", "circuit.xodr"} <= set(folders)


def test_every_command_is_tried_from_a_wheel_or_has_a_reason_with_tests_that_exist() -> None:
    others = [one for one in TYPED if not is_tried(one)]
    assert {one.words[0] for one in others} - {"trepid"} == OTHER_PROGRAMS.keys()
    said = [one for one in TYPED if one.words[0] == "trepid"]
    known = (*UNTRIED, *TRIED_ANYWAY, *BESIDE_A_DRIVE, *(form.beginning for form in FORMS))
    assert [beginning for beginning in known if not any(begins(one, beginning) for one in said)] == []
    reasons = " ".join([*UNTRIED.values(), *OTHER_PROGRAMS.values()])
    named = re.findall(r"tests/[\w/.]+\w", reasons)
    assert [path for path in named if not Path(ROOT / path).exists()] == []
    assert sum(map(is_tried, TYPED)) > 20 * len(UNTRIED)
