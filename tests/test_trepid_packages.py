"""The packages are ours and import only what the architecture allows."""

import ast
from pathlib import Path

import pytest

from trepid.config import ROOT, InputError
from trepid.packages import PACKAGES, check_packages

ALLOWED = {
    "trepid": {"trepid"},
    "perception": {"trepid", "perception"},
    "supervisor": {"trepid", "supervisor"},
    "controller": {"trepid", "controller"},
    "sim_harness": set(PACKAGES),
}


def imported_packages(path: Path) -> set[str]:
    """Our packages that a source file imports."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            names.add(node.module.split(".")[0])
    return names & set(PACKAGES)


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_imports_only_what_the_data_flow_allows(package: str) -> None:
    for path in (ROOT / package).rglob("*.py"):
        if path.name == "cli.py" and package == "trepid":
            continue  # the command line mounts what every package offers
        assert imported_packages(path) <= ALLOWED[package], path


def test_only_the_bus_knows_zenoh() -> None:
    users = {
        path.relative_to(ROOT).as_posix()
        for package in PACKAGES
        for path in (ROOT / package).rglob("*.py")
        if "import zenoh" in path.read_text()
    }
    assert users == {"trepid/bus.py"}


def test_our_packages_come_from_this_checkout() -> None:
    check_packages()


def test_a_namesake_from_elsewhere_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("trepid.packages.ROOT", tmp_path)
    with pytest.raises(InputError, match="package 'trepid' is imported from"):
        check_packages()
