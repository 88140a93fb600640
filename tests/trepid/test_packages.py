"""The packages come from this checkout, or are those that were installed."""

import subprocess
import sys
from base64 import urlsafe_b64encode
from hashlib import sha256
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace

import pytest

from trepid import packages
from trepid.config import InputError
from trepid.packages import check_packages


def test_our_packages_come_from_this_checkout() -> None:
    check_packages()


def test_a_namesake_from_elsewhere_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("trepid.packages.ROOT", tmp_path)
    with pytest.raises(InputError, match="package 'trepid' is imported from"):
        check_packages()


@pytest.fixture
def wheel(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """An installed wheel of two modules, beside another distribution that claims one of them."""
    lines = []
    for name in ("supervisor/__init__.py", "supervisor/node.py"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(f"# {name}\n", encoding="utf-8")
        digest = urlsafe_b64encode(sha256(path.read_bytes()).digest()).decode().rstrip("=")
        lines.append(f"{name},sha256={digest},{path.stat().st_size}")
    lines.append("trepid-0.1.0.dist-info/RECORD,,")
    records = {"trepid": "\n".join(lines), "supervisord": "supervisor/__init__.py,sha256=x,9\n"}
    found = [
        SimpleNamespace(name=name, read_text=lambda _, text=text: text) for name, text in records.items()
    ]
    monkeypatch.setattr(packages, "IS_INSTALLED", True)
    monkeypatch.setattr(packages, "PACKAGES", ("supervisor",))
    monkeypatch.setattr(packages, "ROOT", tmp_path)
    spec = SimpleNamespace(origin=str(tmp_path / "supervisor" / "__init__.py"))
    monkeypatch.setattr(packages.importlib.util, "find_spec", lambda _: spec)
    monkeypatch.setattr(metadata, "distribution", lambda _: found[0])
    monkeypatch.setattr(metadata, "distributions", lambda: found)
    return tmp_path


def test_an_untouched_wheel_is_in_order(wheel: Path) -> None:
    check_packages(wholly=True)


def test_a_distribution_that_overwrites_a_package_is_named(wheel: Path) -> None:
    (wheel / "supervisor" / "__init__.py").write_text("# of another program\n", encoding="utf-8")
    with pytest.raises(
        InputError, match=r"supervisor/__init__\.py .* supervisord has overwritten it; uninstall"
    ):
        check_packages()


def test_a_module_that_was_removed_is_found_when_all_are_compared(wheel: Path) -> None:
    (wheel / "supervisor" / "node.py").unlink()
    check_packages()
    with pytest.raises(
        InputError, match=r"supervisor/node\.py is not the file that was installed; uninstall"
    ):
        check_packages(wholly=True)


def test_a_folder_with_the_name_of_a_package_does_not_hide_it(tmp_path: Path) -> None:
    (tmp_path / "controller").mkdir()
    (tmp_path / "controller" / "__init__.py").write_text("raise SystemExit('hidden')", encoding="utf-8")
    command = [sys.executable, "-m", "trepid", "vehicle", "margins", "--help"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
