"""Wheel and sdist of the checkout, and an environment with one of them and the libraries of the tests."""

import os
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path
from typing import NamedTuple

from trepid.config import ROOT

OFFLINE = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet"]


def build_wheel(place: Path) -> dict[str, Path]:
    """The files ``wheel`` and ``sdist`` in ``place``."""
    run(sys.executable, "-m", "hatchling", "build", "-d", str(place), cwd=ROOT)
    (wheel,), (sdist,) = place.glob("*.whl"), place.glob("*.tar.gz")
    return {"wheel": wheel, "sdist": sdist}


class Installation(NamedTuple):
    """A virtual environment with Trepid, an empty folder to work in, and a home of its own."""

    environment: Path
    work: Path
    home: Path

    @property
    def variables(self) -> dict[str, str]:
        """The environment of a reader: nothing of the checkout, no drive of others; caches are shared."""
        kept = {
            name: value
            for name, value in os.environ.items()
            if not name.startswith(("PYTHON", "TREPID", "XDG_"))
        }
        caches = os.environ.get("XDG_CACHE_HOME", str(Path.home() / ".cache"))
        own = dict.fromkeys(("HOME", "TMPDIR", "XDG_RUNTIME_DIR"), str(self.home))
        path = f"{self.environment / 'bin'}{os.pathsep}{os.environ['PATH']}"
        return {**kept, **own, "XDG_CACHE_HOME": caches, "PATH": path}

    def trepid(self, *words: str, timeout_s: float = 120) -> subprocess.CompletedProcess[str]:
        """``trepid`` of this environment, in the empty folder."""
        return self.run("trepid", *words, timeout_s=timeout_s)

    def run(self, *words: str, timeout_s: float = 120) -> subprocess.CompletedProcess[str]:
        """A program of this environment or of the machine, in the empty folder."""
        return subprocess.run(
            words,
            cwd=self.work,
            env=self.variables,
            capture_output=True,
            text=True,
            timeout=timeout_s,
            check=False,
        )

    def files(self) -> set[str]:
        """The files of the environment without the byte code that Python caches."""
        return {
            str(path)
            for path in self.environment.rglob("*")
            if path.is_file() and "__pycache__" not in path.parts and path.suffix != ".pyc"
        }


def install_package(package: Path, place: Path) -> Installation:
    """``package`` in a new environment, whose libraries are those of this one: no download is needed.

    Of this one it has neither Trepid nor the laboratory, of which an installation from the index knows nothing.
    """
    environment, work, home = (place / name for name in ("environment", "empty", "home"))
    work.mkdir()
    home.mkdir()
    venv.create(environment, with_pip=False)
    python = environment / "bin" / "python"
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    installed = environment / "lib" / version / "site-packages"
    # Folders named in a .pth file are not searched for .pth files, such as that of an editable installation.
    (installed / "libraries.pth").write_text(
        f"{sysconfig.get_path('purelib')}\n{sysconfig.get_path('platlib')}\n"
    )
    # The first metadata of a name count: without entry points, the laboratory of this environment adds no verb.
    (installed / "trepid_lab-0.dist-info").mkdir()
    (installed / "trepid_lab-0.dist-info" / "METADATA").write_text("Name: trepid-lab\nVersion: 0\n")
    run(sys.executable, "-m", "pip", "--python", str(python), "install", *OFFLINE, str(package))
    return Installation(environment, work, home)


def run(*words: str, cwd: Path | None = None) -> None:
    """Raises CalledProcessError with the output of a failed command."""
    done = subprocess.run(words, cwd=cwd, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
