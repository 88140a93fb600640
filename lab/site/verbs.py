"""The page of the command line: every verb with its arguments and options, as ``--help`` prints them."""

from collections.abc import Iterator

import typer
from typer.core import TyperArgument, TyperCommand, TyperGroup, TyperOption

from trepid.cli import app, examples
from trepid.config import ROOT


def page() -> str:
    """The page ``verbs.md`` of the site."""
    parts = [
        "# The verbs of the command line",
        "`--help` of each prints the same. Exit codes: [compatibility](compatibility.md). `--quiet` leaves out "
        "progress and assumptions, `-v` adds what is read and the time taken.",
    ]
    for words, command in _commands(typer.main.get_group(app), ""):
        parts.append(f"## trepid {words}")
        parts.append("\n".join(line.strip() for line in (command.help or "").splitlines()))
        if words in examples():
            parts.append(f"```console\n{examples()[words]}\n```")
        rows = [
            _row(parameter)
            for parameter in command.params
            if isinstance(parameter, TyperArgument | TyperOption)
        ]
        if rows:
            parts.append("\n".join(["| argument | default | meaning |", "| --- | --- | --- |", *rows]))
    return "\n\n".join(parts) + "\n"


def _commands(group: TyperGroup, words: str) -> Iterator[tuple[str, TyperCommand]]:
    """Words and command of every verb below a group, in the order of its help; those of Trepid's own packages."""
    context = typer.Context(group)
    for name in group.list_commands(context):
        command = group.get_command(context, name)
        below = f"{words} {name}".strip()
        if isinstance(command, TyperGroup):
            yield from _commands(command, below)
        elif isinstance(command, TyperCommand):
            yield below, command


def _row(parameter: TyperArgument | TyperOption) -> str:
    names = ", ".join([*parameter.opts, *parameter.secondary_opts])
    shown = f"`{names}`" if names.startswith("-") else f"`{(parameter.metavar or names).upper()}`"
    default = parameter.default
    known = default is not None and default != [] and not callable(default)
    value = f"`{getattr(default, 'value', default)}`".replace(f"{ROOT}/", "") if known else "–"
    meaning = " ".join((getattr(parameter, "help", "") or "").split()).replace("|", "\\|")
    return f"| {shown} | {value} | {meaning} |"
