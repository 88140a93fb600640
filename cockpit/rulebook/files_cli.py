"""``trepid fear schema``, ``export`` and ``import``: rule files in other forms."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedSeq

from supervisor.rules.fcl.export import fcl
from supervisor.rules.fcl.read import parse_fcl
from supervisor.rules.inference import FearRules
from supervisor.rules.rule_file import RuleFile
from supervisor.rules.schema import rule_schema
from trepid.config import CONFIG_DIR, load, read_text


def schema() -> None:
    """Print the JSON schema of rule files, for editors."""
    print(rule_schema(), end="")


def export(file: Annotated[Path, typer.Argument(metavar="F.yaml", help="Rule file.")]) -> None:
    """Print the rules as IEC 61131-7 Fuzzy Control Language (FCL)."""
    print(fcl(FearRules.load(file)), end="")


def import_(
    file: Annotated[Path, typer.Argument(metavar="F.fcl", help="Fuzzy Control Language.")],
    like: Annotated[
        Path,
        typer.Option(
            metavar="F.yaml", help="Rule file with the actions and hysteresis that FCL does not state."
        ),
    ] = CONFIG_DIR / "fear.yaml",
) -> None:
    """Print a rule file with the rules of an FCL function block."""
    rules = parse_fcl(read_text(file), source=file, like=load(like, RuleFile))
    yaml = YAML()
    yaml.width = 10_000  # a rule stays on its line
    yaml.indent(mapping=2, sequence=4, offset=2)
    empty = {name for name in ("causes", "without") if not getattr(rules, name)}
    yaml.dump(_plain(rules.model_dump(mode="json", exclude=empty)), sys.stdout)


def _plain(data: Any) -> Any:
    """Lists of numbers on one line."""
    if isinstance(data, dict):
        return {key: _plain(value) for key, value in data.items()}
    if isinstance(data, list) and data and not isinstance(data[0], str):
        row = CommentedSeq(data)
        row.fa.set_flow_style()
        return row
    return data
