"""``trepid example`` lists and copies what the documentation calls an example, and overwrites nothing unasked."""

from pathlib import Path

import pytest

from cockpit.examples import copy_example, description, examples
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import EXAMPLES_DIR, InputError


def test_every_file_below_the_examples_belongs_to_one() -> None:
    files = {path for path in EXAMPLES_DIR.rglob("*") if path.is_file() and "__pycache__" not in path.parts}
    tops = examples().values()
    assert [path for path in files if not any(path == top or top in path.parents for top in tops)] == []


@pytest.mark.parametrize("name", sorted(examples()))
def test_a_copy_has_the_bytes_of_the_example_and_says_what_it_is(name: str, tmp_path: Path) -> None:
    source = examples()[name]
    written = copy_example(name, tmp_path / "copy")
    top = source if source.is_dir() else source.parent
    assert written
    for path in written:
        assert path.read_bytes() == (top / path.relative_to(tmp_path / "copy")).read_bytes()
    assert len(description(source)) > 20


def test_a_copied_scenario_is_one_that_runs(tmp_path: Path) -> None:
    (path,) = copy_example("night_bend", tmp_path)
    assert load_scenario(str(path)).description.startswith("a right bend")


def test_a_file_that_exists_is_kept_unless_forced_and_then_nothing_is_written(tmp_path: Path) -> None:
    (tmp_path / "processes.yaml").write_text("mine\n")
    with pytest.raises(InputError, match=r"processes\.yaml: exists and is kept"):
        copy_example("bench", tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["processes.yaml"]
    copy_example("bench", tmp_path, force=True)
    assert (tmp_path / "processes.yaml").read_text() != "mine\n"


def test_an_unknown_name_lists_the_known_ones(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no example 'night'; .*night_bend"):
        copy_example("night", tmp_path)
