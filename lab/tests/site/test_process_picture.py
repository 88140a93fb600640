"""docs/processes.svg shows the processes of a car, and the topics that each writes and reads."""

import re
from xml.etree import ElementTree

import pytest

from lab.site.processes import PICTURE, Column, columns, picture, rows
from trepid.config import ROOT
from trepid.topics import FIXED, SIM_TRUTH, STEPS, TIMING, estimate_topic

OF_THE_MAKERS = {SIM_TRUTH.key, TIMING.key, STEPS.key}
"""Topics of the simulator, of measurements and of replays."""


@pytest.fixture(scope="module")
def by_name() -> dict[str, Column]:
    return {column.name: column for column in columns()}


def test_the_picture_is_that_of_the_code() -> None:
    assert PICTURE.read_text(encoding="utf-8") == picture(), "run python -m lab.site.processes"


def test_the_picture_is_an_xml_document_without_anything_from_elsewhere() -> None:
    root = ElementTree.fromstring(picture())
    links = [name for node in root.iter() for name in node.attrib if name.endswith(("href", "src"))]
    assert root.tag.endswith("svg") and links == []


def test_every_topic_of_a_car_has_a_row(by_name: dict[str, Column]) -> None:
    estimates = {estimate_topic("cv").key, estimate_topic("cnn").key}
    assert set(rows(list(by_name.values()))) == FIXED.keys() - OF_THE_MAKERS | estimates


def test_no_topic_has_two_writers(by_name: dict[str, Column]) -> None:
    keys = [key for column in by_name.values() for key in column.writes]
    assert len(keys) == len(set(keys))


def test_the_table_of_the_architecture_names_the_module_of_every_process(by_name: dict[str, Column]) -> None:
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    lines = re.findall(r"^\| ([a-z, ]+) \| `([\w.]+)` \|", text, re.MULTILINE)
    named = {name: module for names, module in lines for name in names.split(", ")}
    assert named == {column.name: column.module for column in by_name.values()}
