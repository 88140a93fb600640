"""Check of the packages: `perception`, `supervisor` and `controller` also exist on PyPI."""

import importlib.util
from pathlib import Path

from trepid.config import ROOT, InputError

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
    "lab",
)


def check_packages() -> None:
    """Raise InputError when a package is not imported from this checkout."""
    for name in PACKAGES:
        spec = importlib.util.find_spec(name)
        origin = spec.origin if spec else None
        if origin is None or Path(origin).resolve().parent != ROOT / name:
            raise InputError(
                f"package {name!r} is imported from {origin}, expected {ROOT / name}; "
                "uninstall the other package or use a fresh virtual environment"
            )
