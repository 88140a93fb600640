"""Roads of other tools in OpenDRIVE: which driving lanes are imported, and how far each is from its file.

The centre of a lane is evaluated here a second time and another way: the geometries are integrated numerically in
steps of 5 cm, and offset and half the widths are laid across them, section by section along the links. The road
that :mod:`sim_harness.world.opendrive` makes is laid over it by the rotation and translation of the least squares
(Kabsch, Acta Crystallographica A 32(5), 1976).
"""

import math
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from lab.bench.foreign.road_files import road_files
from sim_harness.world.opendrive.lane_table import DRIVEN
from sim_harness.world.opendrive.reader import read_opendrive
from sim_harness.world.roads.road import Road
from trepid.config import InputError
from trepid.types import Array

STEP_M = 0.05
CLOSE_M = 0.02
TIGHT_1PM = 1.0  # a lane that bends more has no road
SAMPLES = 400
SAME_M = 1e-9
COLUMNS = ("lanes", "imported", "close", "refused", "tight", "cut")


def bench_opendrive(seed: int, *, data: Path | None = None) -> dict[str, Any]:
    """Driving lanes of each file of :func:`lab.bench.foreign.road_files.road_files`, and of all of them.

    ``close``: imported, at most 2 cm from the file; ``tight``: of the refused, lanes that bend with less than a
    metre in the file; ``cut``: imported, but ended before the file does, as a lane does that closes. Raises
    InputError where no file can be had.
    """
    with road_files(seed, data) as files:
        counts = {name: count_lanes(path) for name, path in files}
    counts["all"] = sum(counts.values(), Counter())
    return {name: _row(found) for name, found in counts.items()}


def _row(found: Counter[str]) -> dict[str, Any]:
    possible = found["lanes"] - found["tight"]
    share = found["close"] / possible if possible else None
    return {name: found[name] for name in COLUMNS} | {"close_share": share}


def count_lanes(path: Path) -> Counter[str]:
    """What :func:`bench_opendrive` counts, of the lanes in the first section of every road of a file."""
    found: Counter[str] = Counter()
    for road in etree.parse(str(path)).getroot().findall("road"):
        for lane in road.find("lanes/laneSection").iterfind("*/lane"):
            number = int(lane.get("id"))
            if number and lane.get("type") in DRIVEN:
                found["lanes"] += 1
                found.update(columns_of(path, road, number))
    return found


def columns_of(path: Path, road: Any, lane: int) -> Iterator[str]:
    """The columns in which a lane counts."""
    truth = centre(road, lane)
    try:
        imported = Road(read_opendrive(path, road=road.get("id"), lane=lane).settings)
    except InputError:
        yield "refused"
        if sharpest_1pm(truth) > TIGHT_1PM:
            yield "tight"
        return
    yield "imported"
    stations = np.linspace(0.0, imported.length_m, max(SAMPLES, math.ceil(imported.length_m / STEP_M)))
    own = np.asarray(imported.positions(stations, 0.0))[:, :2]
    ends = [truth, truth[::-1]]
    if imported.length_m < length_m(truth) - 2 * STEP_M:
        yield "cut"
        ends = [_beginning(line, imported.length_m) for line in ends]
    if min(apart_m(line, way) for line in ends for way in (own, own[::-1])) <= CLOSE_M:
        yield "close"


def centre(road: Any, lane: int) -> Array:
    """Points (n, 2) of the middle of ``lane``, in the direction of the reference line, along its links."""
    s, xy, heading = reference_line(road)
    lanes = road.find("lanes")
    sections, offsets = lanes.findall("laneSection"), lanes.findall("laneOffset")
    begin = [float(section.get("s")) for section in sections]
    followed = [lane]
    for here, there in pairwise(sections):
        following = _continuation(here, there, followed[-1])
        if following is None:
            break
        followed.append(following)
    known = s < begin[len(followed)] if len(followed) < len(begin) else np.ones_like(s, dtype=bool)
    s, xy, heading = s[known], xy[known], heading[known]
    at = np.clip(np.searchsorted(begin, s + SAME_M, side="right") - 1, 0, len(followed) - 1)
    across = cubics(offsets, "s", s)
    for number, name in enumerate(followed):
        here = at == number
        sign = 1 if name > 0 else -1
        for inner in range(sign, name + sign, sign):
            widths = cubics(
                _lane(sections[number], inner).findall("width"), "sOffset", s[here] - begin[number]
            )
            across[here] += sign * widths * (0.5 if inner == name else 1.0)
    return xy + across[:, None] * np.column_stack([-np.sin(heading), np.cos(heading)])


def _continuation(here: Any, there: Any, lane: int) -> int | None:
    """The lane of ``there`` that continues ``lane``: the linked one, else that of its name; None where it ends."""
    onward = {n: m for n, m in _links(here, "successor") if n * lane > 0}
    back = {m: n for n, m in _links(there, "predecessor") if n * lane > 0}
    named = _lane(there, lane) is not None and lane not in back.values() and lane not in onward.values()
    following = onward.get(lane) or back.get(lane) or (lane if named else None)
    return following if following is not None and _lane(there, following) is not None else None


def _links(section: Any, end: str) -> Iterator[tuple[int, int]]:
    """Each lane of ``section`` with a link at its ``end``, and the lane that it names."""
    for lane in section.iterfind("*/lane"):
        link = lane.find(f"link/{end}")
        if link is not None:
            yield int(lane.get("id")), int(link.get("id"))


def _lane(section: Any, number: int) -> Any:
    return section.find(f"*/lane[@id='{number}']")


def cubics(elements: list[Any], key: str, s: Array) -> Array:
    """a + b·ds + c·ds² + d·ds³ of the last record at or before each of ``s``; 0 without one."""
    values = np.zeros_like(s)
    for element in elements:
        along = s - float(element.get(key))
        value = sum(float(element.get(name, 0)) * along**power for power, name in enumerate("abcd"))
        values = np.where(along >= -SAME_M, value, values)
    return values


def reference_line(road: Any) -> tuple[Array, Array, Array]:
    """Stations (n,), points (n, 2) and headings (n,) of the reference line."""
    parts = [_geometry(element) for element in road.find("planView") if float(element.get("length")) > SAME_M]
    s, xy, heading = (np.concatenate(each) for each in zip(*parts, strict=True))
    return s, xy, heading


def _geometry(element: Any) -> tuple[Array, Array, Array]:
    long_m, shape = float(element.get("length")), element[0]
    along = np.linspace(0.0, long_m, max(60, math.ceil(long_m / STEP_M)))
    begin = float(element.get("hdg"))
    if shape.tag == "paramPoly3":
        p = along if shape.get("pRange") == "arcLength" else along / long_m
        u, v = (_polynomial(shape, axis, p) for axis in "UV")
        local = np.column_stack([u, v])
        heading = begin + np.arctan2(np.gradient(v, p), np.gradient(u, p))
    else:
        first, last = {
            "line": (0.0, 0.0),
            "arc": (shape.get("curvature"),) * 2,
            "spiral": (shape.get("curvStart"), shape.get("curvEnd")),
        }[shape.tag]
        turned = float(first) * along + (float(last) - float(first)) * along**2 / (2 * long_m)
        middle = (turned[1:] + turned[:-1]) / 2
        step = np.diff(along)[:, None] * np.column_stack([np.cos(middle), np.sin(middle)])
        local = np.vstack([np.zeros((1, 2)), np.cumsum(step, axis=0)])
        heading = begin + turned
    turn = np.array([[math.cos(begin), math.sin(begin)], [-math.sin(begin), math.cos(begin)]])
    origin = [float(element.get("x")), float(element.get("y"))]
    return float(element.get("s")) + along, local @ turn + origin, heading


def _polynomial(shape: Any, axis: str, p: Array) -> Array:
    return np.asarray(
        sum(float(shape.get(f"{name}{axis}", 0)) * p**power for power, name in enumerate("abcd"))
    )


def _distances(line: Array) -> tuple[Array, Array]:
    """``line`` without points that repeat, and the way to each."""
    step = np.hypot(*np.diff(line, axis=0).T)
    kept = line[np.concatenate([[True], step > SAME_M])]
    return kept, np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(kept, axis=0).T))])


def length_m(line: Array) -> float:
    """Length of a polyline (n, 2)."""
    return float(_distances(line)[1][-1])


def _beginning(line: Array, long_m: float) -> Array:
    kept, way = _distances(line)
    return kept[way <= long_m]


def sharpest_1pm(line: Array) -> float:
    """Greatest curvature of a polyline (n, 2), over three steps."""
    kept, way = _distances(line)
    if len(kept) < 3:
        return 0.0
    step = np.diff(kept, axis=0)
    heading = np.unwrap(np.arctan2(step[:, 1], step[:, 0]))
    middle = (way[1:] + way[:-1]) / 2
    return float(np.abs(np.diff(heading) / np.diff(middle)).max())


def apart_m(one: Array, other: Array) -> float:
    """Greatest distance of two polylines (n, 2) by their shares of the way, when one is laid over the other."""
    a, b = _evenly(one), _evenly(other)
    from_a, from_b = a - a.mean(axis=0), b - b.mean(axis=0)
    left, _, right = np.linalg.svd(from_b.T @ from_a)
    turn = left @ np.diag([1.0, np.sign(np.linalg.det(left @ right))]) @ right
    return float(np.hypot(*(from_b @ turn - from_a).T).max())


def _evenly(line: Array) -> Array:
    kept, way = _distances(line)
    places = np.linspace(0.0, way[-1], SAMPLES)
    return np.column_stack([np.interp(places, way, kept[:, axis]) for axis in (0, 1)])
