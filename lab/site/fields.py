"""The page of the settings: every file of ``config/`` with every field, its type, default and meaning.

Types and defaults come from the settings classes, values and meanings from the commented files themselves; where a
file leaves a field out, the comment beside the field in its class tells the meaning.
"""

import inspect
import re
from collections.abc import Iterator, Mapping
from functools import cache
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import PydanticUndefined
from ruamel.yaml.comments import CommentedMap

from trepid.config import CONFIG_DIR, read, read_text
from vehicle.actuators import table as actuators
from vehicle.cameras import table as cameras

CLASSES: Mapping[str, str] = MappingProxyType(
    {
        "camera": "trepid.car.camera:Camera",
        "camera_source": "vehicle.cameras.working:WorkingSettings",
        "controller": "controller.controller:ControllerSettings",
        "disturbances": "sim_harness.world.roads.disturbance_table:DisturbanceTable",
        "drive": "trepid.processes.drive_settings:DriveSettings",
        "driver": "vehicle.driver.settings:DriverSettings",
        "driving_search": "learning.training.search:RecipeRanges",
        "driving_train": "learning.training.recipe:Recipe",
        "fear": "supervisor.rules.rule_file:RuleFile",
        "lead": "perception.lead.finder:LeadSettings",
        "lead_model": "sim_harness.lockstep.lead_model:LeadModelSettings",
        "limiter": "controller.limiter.limits:Limits",
        "measurement": "vehicle.measurement.settings:MeasurementSettings",
        "perception": "perception.lane.settings:LaneCvSettings",
        "processes": "trepid.processes.settings:ProcessesFile",
        "road_user_model": "sim_harness.lockstep.road_user_model:RoadUserModelSettings",
        "ros": "vehicle.ros.bridge:RosSettings",
        "security": "trepid.security:Security",
        "segments": "perception.segments.settings:SegmentSettings",
        "sight": "perception.sight.settings:SightSettings",
        "sight_truth": "sim_harness.world.sight_truth:SightSettings",
        "simulator": "sim_harness.lockstep.vehicle:SimulatorSettings",
        "steer_net": "perception.net.steer_net:SteerNetSettings",
        "supervisor": "supervisor.supervisor:SupervisorSettings",
        "tape": "perception.tape.settings:TapeSettings",
        "train": "learning.lane.fit:Recipe",
        "tune": "sim_harness.tuning.settings:TuneSettings",
        "vehicle": "trepid.car.vehicle:Vehicle",
    }
)
"""File of ``config/`` -> the class of its settings."""
FREE = MappingProxyType(
    {"pipelines": "lists of stages by the name of the pipeline: [techniques](techniques.md)"}
)
"""Files whose fields are names of the user's own, and what they hold."""
BLOCKS = MappingProxyType({"actuator": actuators, "camera_source": cameras})
"""Files with a block of settings for each kind, and the table of the kinds."""
COMMENT = re.compile(r"\s#\s(.*)$")


class Row(NamedTuple):
    """One field of a file."""

    name: str
    type: str
    value: str
    meaning: str


def classes_of(file: str) -> Iterator[tuple[str, type[BaseModel]]]:
    """Prefix and class of the fields of the file ``config/FILE.yaml``: its own, then the block of each kind."""
    if file in CLASSES:
        yield "", resolve_name(CLASSES[file])
    for kind in BLOCKS[file].OWN if file in BLOCKS else ():
        yield f"{kind}.", BLOCKS[file].kind(kind).Settings


def rows(file: str) -> list[Row]:
    """Every field of the file ``config/FILE.yaml``, with dots between the levels."""
    path = CONFIG_DIR / f"{file}.yaml"
    data, lines = read(path), read_text(path).splitlines()
    found: list[Row] = []
    for prefix, model in classes_of(file):
        part = data.get(prefix.rstrip(".")) if prefix else data
        found += _fields(model, part if isinstance(part, CommentedMap) else None, prefix, lines)
    if file == "actuator":
        found.insert(0, Row("actuator", "str", f"`{data['actuator']}`", _comment(data, "actuator", lines)))
    return found


def _fields(
    model: type[BaseModel], data: CommentedMap | None, prefix: str, lines: list[str]
) -> Iterator[Row]:
    comments = _class_comments(model)
    for name, field in model.model_fields.items():
        below = _model_within(field.annotation)
        value = data.get(name) if data is not None else None
        meaning = (_comment(data, name, lines) if data is not None and name in data else "") or comments.get(
            name, ""
        )
        if below is None:
            yield Row(prefix + name, _type(field), _value(value, field), meaning)
            continue
        inner, by_name = below
        if by_name:
            first = (
                next((one for one in value.values() if isinstance(one, CommentedMap)), None)
                if value
                else None
            )
            yield from _fields(inner, first, f"{prefix}{name}.NAME.", lines)
        else:
            yield from _fields(
                inner, value if isinstance(value, CommentedMap) else None, f"{prefix}{name}.", lines
            )


def _model_within(annotation: Any) -> tuple[type[BaseModel], bool] | None:
    """The settings class within an annotation, and True where it stands below names of the user's own."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation, False
    inner = [found for part in get_args(annotation) if (found := _model_within(part)) is not None]
    origin = getattr(annotation, "__origin__", None)
    by_name = isinstance(origin, type) and issubclass(origin, Mapping)
    return (inner[0][0], by_name or inner[0][1]) if inner and not _is_sequence(origin) else None


def _is_sequence(origin: Any) -> bool:
    return isinstance(origin, type) and issubclass(origin, tuple | list)


def _comment(data: CommentedMap, name: str, lines: list[str]) -> str:
    """The comment on the line of a field."""
    found = COMMENT.search(lines[data.lc.key(name)[0]])
    return found.group(1).strip() if found else ""


@cache
def _class_comments(model: type[BaseModel]) -> dict[str, str]:
    """Field -> the comment beside it in its class, or in the class that it comes from."""
    comments = {}
    for one in reversed(
        [base for base in model.__mro__ if issubclass(base, BaseModel) and base.model_fields]
    ):
        for line in inspect.getsource(one).splitlines():
            found = re.match(r"    (\w+): .*?#\s(.*)$", line)
            if found:
                comments[found.group(1)] = found.group(2).strip()
    return comments


def _type(field: FieldInfo) -> str:
    """The type of a field as its class writes it, without modules."""
    text = field.annotation.__name__ if isinstance(field.annotation, type) else str(field.annotation)
    limits = [str(limit) for limit in field.metadata if re.match(r"G[te]|L[te]", str(limit))]
    bounds = ", ".join(re.sub(r"\w+\((\w\w)=(.*)\)", r"\1 \2", limit) for limit in limits)
    words = {"ge": "≥", "gt": ">", "le": "≤", "lt": "<"}
    bounds = re.sub(r"\b(ge|gt|le|lt)\b", lambda match: words[match.group()], bounds)
    short = re.sub(r"Annotated\[(\w+),.*?\](?=[\],|]|$)", r"\1", re.sub(r"(\w+\.)+(?=\w)", "", text))
    return f"{short} {bounds}".strip()


def _value(value: Any, field: FieldInfo) -> str:
    """The value in the file, else the default of the class."""
    if value is None and field.default is not PydanticUndefined:
        value = field.default
    if value is None or value is PydanticUndefined:
        return "–"
    text = str(getattr(value, "value", value))
    return f"`{text}`" if len(text) <= 60 else "…"


def page() -> str:
    """The page ``files.md`` of the site."""
    parts = [
        "# The files, with every field",
        "A car is a folder; each field of its files overrides the field of the default with the same name "
        "([your car](your-car.md)). The unit is part of a name: `_m`, `_s`, `_mps`, `_rad`. `NAME` stands for a "
        "name of your own. `–`: no value unless a file gives one.",
    ]
    for path in sorted(CONFIG_DIR.glob("*.yaml")):
        file = path.stem
        parts.append(f"## {path.name}")
        parts.append(_introduction(read_text(path)))
        if file in FREE:
            parts.append(f"Fields: {FREE[file]}.")
            continue
        table = ["| field | type | value | meaning |", "| --- | --- | --- | --- |"]
        table += [
            f"| `{row.name}` | `{_cell(row.type)}` | {_cell(row.value)} | {_cell(row.meaning, prose=True)} |"
            for row in rows(file)
        ]
        parts.append("\n".join(table))
    return "\n\n".join(part for part in parts if part) + "\n"


def _introduction(text: str) -> str:
    """The comment that a file begins with."""
    lines = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        lines.append(line.lstrip("# ").strip())
    return " ".join(lines)


def _cell(text: str, *, prose: bool = False) -> str:
    """``text`` in a cell of a table; prose contains no links, so that its brackets are brackets."""
    text = text.replace("|", "\\|")
    return text.replace("[", "\\[").replace("<", "&lt;") if prose else text
