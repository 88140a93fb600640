"""The documented commands: those of README.md, CONTRIBUTING.md, docs/*.md and the help.

A command is a line of a ``console`` block, or one of another block that begins with a program of PROGRAMS, after an
optional ``$``. ``&&`` joins two. It ends at a comment, a redirection or three spaces. A line in which ``[`` or
``…`` stands for optional parts is a synopsis. A command in running text stands between backticks.
"""

import re
import shlex
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import typer

from trepid.cli import app, examples, verbs
from trepid.config import ROOT

PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
LANGUAGES = ("", "console", "bash", "sh", "shell")
FENCE = re.compile(r"^\s*```\s*(\w*)")
PROGRAMS = ("trepid", "make", "cp", "pip", "sudo", "python3", "dask")
LINE = re.compile(r"^\s*(?:\$ )?(\S.*?)\s*\\?$")
INLINE = re.compile(r"(?<!`)`((?:trepid|make)\s[^`]+)`(?!`)")
SYNOPSIS = re.compile(r"[\[\]…]|\.\.\.")


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
        elif language in LANGUAGES and (found := LINE.match(line)):
            commands = found.group(1).split(" && ")
            if language or commands[0].split()[0] in PROGRAMS:
                yield from (DocumentedCommand(f"{page.name}:{number}", one) for one in commands)


COMMANDS = [command for page in PAGES for command in commands_of(page, page.read_text(encoding="utf-8"))]
COMMANDS += [DocumentedCommand(f"help of {words}", example) for words, example in examples().items()]
COMMANDS += [
    DocumentedCommand(f"help of {name}", verb.example) for name, verb in verbs().items() if verb.example
]
TYPED = [one for one in COMMANDS if not one.inline and not SYNOPSIS.search(one.text.partition("#")[0])]
TREPID = [command for command in COMMANDS if command.words[0] == "trepid"]
MAKE = [command for command in COMMANDS if command.words[0] == "make"]


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
