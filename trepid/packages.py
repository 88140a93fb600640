"""The packages of Trepid: what each offers, and their check.

A package offers verbs, functions and programs in its module ``offers``, which imports nothing else, so that this
one, the lowest of all, names no module of theirs. `perception`, `supervisor` and `controller` also exist on PyPI.
"""

import importlib.util
from base64 import urlsafe_b64encode
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cache
from hashlib import sha256
from importlib import import_module, metadata
from pathlib import Path
from typing import Any, NamedTuple

from trepid.config import IS_INSTALLED, ROOT, InputError

PACKAGES = (
    "trepid",
    "perception",
    "supervisor",
    "controller",
    "vehicle",
    "drive",
    "sim_harness",
    "cockpit",
    "learning",
)


class Verb(NamedTuple):
    """A command, or a group of commands, of a package."""

    module: str
    name: str = "app"
    help: str = ""  # in the list of verbs, which imports none of them; the first sentence of a command
    example: str = ""  # of a verb that another package adds; Offers.examples has those of Trepid

    def load(self) -> Any:
        """The function of the command, or the Typer application of the group."""
        return getattr(import_module(self.module), self.name)


@dataclass(frozen=True, slots=True, kw_only=True)
class Offers:
    """What a package offers; modules are named by it alone, and imported when they are used."""

    verbs: Mapping[str, Verb] = field(default_factory=dict)
    added: Mapping[str, Mapping[str, Verb]] = field(default_factory=dict)  # to the group of a lower package
    examples: Mapping[str, str] = field(default_factory=dict)  # words of a verb -> an example for its help
    functions: Mapping[str, str] = field(default_factory=dict)  # name in ``trepid`` -> module that defines it
    publishes: Mapping[str, tuple[str, ...]] = field(default_factory=dict)  # program -> keys of its topics
    simulates: bool = False  # its programs are part of a simulator and need a scenario
    elsewhere: Mapping[str, str] = field(default_factory=dict)  # verb of an add-on -> what installs it
    courses: str = ""  # module that makes the course of a scenario
    simulated_car: str = ""  # program of the simulated car


OWN = Offers(
    verbs={
        "record": Verb("trepid.recording.cli", "app", "Keep the last minutes of a drive."),
    },
    examples={
        "record keep": "trepid record keep --out near-miss.mcap",
    },
)
NOTHING = Offers()


@cache
def offers_of(package: str) -> Offers:
    """What ``package`` offers: nothing where it is none of Trepid's, or has no module ``offers``."""
    if package == "trepid":
        return OWN
    if package not in PACKAGES or importlib.util.find_spec(f"{package}.offers") is None:
        return NOTHING
    found: Offers = import_module(f"{package}.offers").OFFERS
    return found


def offers() -> Iterator[Offers]:
    """What the packages offer, from the lowest on; each is imported when it is asked for."""
    return map(offers_of, PACKAGES)


def elsewhere() -> Mapping[str, str]:
    """Verb of an add-on that is installed by itself -> the command that installs the add-on."""
    return {name: command for one in offers() for name, command in one.elsewhere.items()}


def courses() -> str:
    """The module that makes the courses of scenarios."""
    return next(one.courses for one in offers() if one.courses)


def simulated_car() -> str:
    """The program of the simulated car."""
    return next(one.simulated_car for one in offers() if one.simulated_car)


def check_packages(*, wholly: bool = False) -> None:
    """Raise InputError when a package is not that of this installation.

    ``wholly``: compare every module with the record of the installation, and not only the first of each package.
    """
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = spec.origin if spec else None
        if origin is None or Path(origin).resolve().parent != ROOT / name:
            raise InputError(
                f"package {name!r} is imported from {origin or 'nowhere'}, expected {ROOT / name}; "
                "uninstall the other package or use a fresh virtual environment"
            )
    for path, by in _foreign(wholly=wholly):
        raise InputError(
            f"{path} is not the file that was installed{f': {by} has overwritten it' if by else ''}; "
            f"uninstall {by or 'the other package'}, then `pip install --force-reinstall --no-deps trepid`, or use "
            "a fresh virtual environment"
        )


def _foreign(*, wholly: bool) -> Iterator[tuple[Path, str]]:
    """Modules of an installed wheel that differ from its record, and the distribution that claims them; "": none.

    A checkout has no record of its modules.
    """
    if not IS_INSTALLED:
        return
    record = metadata.distribution("trepid").read_text("RECORD") or ""
    for line in record.splitlines():
        name, _, rest = line.partition(",")
        package, _, module = name.partition("/")
        if package in PACKAGES and (module == "__init__.py" or (wholly and name.endswith(".py"))):
            path, digest = ROOT / name, rest.partition(",")[0].removeprefix("sha256=")
            if not path.is_file() or _digest(path) != digest:
                yield path, _claims(name)


def _digest(path: Path) -> str:
    """The hash of a file as a record of an installation writes it (PEP 376)."""
    return urlsafe_b64encode(sha256(path.read_bytes()).digest()).decode().rstrip("=")


def _claims(name: str) -> str:
    """The first other distribution whose record lists the file ``name``; "": none."""
    for one in metadata.distributions():
        if one.name != "trepid" and f"{name}," in (one.read_text("RECORD") or ""):
            return one.name
    return ""
