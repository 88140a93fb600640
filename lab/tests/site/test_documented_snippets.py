"""Every snippet of settings and of Python in README.md and docs/*.md loads as what its page says that it is.

A snippet of YAML is loaded as the file of a car, the scenario, the road or the map whose fields it begins with; one
of several files names each in a comment. Plug-ins are executed; tests/test_wheel.py runs the other Python.
"""

import json
import re
import tomllib
from collections.abc import Iterator
from pathlib import Path
from pkgutil import resolve_name
from textwrap import dedent, indent
from typing import Any, NamedTuple

import pytest
from ruamel.yaml import YAML

from lab.site.fields import CLASSES
from perception.techniques.recipe import recipes
from sim_harness.lockstep.foreign import World
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.road_file import load_road
from supervisor.situation.added import FearInput, Moment, fear_input
from trepid.config import CAR, CONFIG_DIR, ROOT, load
from vehicle.actuators.can.settings import CanMap
from vehicle.actuators.table import configured_actuator
from vehicle.cameras.table import configured_source

PAGES = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))
BLOCK = re.compile(r"^( *)```(yaml|toml|python)\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
PART = re.compile(r"^# (\w+)\.yaml.*$", re.MULTILINE)
OF_A_CAR = {
    "processes": "processes",
    "actuator": "actuator",
    "source": "camera_source",
    "corridor": "vehicle",
    "page_host": "drive",
    "network": "segments",
    "names": "ros",
}
"""First field of a snippet -> the file of the car that has it."""
OF_A_SCENARIO = {"description", "expect", "traffic", "road_users", "vary", "plant", "disturbances", "start"}
BASE: dict[str, Any] = {
    "description": "the rest of the scenario",
    "tags": ["nominal"],
    "road": "circuit",
    "start": {"speed_mps": 8},
    "plant": {"model": "single_track"},
    "traffic": [{"gap_m": 60}],
    "disturbances": [{"kind": "glare", "grade": 3}],
    "faults": [{"kind": "frozen_camera", "from_s": 9}],
    "duration_s": 30,
}
"""What a snippet of a scenario leaves out."""
NOT_LOADED = {
    "fear.md: # yaml-language-server: $schema=schema/fear.json": "leaves out sets and levels by `...`",
    "plugins.md: description: a lap of the ring": "names a world of another package: tests/test_add_on.py",
    "your-car.md: #wheelbase_m: 1.75                        # GEM e2 data sheet": "a line of `trepid init`",
}
"""Page and first line -> why the snippet is not loaded here."""


class Snippet(NamedTuple):
    """A fenced block of a page."""

    page: str
    language: str
    text: str

    @property
    def name(self) -> str:
        return f"{self.page}: {self.text.splitlines()[0]}"


def snippets() -> Iterator[Snippet]:
    for page in PAGES:
        for _, language, text in BLOCK.findall(page.read_text(encoding="utf-8")):
            yield Snippet(page.name, language, dedent(text))


SNIPPETS = list(snippets())
SETTINGS = [one for one in SNIPPETS if one.language == "yaml" and one.name not in NOT_LOADED]


@pytest.mark.parametrize("snippet", SETTINGS, ids=lambda one: one.name)
def test_a_snippet_of_settings_loads(
    snippet: Snippet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CAR, str(tmp_path))
    named = PART.split(snippet.text)[1:]
    parts = dict(zip(named[::2], named[1::2], strict=True)) if named else {"": snippet.text}
    for file, text in parts.items():
        load_snippet(file, text, tmp_path)


def load_snippet(file: str, text: str, folder: Path) -> None:
    """Raises InputError where the text is not what its first field says."""
    data = YAML(typ="safe").load(text)
    (first, value) = next(iter(data.items()))
    if isinstance(value, dict) and "module" in value:  # an entry of processes.yaml
        data, text, first = {"processes": data}, f"processes:\n{indent(text, '  ')}", "processes"
    file = file or OF_A_CAR.get(first, "")
    if file:
        (folder / f"{file}.yaml").write_text(text, encoding="utf-8")
        load_of_car(file)
    elif data.keys() & OF_A_SCENARIO:
        whole = BASE | data if "description" not in data else data
        (folder / "scenario").mkdir()
        path = folder / "scenario" / "snippet.yaml"
        path.write_text(json.dumps(whole), encoding="utf-8")  # which is YAML
        load_scenario(str(path))
    elif "segments" in data:
        (folder / "road").mkdir()
        (folder / "road" / "snippet.yaml").write_text(text, encoding="utf-8")
        load_road(folder / "road" / "snippet.yaml")
    elif "dbc" in data:
        CanMap.model_validate(data)
    else:
        (folder / "pipelines.yaml").write_text(text, encoding="utf-8")
        assert set(recipes()) >= set(data)


def load_of_car(file: str) -> None:
    """The file of the car in use, over the default."""
    if file == "actuator":
        assert configured_actuator()[0] != "sim"
    elif file == "camera_source":
        configured_source()
    else:
        load(CONFIG_DIR / f"{file}.yaml", resolve_name(CLASSES[file]))


def test_every_snippet_that_is_not_loaded_is_still_on_its_page_and_has_a_reason() -> None:
    assert NOT_LOADED.keys() <= {one.name for one in SNIPPETS}
    assert all(NOT_LOADED.values()) and len(SETTINGS) > 20


@pytest.mark.parametrize(
    "snippet", [one for one in SNIPPETS if one.language == "toml"], ids=lambda one: one.name
)
def test_a_snippet_of_a_package_names_an_object_by_an_entry_point(snippet: Snippet) -> None:
    groups = tomllib.loads(snippet.text)["project"]["entry-points"]
    assert all(":" in value for group in groups.values() for value in group.values())


def test_the_world_and_the_input_of_the_page_have_the_interface_of_a_plug_in() -> None:
    names: dict[str, Any] = {"fear_input": fear_input, "Moment": Moment}
    for snippet in SNIPPETS:
        if (snippet.page, snippet.language) == ("plugins.md", "python"):
            exec(snippet.text, names)
    asked = {name for name in vars(World) if not name.startswith("_") and callable(getattr(World, name))}
    assert asked <= vars(names["Ring"]).keys()
    assert isinstance(names["yaw_doubt"], FearInput)


def test_the_page_prints_the_world_of_the_example_and_its_glue_is_short() -> None:
    text = (ROOT / "examples" / "add_on" / "trepid_add_on" / "world.py").read_text(encoding="utf-8")
    printed = [one.text for one in SNIPPETS if (one.page, one.language) == ("plugins.md", "python")]
    assert text in printed
    assert len(text.splitlines()) <= 120
