"""The JSON schema of rule files, for editors: completion, descriptions, and errors while typing.

``config/schema/fear.json`` is ``trepid fear schema`` as of this version. A rule file names it in its first line,
``# yaml-language-server: $schema=…``, which the YAML plug-ins of common editors read.
"""

import json

from supervisor.rules.rule_file import RuleFile
from trepid.config import CONFIG_DIR

SCHEMA_FILE = CONFIG_DIR / "schema" / "fear.json"


def rule_schema() -> str:
    """The JSON schema of a rule file (draft 2020-12), as text with a final newline."""
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **RuleFile.model_json_schema(),
        "title": "Trepid fear rules",
    }
    return json.dumps(schema, indent=1, ensure_ascii=False) + "\n"
