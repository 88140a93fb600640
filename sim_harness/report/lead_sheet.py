"""One picture of detections of the lead detector: distances from left to right, conditions from top to bottom."""

from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer

from cockpit.footage.annotate import label
from cockpit.footage.frames import FrameResult
from cockpit.footage.leads import draw_leads, leads_in
from perception.lead.finder import lead_finder, lead_settings
from sim_harness.scenarios.traffic import BODIES, Shape
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.images.files import write_image
from trepid.messages import Frame
from trepid.options import Car
from trepid.types import Image

STATION_M = 55.0
GAPS_M = (4.0, 9.0, 16.0, 28.0)
SHAPES = (Shape.CAR, Shape.VAN, Shape.CAR, Shape.TRUCK)
ROWS: tuple[tuple[DisturbanceKind, float] | None, ...] = (
    None,
    (DisturbanceKind.TREE_SHADOWS, 3.0),
    (DisturbanceKind.NIGHT, 2.0),
    (DisturbanceKind.RAIN, 3.0),
)
SHARE = (0.12, 0.72), (0.30, 0.75)  # of the columns and of the rows of a frame that a tile shows
TILE_PX = (400, 225)
MOTION = ShutterMotion(speed_mps=6.0, yaw_rate_radps=0.0)


def leads_verb(
    picture: Annotated[Path, typer.Option(help="File to draw into, .png or .jpg.")],
    road: Annotated[str, typer.Option(help="A name in config/roads/.")] = "circuit",
    seed: Annotated[int, typer.Option(min=0, help="Seed of textures and noise.")] = 0,
    car: Car = None,
) -> int:
    """Draw the detections of the lead detector on a road, near and far, in good and bad light."""
    sheet = lead_sheet(load_road(road), seed=seed)
    picture.parent.mkdir(parents=True, exist_ok=True)
    write_image(picture, sheet, quality=80)
    return 0


def lead_sheet(road: Road, *, seed: int) -> Image:
    """The picture, shape (rows, columns, 3)."""
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    rows = []
    for kind in ROWS:
        disturbances = [] if kind is None else [Disturbance(kind=kind[0], grade=kind[1])]
        renderer = Renderer(road, camera, seed=seed, disturbances=disturbances)
        places = zip(GAPS_M, SHAPES, strict=True)
        row = np.hstack([_tile(renderer, vehicle, gap_m, BODIES[shape]) for gap_m, shape in places])
        name = "clear" if kind is None else kind[0].replace("_", " ")
        label(row, name, (4, TILE_PX[1] - 6), 0.5)
        rows.append(row)
    return np.asarray(np.vstack(rows), np.uint8)


def _tile(renderer: Renderer, vehicle: Vehicle, gap_m: float, body: Body) -> Image:
    """A vehicle ``gap_m`` ahead, an oncoming car behind it, and the detections of both."""
    road, camera = renderer.road, renderer.camera
    nose_m = STATION_M + vehicle.wheelbase_m + vehicle.front_overhang_m
    rear_m = nose_m + gap_m - body.rear_m
    beside_m = nose_m + 1.5 * gap_m + 4.0
    coming = (*road.position(beside_m, road.width_at(beside_m)), road.heading_at(beside_m) + np.pi)
    image = renderer.render(
        *road.position(STATION_M, 0.0),
        road.heading_at(STATION_M),
        t_s=gap_m,
        station_m=STATION_M,
        vehicles=[((*road.position(rear_m, 0.1), road.heading_at(rear_m)), body), (coming, Body())],
        motion=MOTION,
    )
    finder = lead_finder(lead_settings(), camera, vehicle)
    leads = leads_in(finder, vehicle.scale, Frame(t_s=0.0, image=image))
    found = FrameResult(Path("sheet"), 0, 0.0, image, camera, leads, 0.0)
    canvas = draw_leads(found)
    (left, right), (top, bottom) = SHARE
    height, width = canvas.shape[:2]
    part = canvas[round(top * height) : round(bottom * height), round(left * width) : round(right * width)]
    return np.asarray(cv2.resize(part, TILE_PX, interpolation=cv2.INTER_AREA), np.uint8)
