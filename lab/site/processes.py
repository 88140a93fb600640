"""``docs/processes.svg``: the processes of a real car, and the topics that each writes and reads.

``python -m lab.site.processes`` draws it. What a process writes is what ``trepid drive`` permits it to
publish; what it reads is found in the code of its module, in the calls that subscribe.
"""

import ast
from collections.abc import Iterator, Mapping
from html import escape
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

from drive.open_road import OpenRoad
from drive.plan import plan_processes
from trepid import topics
from trepid.config import CONFIG_DIR, ROOT, using_car
from trepid.processes.page_door import FOXGLOVE, PAGE
from trepid.processes.settings import LAUNCHER, RECORDER, ProcessSpec, load_processes, published_keys
from trepid.security import LAUNCHER_TOPICS

PICTURE = ROOT / "docs" / "processes.svg"
LAUNCHER_MODULE = "drive.launcher"
CAR = CONFIG_DIR / "cars" / "shuttle"
DRIVER = ProcessSpec("driver", "vehicle.driver.node", publishes=(topics.DRIVER_INPUT.key,))
ORDER = ("camera", "cv", "cnn", "lead", "supervisor", "controller", "vehicle", DRIVER.name)
HEARS_ALL = (PAGE, RECORDER, FOXGLOVE)
"""They tap every topic of the bus, all but raw images."""
ON_REQUEST = (DRIVER.name, FOXGLOVE)
STOPS = (topics.LOSSES.key, topics.STOP_REQUEST.key)
"""Topics whose messages stop the car."""
SUBSCRIBES = {"latest", "stream"}  # methods of the bus

LABELS_PX, PITCH_PX, ROW_PX, TOP_PX, BOX_PX = 210, 96, 27, 36, 56
INK, LIFELINE, STOP_INK, PAPER = "#37474f", "#cfd8dc", "#b3261e", "#ffffff"


class Column(NamedTuple):
    """A process of the picture: its module, the keys of the topics that it writes and those that it reads."""

    name: str
    module: str
    writes: tuple[str, ...]
    reads: frozenset[str]


def columns() -> list[Column]:
    """The launcher and every process that a car can have, along the data flow."""
    specs = {spec.name: spec for spec in load_processes()}
    with using_car(CAR):
        specs |= {spec.name: spec for spec in load_processes()}
    known = {name: specs.pop(name) for name in ORDER if name in specs} | {DRIVER.name: DRIVER} | specs
    planned = plan_processes(tuple(known.values()), OpenRoad(), recorded=True, page=True, foxglove=True)
    estimates = tuple(topics.estimate_topic(name).key for spec in planned for name in spec.estimators)
    writes = {LAUNCHER: LAUNCHER_TOPICS, **published_keys(planned)}
    modules = {LAUNCHER: LAUNCHER_MODULE, **{spec.name: spec.module for spec in planned}}
    return [
        Column(name, module, writes[name], frozenset(read_keys(module, estimates)))
        for name, module in modules.items()
    ]


def read_keys(module: str, estimates: tuple[str, ...]) -> Iterator[str]:
    """Keys of the topics to which the code of ``module`` subscribes by name; ``estimates``: of the estimators."""
    spec = find_spec(module)
    assert spec is not None and spec.origin is not None, module
    for node in ast.walk(ast.parse(Path(spec.origin).read_text(encoding="utf-8"))):
        if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
            continue
        topic = node.args[0]
        if node.func.attr in SUBSCRIBES and isinstance(topic, ast.Name):
            yield getattr(topics, topic.id).key
        elif node.func.attr in SUBSCRIBES and isinstance(topic, ast.Call):
            yield from estimates


def rows(found: list[Column]) -> list[str]:
    """Keys of the topics in the picture: those that a process of a car writes, and the heartbeats."""
    written = {key for column in found for key in column.writes}
    fixed = [key for key in topics.FIXED if key in written]
    own = [key for column in found for key in column.writes if key not in topics.FIXED]
    first = fixed.index(topics.IMAGE_STATISTICS.key) + 1
    return [*fixed[:first], *own, *fixed[first:], topics.DIAGNOSTICS.key]


def picture() -> str:
    """The drawing as SVG: a column a process, a row a topic, a dot for the writer, an arrow for each reader."""
    found = columns()
    keys = rows(found)
    place = {column.name: LABELS_PX + PITCH_PX * number for number, column in enumerate(found)}
    width, height = LABELS_PX + PITCH_PX * len(found), TOP_PX + BOX_PX + ROW_PX * (len(keys) + 1)
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img" '
        'font-family="DejaVu Sans, Arial, sans-serif">',
        "<title>The processes of a car and their topics</title>",
        f'<rect width="{width}" height="{height}" fill="{PAPER}"/>',
        *_watch(place),
        *(part for column in found for part in _box(column, place[column.name], height)),
        *(part for number, key in enumerate(keys) for part in _row(key, _row_y(number), found, place)),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _row_y(number: int) -> int:
    return TOP_PX + BOX_PX + ROW_PX * (number + 1)


def _watch(place: Mapping[str, int]) -> Iterator[str]:
    """The launcher over all others."""
    xs = sorted(place.values())
    yield f'<path d="M{xs[0]} {TOP_PX} V{TOP_PX - 10} H{xs[-1]}" fill="none" stroke="{INK}"/>'
    yield from (_arrow(x, TOP_PX, "down", INK, start=TOP_PX - 10) for x in xs[1:])
    yield _text(xs[0], TOP_PX - 16, "starts, watches and stops all others", size=12, anchor="start")


def _box(column: Column, x: int, height: int) -> Iterator[str]:
    """The head of a column and its line down."""
    package, _, rest = column.module.partition(".")
    dashes = ' stroke-dasharray="4 3"' if column.name in ON_REQUEST else ""
    half = PITCH_PX // 2 - 3
    yield f'<path d="M{x} {TOP_PX + BOX_PX} V{height - 8}" stroke="{LIFELINE}" stroke-width="2"/>'
    yield (
        f'<rect x="{x - half}" y="{TOP_PX}" width="{2 * half}" height="{BOX_PX}" rx="5" fill="{PAPER}" '
        f'stroke="{INK}"{dashes}/>'
    )
    yield _text(x, TOP_PX + 19, column.name, size=14, weight="bold")
    yield _text(x, TOP_PX + 34, f"{package}.", size=11)
    yield _text(x, TOP_PX + 48, rest, size=11)


def _row(key: str, y: int, found: list[Column], place: Mapping[str, int]) -> Iterator[str]:
    """One topic: its name, a line from its writers to its readers, and those that only listen."""
    ink = STOP_INK if key in STOPS else INK
    beats = key == topics.DIAGNOSTICS.key
    writers = [column.name for column in found if key in column.writes or (beats and column.name != LAUNCHER)]
    readers = [column.name for column in found if key in column.reads and column.name not in HEARS_ALL]
    yield _text(6, y + 4, key, size=12, anchor="start", ink=ink, family="DejaVu Sans Mono, monospace")
    ends = [place[name] for name in (*writers, *readers)]
    yield f'<path d="M{min(ends)} {y} H{max(ends)}" stroke="{ink}" stroke-width="1.5"/>'
    yield from (f'<circle cx="{place[name]}" cy="{y}" r="4" fill="{ink}"/>' for name in writers)
    for name in readers:
        yield _arrow(place[name], y, "right" if place[name] > place[writers[0]] else "left", ink)
    if key != topics.CAMERA_IMAGE.key:
        yield from (
            f'<circle cx="{place[name]}" cy="{y}" r="4" fill="{PAPER}" stroke="{ink}"/>'
            for name in HEARS_ALL
            if name not in writers
        )


def _arrow(x: int, y: int, way: str, ink: str, *, start: int | None = None) -> str:
    """A head of an arrow with its tip at (x, y), behind a line down from ``start``."""
    back = {"right": "l-9 -4.5 v9", "left": "l9 -4.5 v9", "down": "l-4.5 -9 h9"}[way]
    line = "" if start is None else f'<path d="M{x} {start} V{y - 2}" stroke="{ink}"/>'
    return f'{line}<path d="M{x} {y} {back} z" fill="{ink}"/>'


def _text(
    x: int,
    y: int,
    text: str,
    *,
    size: int,
    anchor: str = "middle",
    ink: str = INK,
    weight: str = "normal",
    family: str = "",
) -> str:
    font = f' font-family="{family}"' if family else ""
    return (
        f'<text x="{x}" y="{y}" font-size="{size}" font-weight="{weight}" text-anchor="{anchor}" '
        f'fill="{ink}"{font}>{escape(text)}</text>'
    )


if __name__ == "__main__":
    PICTURE.write_text(picture(), encoding="utf-8")
