"""Facts about a road as text, JSON and picture."""

import json
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from sim_harness.world.road_file import load_road
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.images.files import write_image
from trepid.options import Car

STEP_M = 0.5
QUALITY = 64  # of a JPEG


def show_verb(
    sources: Annotated[
        list[str], typer.Argument(metavar="ROAD...", help="Names in config/roads, or .yaml files.")
    ],
    picture: Annotated[Path | None, typer.Option(help="Draw the roads as .jpg or .png.")] = None,
    at: Annotated[
        list[float] | None, typer.Option(min=0, help="Draw the view from this station [m].")
    ] = None,
    count: Annotated[int, typer.Option(min=1, max=64, help="Views of each road, without --at.")] = 8,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the textures.")] = 0,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON Lines.")] = False,
) -> int:
    """Check roads, print their facts, and draw camera views and a map of each."""
    roads = [load_road(Path(source) if source.endswith(".yaml") else source) for source in sources]
    for road in roads:
        print(json.dumps(facts(road)) if as_json else one_line(road))
    if picture is not None:
        save_picture(roads, picture, at or [], count=count, seed=seed)
    return 0


def facts(road: Road) -> dict[str, object]:
    """Length, radius, lanes, sections, marks, junctions, walls and grades of a road."""
    stations = np.arange(0, road.length_m, STEP_M)
    curvature = float(np.abs(road.poses(stations)[:, 3]).max())
    widths = road.widths_at(stations)
    return {
        "name": road.name,
        "closed": road.closed,
        "length_m": round(road.length_m, 3),
        "min_radius_m": round(1 / curvature, 2) if curvature > 0 else None,
        "lane_width_m": [round(float(widths.min()), 3), round(float(widths.max()), 3)],
        "lanes_left": max(len(section.lanes_to_the_left) for section in road.sections),
        "lanes_right": max(len(section.right_lanes) for section in road.sections),
        "sections": [section.name for section in road.sections],
        "marks": [mark.kind.value for mark in road.settings.marks],
        "junctions": [junction.kind.value for junction in road.settings.junctions],
        "walls": [wall.kind.value for wall in road.settings.walls],
        "grade": _grades(road),
    }


def _grades(road: Road) -> list[float]:
    """The lowest and the highest grade, + = uphill."""
    grades = [road.grade_at(station_m) for station_m in np.arange(0, road.length_m, STEP_M).tolist()]
    return [round(min(grades), 4), round(max(grades), 4)]


def one_line(road: Road) -> str:
    """The facts of a road in one line of text."""
    found = facts(road)
    bends = "straight" if found["min_radius_m"] is None else f"radii from {found['min_radius_m']} m"
    steepest = "" if road.elevation is None else " grades from {:.1%} to {:.1%},".format(*_grades(road))
    return (
        f"{road.name}: {road.length_m:.1f} m, {'closed' if road.closed else 'open'}, {bends},{steepest}"
        f" {found['lanes_left']} lanes to the left and {found['lanes_right']} to the right of the kept lane;"
        f" {', '.join(section.name for section in road.sections)}"
    )


def save_picture(roads: list[Road], path: Path, at: list[float], *, count: int, seed: int) -> None:
    """Draw the roads below each other. Raises InputError when the file cannot be written."""
    from sim_harness.report.road_picture import draw_road, stack, stations_along

    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    sheets = [draw_road(road, camera, at or stations_along(road, count), seed=seed) for road in roads]
    write_image(path, stack(sheets), quality=QUALITY)
