"""The wheel in an empty environment of each Python, with the libraries of the index. Run by `make pythons`.

An environment is made by `venv`, filled by pip from the index, and drives with all processes. A Python is found as
`python3.N` on the path, or below ~/.pyenv/versions; one that is not on the machine is skipped by name. Another
platform is resolved by pip without being installed.
"""

import json
import re
import shutil
import subprocess
import time
import tomllib
from pathlib import Path

import pytest
from wheel_rig import Installation, build_wheel

from trepid.config import ROOT

pytestmark = pytest.mark.proof

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MINORS = [int(found) for found in re.findall(r"Python :: 3\.(\d+)", " ".join(PROJECT["classifiers"]))]
SOURCES = ("sdnotify",)  # plain Python, which the index offers as source alone
TAGS = ("manylinux_2_28", "manylinux_2_27", "manylinux2014")
PATIENCE_S = 900.0


def interpreter(minor: int) -> Path | None:
    """Python 3.``minor`` of this machine."""
    named = shutil.which(f"python3.{minor}")
    found = [Path(named)] if named else []
    found += sorted((Path.home() / ".pyenv" / "versions").glob(f"3.{minor}.*/bin/python3.{minor}"))
    return next((path for path in found if _answers(path, minor)), None)


def _answers(path: Path, minor: int) -> bool:
    """Whether the program is that version: a shim of pyenv may stand for none."""
    done = subprocess.run([path, "--version"], capture_output=True, text=True, check=False)
    return done.returncode == 0 and done.stdout.startswith(f"Python 3.{minor}.")


def call(*words: str | Path) -> float:
    """The seconds that a command took. Raises AssertionError with its output where it fails."""
    started_s = time.monotonic()
    done = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return time.monotonic() - started_s


def pip_of(minor: int, environment: Path) -> list[str | Path]:
    """A command of pip in a new environment of Python 3.``minor``; skips the test without that Python."""
    python = interpreter(minor)
    if python is None:
        pytest.skip(f"no Python 3.{minor} on this machine")
    call(python, "-m", "venv", environment)
    return [environment / "bin" / "python", "-m", "pip", "--disable-pip-version-check", "--quiet"]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build_wheel(tmp_path_factory.mktemp("dist"))["wheel"]


@pytest.mark.parametrize("minor", MINORS)
def test_the_wheel_drives_in_an_empty_environment(minor: int, wheel: Path, tmp_path: Path) -> None:
    found = Installation(tmp_path / "environment", tmp_path / "empty", tmp_path / "home")
    found.work.mkdir()
    found.home.mkdir()
    pip = pip_of(minor, found.environment)
    install_s = call(*pip, "install", wheel)
    lock_step = found.trepid("sim", "run", "straight", "--set", "duration_s=5", "--json", timeout_s=300)
    assert json.loads(lock_step.stdout)["departures"] == 0, lock_step.stderr
    done = found.trepid("drive", "--duration", "10", "--no-dashboard", "--json", timeout_s=300)
    assert done.stdout, done.stderr
    row = json.loads(done.stdout)
    print(
        f"Python 3.{minor}: installed in {install_s:.0f} s, {row['distance_m']:.0f} m driven, {row['status']}"
    )
    assert row["departures"] == 0 and row["distance_m"] > 1.0, row["reasons"]


@pytest.mark.parametrize("minor", MINORS)
def test_the_index_offers_a_wheel_of_every_library_for_aarch64(
    minor: int, wheel: Path, tmp_path: Path
) -> None:
    # By the pip of that Python: the conditions of requirements are those of the Python that runs pip.
    pip = [*pip_of(minor, tmp_path / "environment"), "install", "--dry-run"]
    options = ["--target", tmp_path / "none", "--only-binary", ":all:", "--python-version", f"3.{minor}"]
    platforms = [word for tag in TAGS for word in ("--platform", f"{tag}_aarch64")]
    libraries = [one for one in PROJECT["dependencies"] if not one.startswith(SOURCES)]
    report = tmp_path / "report.json"
    seconds = call(*pip, *options, *platforms, "--ignore-installed", "--report", report, *libraries)
    names = [one["metadata"]["name"] for one in json.loads(report.read_text(encoding="utf-8"))["install"]]
    print(f"aarch64, Python 3.{minor}: {len(names)} wheels, resolved in {seconds:.0f} s")
    assert len(names) > len(libraries)
