"""One picture of all disturbances: a row for each kind, a column for each grade. ``trepid sim disturbances``."""

import json
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.disturbance_table import load_table
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind, disturb
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.files import write_image
from trepid.options import Car
from trepid.types import Image

GRADES = range(6)
STATION_M = 55.0
STATIONS_M = {
    DisturbanceKind.BRIDGE_SHADOWS: 71.0,
    DisturbanceKind.OCCLUSION: 47.0,
}  # stations with a visible effect
GAP_M = 16.0  # to the vehicle ahead
MOUTH_M = 20.0  # to the end of the tunnel
SUN_LEFT_RAD = 0.15
MOTION = ShutterMotion(speed_mps=8.0, yaw_rate_radps=0.5)
TILE_PX = (220, 165)
LABEL_PX = 118


def disturbances_verb(
    picture: Annotated[
        Path | None, typer.Option(help="Draw every kind at every grade, .png or .jpg.")
    ] = None,
    road: Annotated[str, typer.Option(help="A name in config/roads/.")] = "circuit",
    seed: Annotated[int, typer.Option(min=0, help="Seed of textures and noise.")] = 0,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> int:
    """Show the grades of each disturbance in numbers and in a picture."""
    table = load_table().model_dump()
    if picture is not None:
        if not picture.parent.is_dir():
            raise InputError(f"{picture}: there is no folder {picture.parent}")
        write_image(picture, sheet(load_road(road), seed=seed), quality=82)
    if as_json:
        print(json.dumps(table))
        return 0
    rows = Table(box=None)
    for heading in ("disturbance", "quantity", *map(str, GRADES)):
        rows.add_column(heading)
    for kind, quantities in table.items():
        for quantity, values in quantities.items():
            rows.add_row(kind, quantity, *(f"{value:g}" for value in values))
    Console().print(rows)
    return 0


def sheet(road: Road, *, seed: int) -> Image:
    """The contact sheet, BGR."""
    heading = road.heading_at(STATION_M)
    lit = Road(road.settings.model_copy(update={"sun_azimuth_rad": heading + SUN_LEFT_RAD}))
    ground = Ground(lit, seed=seed)
    rows = [_row(lit, ground, kind, seed) for kind in DisturbanceKind]
    head = np.hstack([_label("grade")[:24], *(_label(str(grade), TILE_PX[0])[:24] for grade in GRADES)])
    return np.vstack([head, *rows])


def _row(road: Road, ground: Ground, kind: DisturbanceKind, seed: int) -> Image:
    return np.hstack(
        [_label(kind.replace("_", " ")), *(_tile(road, ground, kind, grade, seed) for grade in GRADES)]
    )


def _tile(road: Road, ground: Ground, kind: DisturbanceKind, grade: int, seed: int) -> Image:
    station_m = STATIONS_M.get(kind, STATION_M)
    to_m = station_m + MOUTH_M if kind == DisturbanceKind.TUNNEL_EXIT else None
    disturbance = Disturbance(kind=kind, grade=grade, to_m=to_m)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    painted = disturb(road.settings, (disturbance,)) != road.settings
    renderer = Renderer(
        road, camera, seed=seed, ground=None if painted else ground, disturbances=(disturbance,)
    )
    x_m, y_m = road.position(station_m, 0.0)
    ahead_m = station_m + camera.x_m + GAP_M - Body().rear_m
    lead = (*road.position(ahead_m, 0.0), road.heading_at(ahead_m))
    image = renderer.render(
        x_m, y_m, road.heading_at(station_m), t_s=3.0, station_m=station_m, lead=lead, motion=MOTION
    )
    small = cv2.resize(image, TILE_PX, interpolation=cv2.INTER_AREA)
    framed = cv2.copyMakeBorder(small, 0, 2, 0, 2, cv2.BORDER_CONSTANT, value=(255,) * 3)
    return np.asarray(framed, np.uint8)


def _label(text: str, width_px: int = LABEL_PX) -> Image:
    width_px += 0 if width_px == LABEL_PX else 2
    image = np.full((TILE_PX[1] + 2, width_px, 3), 255, np.uint8)
    cv2.putText(image, text, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (40, 40, 40), 1, cv2.LINE_AA)
    return image
