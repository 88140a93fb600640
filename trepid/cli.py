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
from collections.abc import Iterator, Mapping
from functools import cache
from io import TextIOWrapper
from typing import Annotated, Any

import typer
from rich.markup import escape
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from trepid import __version__, plugins
from trepid.config import BAD_INPUT, INTERRUPTED, InputError
from trepid.loudness import Loudness, detail, loudness, speak, warn
from trepid.packages import Verb, check_packages, elsewhere, offers

FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Numbers of the errors of a disk that takes no more."""


FIRST = (
    "drive",
    "init",
    "doctor",
    "example",
    "sim",
    "estimate",
    "camera",
    "detector",
    "networks",
    "calibrate",
    "fear",
    "vehicle",
    "ros",
    "keys",
    "dataset",
    "train",
    "quantise",
    "correct",
    "train-lane",
    "evaluate",
    "train-lead",
    "record",
    "replay",
    "export",
    "compare",
    "status",
    "service",
)
"""The order of the verbs in the help: by what a car needs first; further ones come last."""


@cache
def own_verbs() -> Mapping[str, Verb]:
    """The verbs of Trepid, in the order of the help."""
    found = {name: verb for one in offers() for name, verb in one.verbs.items()}
    return {
        name: found[name]
        for name in sorted(found, key=lambda name: FIRST.index(name) if name in FIRST else len(FIRST))
    }


def added_verb(name: str) -> Verb:
    """The verb ``name`` of another package. Raises InputError."""
    verb = plugins.part(plugins.Group.VERBS, name, {})
    if not isinstance(verb, Verb):
        raise InputError(f"{plugins.Group.VERBS} {name!r}: expected a trepid.packages.Verb, got {verb!r}")
    return verb


@cache
def verbs() -> Mapping[str, Verb]:
    """The verbs of Trepid in the order of the help, then those of other packages. Raises InputError."""
    own = own_verbs()
    return {name: own.get(name) or added_verb(name) for name in plugins.names(plugins.Group.VERBS, own)}


@cache
def examples() -> Mapping[str, str]:
    """The words of a verb of Trepid -> an example, which its help shows."""
    return {words: text for one in offers() for words, text in one.examples.items()}


def _choose_loudness(wanted: Loudness, given: bool) -> None:
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
        callback=lambda given: _choose_loudness(Loudness.QUIET, given),
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
        callback=lambda given: _choose_loudness(Loudness.VERBOSE, given),
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


class VerbGroup(UserDict[str, Any]):
    """Commands of the verb ``group``, by name; a :class:`Verb` among them is imported at its first use."""

    def __init__(self, commands: Mapping[str, Any], group: str = "") -> None:
        super().__init__(commands)
        self._group = group

    def __getitem__(self, name: str) -> Any:  # a command of Typer, whose type is private
        found = self.data[name]
        return _mount(name, self._group, found) if isinstance(found, Verb) else found


class AllVerbs(VerbGroup):
    """The verbs by name. Other packages are looked up only for a name that is none of Trepid's, or a list of all.

    So another package costs a drive no time, and cannot stop it by an error.
    """

    def __init__(self) -> None:
        super().__init__(own_verbs())

    def __getitem__(self, name: str) -> Any:
        if name in self.data:
            return super().__getitem__(name)
        if name not in self:
            raise KeyError(name)
        return _mount(name, "", added_verb(name))

    def __contains__(self, name: object) -> bool:
        return name in self.data or name in plugins.added_entry_points(plugins.Group.VERBS)

    def __iter__(self) -> Iterator[str]:
        return iter(plugins.names(plugins.Group.VERBS, self.data))

    def __len__(self) -> int:
        return len(list(iter(self)))


@cache
def _mount(name: str, group: str, verb: Verb) -> Any:
    target, mount = verb.load(), typer.Typer()
    if isinstance(target, typer.Typer):
        mount.add_typer(target, name=name, help=verb.help)
    else:
        mount.command(name)(target)
    command = typer.main.get_group(mount).commands[name]
    words = f"{group} {name}".strip()
    _describe(command, words, {words: verb.example} if verb.example else examples())
    added = {word: one for part in offers() for word, one in part.added.get(name, {}).items()}
    if added and not group:
        command.commands = VerbGroup({**command.commands, **added}, name)  # type: ignore[attr-defined]
    return command


def _describe(command: Any, words: str, shown: Mapping[str, str]) -> None:
    """Prepare the help of ``command`` and below, which is called by ``words``: an example, and plain paragraphs.

    ``shown``: words -> the example.

    A line break inside a paragraph of a docstring is a space. Rich takes a unit such as [m] for a style and drops
    it, so that brackets are escaped.
    """
    for described in (command, *command.params):
        if getattr(described, "help", None):
            described.help = escape(re.sub(r"(?<!\n)\n(?!\n)", " ", described.help))
    for name, child in getattr(command, "commands", {}).items():
        _describe(child, f"{words} {name}", shown)
    if not hasattr(command, "commands"):
        command.params.extend(loudness_options())
    if words in shown:
        command.epilog = escape(f"Example: {shown[words]}")


class Verbs(TyperGroup):
    """The group of all verbs, each imported when it is used."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings | {"commands": AllVerbs()})

    def get_command(self, ctx: Any, cmd_name: str) -> Any:
        """The verb; None where there is none. Raises InputError for one of an add-on that is not installed."""
        found = super().get_command(ctx, cmd_name)
        if found is None and cmd_name in elsewhere():
            raise InputError(f"{cmd_name!r} is a verb of an add-on; in a clone: {elsewhere()[cmd_name]}")
        return found

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help with the texts of the table: the verbs take seconds to import."""
        listed = TyperGroup(name=self.name, help=self.help, params=self.params)
        listed.commands.update({name: TyperCommand(name, help=_help_of(name)) for name in self.commands})
        listed.format_help(ctx, formatter)


def _help_of(name: str) -> str:
    """The text of a verb in the list of all; the error of one of another package that cannot be used."""
    try:
        return (own_verbs().get(name) or added_verb(name)).help
    except InputError as error:
        return escape(str(error))


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
        code = _report_full_disk(error)
    code = _flush_output(code)
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


def _flush_output(code: int) -> int:
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
            return _report_full_disk(error)
        _discard_output()
    return code


def _report_full_disk(error: OSError) -> int:
    """Report a full disk; the exit code. Raises every other error again."""
    if error.errno not in FULL:
        raise error
    _discard_output()
    where = "" if error.filename is None else f"{error.filename}: "
    warn(f"trepid: {where}cannot write: {error.strerror}")
    return BAD_INPUT
