"""Parts of other packages: what cannot be used is one line."""

import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from trepid import plugins
from trepid.config import InputError
from trepid.plugins import Group, part


@pytest.fixture
def thermal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The file of a package that adds the camera thermal."""
    monkeypatch.syspath_prepend(tmp_path)
    point = EntryPoint("thermal", "thermal_of_a_test:Thermal", Group.CAMERAS)
    monkeypatch.setattr(plugins, "entry_points", lambda group: [point])
    plugins.added_entry_points.cache_clear()
    yield tmp_path / "thermal_of_a_test.py"
    plugins.added_entry_points.cache_clear()
    sys.modules.pop("thermal_of_a_test", None)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("import no_such_library", "ModuleNotFoundError: No module named 'no_such_library'"),
        (
            "import ctypes\nctypes.CDLL('libnosuch.so.3')",
            "OSError: libnosuch.so.3: cannot open shared object file",
        ),
        ("raise RuntimeError('no GPU')", "RuntimeError: no GPU"),
        ("Camera = 1", "AttributeError: module 'thermal_of_a_test' has no attribute 'Thermal'"),
    ],
)
def test_a_package_that_cannot_be_imported_is_refused_with_its_error(
    thermal: Path, text: str, problem: str
) -> None:
    thermal.write_text(text)
    with pytest.raises(InputError) as raised:
        part(Group.CAMERAS, "thermal", {})
    begin = "trepid.cameras 'thermal' = thermal_of_a_test:Thermal: cannot be imported: "
    assert str(raised.value).startswith(begin + problem)


def test_an_unknown_name_is_refused_with_the_nearest(thermal: Path) -> None:
    with pytest.raises(InputError, match="cameras: unknown name 'thermel'; did you mean 'thermal'"):
        part(Group.CAMERAS, "thermel", {})
