"""The JSON schema of scenario files, for editors: completion, descriptions, errors.

``config/schema/scenario.json`` is the output of ``trepid sim schema``. A scenario file names it in its first line,
``# yaml-language-server: $schema=…``, which YAML plug-ins of editors read.
"""

import json

from sim_harness.scenarios.scenario import Scenario
from trepid.config import CONFIG_DIR

SCHEMA_FILE = CONFIG_DIR / "schema" / "scenario.json"


def scenario_schema() -> str:
    """The JSON schema of a scenario file (draft 2020-12), as text with a final newline."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **Scenario.model_json_schema(),
        "title": "Trepid scenario",
    }
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"


def schema_verb() -> int:
    """Print the JSON schema of scenario files, for editors."""
    print(scenario_schema(), end="")
    return 0
