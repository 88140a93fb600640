"""A road in one picture: camera frames along it, and the same places from above."""

import cv2
import numpy as np

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.ground.strip_grid import LEVELS_M
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Image

VIEW_M = (-9.0, 9.0)  # lateral range of the plan view
LENGTH_M = 24.0  # length of the plan view, from the station of the camera on
PLAN_LEVEL = 1
GAP_PX = 4
MOST_COLUMNS = 6
MOST_PX = 240  # width of a frame on the sheet
LABEL_PX = 17
INK, PAPER = (255, 255, 255), (40, 40, 40)


def draw_road(road: Road, camera: Camera, stations_m: list[float], *, seed: int = 0) -> Image:
    """A sheet of frames in the lane centre at ``stations_m``, each above its plan view."""
    ground = Ground(road.in_reference_world, seed=seed)
    renderer = Renderer(road, camera, seed=seed, ground=ground)
    cells = [_cell(renderer, ground, station_m, min(camera.width_px, MOST_PX)) for station_m in stations_m]
    height, width = cells[0].shape[:2]
    rows = -(-len(cells) // MOST_COLUMNS)
    columns = -(-len(cells) // rows)
    sheet = np.full((rows * (height + GAP_PX), columns * (width + GAP_PX), 3), PAPER, np.uint8)
    for number, cell in enumerate(cells):
        row, column = divmod(number, columns)
        top, left = row * (height + GAP_PX), column * (width + GAP_PX)
        sheet[top : top + height, left : left + width] = cell
    return sheet[:-GAP_PX, :-GAP_PX]


def stations_along(road: Road, count: int) -> list[float]:
    """Stations of ``count`` pictures: shortly before marks and side roads, and in every section."""
    settings = road.settings
    scale = settings.scale
    before = [mark.at_m - 9.0 * scale for mark in settings.marks] + [
        j.at_m - 13.0 * scale for j in settings.junctions
    ]
    before += [section.start_m + 10.0 * scale for section in road.sections]
    places: list[float] = []
    for place in sorted(max(place, 0.0) for place in before):
        if not places or place > places[-1] + 8.0 * scale:
            places.append(place)
    if len(places) < count:
        return [float(place) for place in np.linspace(0.02, 0.9, count) * road.length_m]
    return [places[round(i)] for i in np.linspace(0, len(places) - 1, count)]


def _cell(renderer: Renderer, ground: Ground, station_m: float, width_px: int) -> Image:
    """A frame above the plan view that begins at its station."""
    road = renderer.road
    x_m, y_m = road.position(station_m, 0.0)
    frame = renderer.render(x_m, y_m, road.heading_at(station_m), station_m=station_m, t_s=0.0)
    small = cv2.resize(frame, (width_px, round(frame.shape[0] * width_px / frame.shape[1])))
    cell = np.vstack([small, plan_view(ground, station_m / road.settings.scale, width_px)])
    label = f"{road.name} {station_m:.{1 if road.settings.scale < 1 else 0}f} m: {road.section_at(station_m).name}"
    cell[:LABEL_PX] = PAPER
    cv2.putText(cell, label, (5, LABEL_PX - 5), cv2.FONT_HERSHEY_SIMPLEX, 0.4, INK, 1, cv2.LINE_AA)
    return np.asarray(cell, np.uint8)


def plan_view(ground: Ground, station_m: float, width_px: int) -> Image:
    """The ground from above, LENGTH_M from ``station_m`` on, driving to the right."""
    road, pixel_m = ground.road, LENGTH_M / width_px
    height_px = round((VIEW_M[1] - VIEW_M[0]) / pixel_m)
    x_m, y_m = road.position(station_m, 0.0)
    heading = road.heading_at(station_m)
    along = (np.arange(width_px) + 0.5) * pixel_m
    across = VIEW_M[1] - (np.arange(height_px) + 0.5) * pixel_m
    x = x_m + along * np.cos(heading) - across[:, None] * np.sin(heading)
    y = y_m + along * np.sin(heading) + across[:, None] * np.cos(heading)
    low, high = np.array([x.min() - 1, y.min() - 1]), np.array([x.max() + 1, y.max() + 1])
    image, left_m, top_m = ground.crop(PLAN_LEVEL, low, high)
    size_m = LEVELS_M[PLAN_LEVEL]
    maps = [((x - left_m) / size_m).astype(np.float32), ((y - top_m) / size_m).astype(np.float32)]
    drawn = cv2.remap(image, maps[0], maps[1], cv2.INTER_LINEAR)
    return np.asarray(cv2.cvtColor(drawn, cv2.COLOR_BGRA2BGR), np.uint8)


def stack(sheets: list[Image]) -> Image:
    """Sheets below each other, padded to the widest."""
    width = max(sheet.shape[1] for sheet in sheets)
    padded = [
        cv2.copyMakeBorder(sheet, 0, GAP_PX, 0, width - sheet.shape[1], cv2.BORDER_CONSTANT, value=PAPER)
        for sheet in sheets
    ]
    return np.asarray(np.vstack(padded), np.uint8)
