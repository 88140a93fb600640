"""Drawn camera images of a road with a known lane."""

import cv2
import numpy as np

from perception.lane.lane_cv import LaneCv
from perception.lane.model.geometry import lane_curve
from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, SteeringEstimate

SETTINGS = load(CONFIG_DIR / "perception.yaml", LaneCvSettings)
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
ASPHALT, GRASS, SKY, WHITE, YELLOW = (
    (105, 105, 105), (60, 120, 80), (220, 180, 150), (225, 225, 225), (60, 180, 225),
)  # fmt: skip


def ribbon(image, camera, lane, place_m, width_m, colour, drawn=lambda station_m: True):
    """Paint the strip ``width_m`` wide at ``place_m`` left of the centre of ``lane`` = (e, ψ, κ0, κ')."""
    station_m = np.concatenate([np.arange(-1.0, 20.0, 0.5), np.arange(20.0, 70.0, 2.0)])
    edges = []
    for place in (place_m + width_m / 2, place_m - width_m / 2 + 1e-9):
        curve = lane_curve(np.array([*lane, 2 * abs(place), 0.0]), station_m)
        edge = curve[0 if place > 0 else 1]
        edges.append(camera.pixel_from_road(np.column_stack([edge.real, edge.imag])))
    for number in range(len(edges[0]) - 1):
        corners = np.array([*edges[0][number : number + 2], *edges[1][number : number + 2][::-1]])
        if drawn(station_m[number]) and np.isfinite(corners).all() and np.abs(corners).max() < 5000:
            cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)


def road(
    lane,
    width_m=3.4,
    *,
    left=WHITE,
    right=WHITE,
    dashed=False,
    camera=CAMERA,
    verge_m=0.6,
    other_lane=0,
    seed=0,
):
    """An image of a road: asphalt in grass, lines of the given colours (None: no line), sensor noise.

    With ``other_lane`` the road has another lane on the left (1) or right (-1).
    """
    image = np.full((camera.height_px, camera.width_px, 3), GRASS, np.uint8)
    image[: round(camera.horizon_row_px)] = SKY
    half_m = width_m / 2 + verge_m
    for side in (1, -1):
        to_edge_m = half_m + width_m * (side == other_lane)
        ribbon(image, camera, lane, side * to_edge_m / 2, to_edge_m, ASPHALT)
    if left:
        ribbon(
            image, camera, lane, width_m / 2, 0.12, left, (lambda s: s % 9 < 3) if dashed else lambda s: True
        )
    if right:
        ribbon(image, camera, lane, -width_m / 2, 0.12, right)
    noise = np.random.default_rng(seed).normal(0, 3, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def look(image, camera=CAMERA) -> SteeringEstimate:
    return LaneCv(SETTINGS, camera, VEHICLE).step(Frame(t_s=0.0, image=image), None, now_s=0.0)
