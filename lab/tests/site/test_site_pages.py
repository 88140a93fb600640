"""The generated pages of the site: every file, field, verb and named function is on them; links lead to pages."""

import pytest

from lab.site import fields, python, verbs
from lab.site.hooks import lead_within
from trepid.config import CONFIG_DIR, ROOT, load
from vehicle.driver.settings import DriverSettings


def test_every_file_of_settings_has_its_fields_on_the_page() -> None:
    files = {path.stem for path in CONFIG_DIR.glob("*.yaml")}
    assert files == {*fields.CLASSES, *fields.FREE, *fields.BLOCKS}


@pytest.mark.parametrize("file", sorted({*fields.CLASSES, *fields.BLOCKS}))
def test_a_file_has_no_field_twice(file: str) -> None:
    names = [row.name for row in fields.rows(file)]
    assert names and len(names) == len(set(names))


def test_a_field_shows_value_type_and_meaning_of_its_file_and_class() -> None:
    rows = {row.name: row for row in fields.rows("vehicle")}
    wheelbase = rows["wheelbase_m"]
    assert wheelbase.type.startswith("float") and wheelbase.value == "`1.75`"
    assert "GEM" in wheelbase.meaning


def test_values_are_those_that_a_drive_loads() -> None:
    settings = load(CONFIG_DIR / "driver.yaml", DriverSettings)
    for row in fields.rows("driver"):
        value = settings
        for name in row.name.split("."):
            value = getattr(value, name, None)
            if value is None:
                break
        if isinstance(value, bool | int | float):
            assert row.value == f"`{value}`"


def test_every_verb_has_a_heading_and_no_path_of_this_machine_is_on_the_page() -> None:
    text = verbs.page()
    for verb in ("drive", "sim run", "fear explain", "record keep", "camera calibrate"):
        assert f"\n## trepid {verb}\n" in text
    assert str(ROOT) not in text


def test_the_python_pages_name_each_function_of_the_interface() -> None:
    named = {name for names in python.names().values() for name in names}
    assert {"sim_harness.api.run", "cockpit.api.open_recording", "supervisor.rules.verify.verify"} <= named


@pytest.mark.parametrize(
    ("text", "source", "page", "expected"),
    [
        ("[r](../lab/r.md#a)", "docs/fear.md", "fear.md", "[r](results.md#a)"),
        ("[r](../../lab/r.md)", "docs/decisions/x.md", "decisions/x.md", "[r](../results.md)"),
        ("![p](p.png)", "lab/r.md", "results.md", "![p](p.png)"),
        ("[rules](../supervisor/rules.py)", "docs/fear.md", "fear.md", "rules (`supervisor/rules.py`)"),
        ("[`a/b.py`](../a/b.py)", "docs/fear.md", "fear.md", "`a/b.py`"),
        ("[there](https://example.org)", "docs/fear.md", "fear.md", "[there](https://example.org)"),
        ("[below](#here)", "docs/fear.md", "fear.md", "[below](#here)"),
    ],
)
def test_a_link_between_files_of_the_repository_becomes_one_between_pages(
    text: str, source: str, page: str, expected: str
) -> None:
    pages = {"lab/r.md": "results.md", "docs/fear.md": "fear.md", "lab/p.png": "p.png"}
    assert lead_within(text, source, page, pages) == expected
