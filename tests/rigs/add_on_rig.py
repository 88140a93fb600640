"""The package under examples/add_on, installed from its folder beside the environment of the tests."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

from trepid.config import ROOT

FOLDER = ROOT / "examples" / "add_on"


def install_add_on(place: Path) -> Path:
    """The folder in ``place`` that the package was installed into, by pip and from a copy of its source."""
    shutil.copytree(FOLDER, place / "source")
    site = place / "site"
    options = ["--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check", "--quiet"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(site), str(place / "source")],
        check=True,
        capture_output=True,
        timeout=120,
    )
    return site


def car_with_rules(place: Path, *, parts: bool) -> Path:
    """The folder of a new car with the input of the package in its rules; ``parts``: with all of its parts."""
    car = place / "car"
    subprocess.run(
        [sys.executable, "-m", "trepid", "init", str(car)], check=True, capture_output=True, cwd=ROOT
    )
    text = (car / "fear.yaml").read_text(encoding="utf-8")
    for section in ("inputs", "rules"):
        lines = (FOLDER / f"{section}.yaml").read_text(encoding="utf-8")
        assert text.count(f"\n{section}:\n") == 1
        text = text.replace(f"\n{section}:\n", f"\n{section}:\n{lines}")
    (car / "fear.yaml").write_text(text, encoding="utf-8")
    if parts:
        shutil.copytree(FOLDER / "car", car, dirs_exist_ok=True)
    return car


def trepid(*words: str, site: Path | None) -> subprocess.CompletedProcess[str]:
    """``trepid`` with the packages in ``site`` beside its own."""
    path = os.pathsep.join(filter(None, [str(site) if site else "", os.environ.get("PYTHONPATH", "")]))
    return subprocess.run(
        [sys.executable, "-m", "trepid", *words],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": path},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
