"""The packages come from this checkout."""

from pathlib import Path

import pytest

from trepid.config import InputError
from trepid.packages import check_packages


def test_our_packages_come_from_this_checkout() -> None:
    check_packages()


def test_a_namesake_from_elsewhere_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr("trepid.packages.ROOT", tmp_path)
    with pytest.raises(InputError, match="package 'trepid' is imported from"):
        check_packages()
