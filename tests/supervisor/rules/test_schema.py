"""The schema that editors complete rule files by is current, and an independent validator reads it as we do."""

import copy
import json
from collections.abc import Callable
from typing import Any

import jsonschema
import pytest

from supervisor.rules.rule_file import SCHEMA_FILE, RuleFile, rule_schema
from trepid import config
from trepid.config import CONFIG_DIR

SCHEMA = json.loads(rule_schema())
RULE_FILES = [CONFIG_DIR / "fear.yaml", *sorted((CONFIG_DIR / "fear").glob("*.yaml"))]


def complaints(data: Any) -> list[str]:
    return [error.message for error in jsonschema.Draft202012Validator(SCHEMA).iter_errors(data)]


def test_the_schema_for_editors_is_current() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert SCHEMA_FILE.read_text(encoding="utf-8") == rule_schema(), (
        "write it again: trepid fear schema > config/schema/fear.json"
    )


@pytest.mark.parametrize("path", RULE_FILES, ids=lambda path: path.name)
def test_every_rule_file_fits_the_schema_and_names_it(path: Any) -> None:
    assert complaints(config.read(path)) == []
    first = path.read_text(encoding="utf-8").splitlines()[0].removeprefix("# yaml-language-server: $schema=")
    assert (path.parent / first).resolve() == SCHEMA_FILE


@pytest.mark.parametrize(
    "spoil",
    [
        lambda data: data.update(rulez=[]),
        lambda data: data["inputs"]["speed"].update(risk="up"),
        lambda data: data["inputs"]["speed"]["sets"].update(low=[0, 1]),
        lambda data: data["rules"].append("if speed is high than fear is low"),
        lambda data: data["rules"].append("if speed is high then fear is hihg"),
        lambda data: data["fear"]["low"].update(speed_factor=1.5),
        lambda data: data.pop("hysteresis"),
        lambda data: data.update(method="sugeno"),
    ],
)
def test_the_schema_rejects_every_file_that_the_loader_refuses(spoil: Callable[[Any], None]) -> None:
    data = copy.deepcopy(json.loads(json.dumps(config.read(CONFIG_DIR / "fear.yaml"))))
    spoil(data)
    assert complaints(data)


def test_every_field_of_the_schema_has_a_description() -> None:
    properties = SCHEMA["$defs"]["Input"]["properties"]
    assert all("description" in properties[name] for name in ("range", "risk", "missing", "beyond"))
    assert SCHEMA["properties"].keys() == RuleFile.model_fields.keys()
