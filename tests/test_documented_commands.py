"""The commands in README.md, CONTRIBUTING.md, docs/*.md and the help: each one parses, and the quick ones run.

A command is a line of a fenced block that begins with ``trepid`` or ``make``, after an optional ``$``. It ends at a
comment, a redirection or three spaces. A line in which ``[`` or ``…`` stands for optional parts is a synopsis; it
must name an existing verb and existing options, and so must a command in running text (between backticks).
"""

import re
import shlex
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import pytest
import typer
from typer.exceptions import TyperException

from trepid.cli import app, examples, main, verbs
from trepid.config import CAR, ROOT, use_car

PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
LANGUAGES = ("", "console", "bash", "sh", "shell")
FENCE = re.compile(r"^\s*```\s*(\w*)")
COMMAND = re.compile(r"^\s*(?:\$ )?((?:trepid|make) .*)$")
INLINE = re.compile(r"(?<!`)`((?:trepid|make)\s[^`]+)`(?!`)")
SYNOPSIS = re.compile(r"[\[\]…]|\.\.\.")

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


class DocumentedCommand(NamedTuple):
    """A command and the place where it is documented."""

    place: str
    text: str
    inline: bool = False

    @property
    def words(self) -> list[str]:
        """The words of the command as a shell splits them, without comment and redirection."""
        words = shlex.split(re.split(r"\s{3,}", self.text)[0], comments=True)
        ends = [words.index(sign) for sign in ("|", ">", ">>", "<", "&&", ";", "\\") if sign in words]
        return words[: min(ends, default=len(words))]


def commands_of(page: Path, text: str) -> Iterator[DocumentedCommand]:
    """The commands of a page."""
    language: str | None = None
    for command in INLINE.finditer(
        re.sub(r"(?ms)^\s*```.*?^\s*```", lambda m: "\n" * m.group().count("\n"), text)
    ):
        number = text.count("\n", 0, text.find(command.group())) + 1
        yield DocumentedCommand(f"{page.name}:{number}", " ".join(command.group(1).split()), inline=True)
    for number, line in enumerate(text.splitlines(), start=1):
        fence = FENCE.match(line)
        if fence:
            language = fence.group(1).lower() if language is None else None
        elif language in LANGUAGES and (command := COMMAND.match(line)):
            yield DocumentedCommand(f"{page.name}:{number}", command.group(1))


COMMANDS = [command for page in PAGES for command in commands_of(page, page.read_text(encoding="utf-8"))]
COMMANDS += [DocumentedCommand(f"help of {words}", example) for words, example in examples().items()]
COMMANDS += [
    DocumentedCommand(f"help of {name}", verb.example) for name, verb in verbs().items() if verb.example
]
TREPID = [command for command in COMMANDS if command.words[0] == "trepid"]
MAKE = [command for command in COMMANDS if command.words[0] == "make"]


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


def resolve(words: list[str]) -> tuple[str, typer.core.TyperCommand, list[str]]:
    """Verb, its command and the words after it. Raises AssertionError for an unknown verb."""
    command, verb = typer.main.get_group(app), []
    while hasattr(command, "commands"):
        if not words or words[0].startswith("-"):
            break
        assert words[0] in command.commands, f"no verb {' '.join([*verb, words[0]])!r}"
        command = command.commands[words[0]]
        verb.append(words[0])
        words = words[1:]
    return " ".join(verb), command, words


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


WRITES = ("--out", "--record", "--report", "--trace", "--annotate", "--picture")
WRITTEN = {
    **{"init": 0, "keys create": 0, "dataset build": 0, "dataset join": 0, "dataset export": 1, "export": 1},
    **{"sim road export": 1, "sim road import": 1, "example copy": 1},
}
"""Verb -> the place of the file or folder that it writes among the words after the verb."""


def outputs(command: DocumentedCommand) -> set[str]:
    """The relative paths that a documented command writes."""
    words = command.words[1:]
    found = {word for option, word in pairwise(words) if option in WRITES}
    for verb, index in WRITTEN.items():
        if words[: len(verb.split())] == verb.split():
            found.update(
                [word for word in words[len(verb.split()) :] if not word.startswith("-")][index:][:1]
            )
    return {path for path in found if not path.startswith(("/", "~", "lab/results"))}


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="an installation is no clone")
def test_what_documented_commands_write_in_a_clone_is_ignored_by_git() -> None:
    typed = [command for command in TREPID if not command.inline and not SYNOPSIS.search(command.text)]
    paths = sorted({path for command in typed for path in outputs(command)})
    folders = [path if Path(path).suffix else f"{path}/" for path in paths]
    asked = subprocess.run(
        ["git", "check-ignore", "--no-index", *folders], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert sorted(set(folders) - set(asked.stdout.split())) == []
    assert {"drive.mcap", "mycar/", "runs/", "circuit.xodr"} <= set(folders)
