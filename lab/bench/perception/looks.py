"""Looks of unknown cameras at drawn streets and roads, each a still with the true lane in the image."""

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.drawn import BendShape, MarkingKind, random_road
from sim_harness.world.roads.road import Road
from sim_harness.world.streets import Street, StreetKind, random_street
from trepid.car.camera import Camera
from trepid.types import Array, Image

WIDTH_PX, HEIGHT_PX = 480, 360
FOCAL, FOCAL_SIGMA = 0.9, 0.12  # widths of the image; standard deviation of the logarithm
HEIGHT_M, HEIGHT_SIGMA = 1.3, 0.2
PITCH_SIGMA_RAD, YAW_SIGMA_RAD, OFFSET_SIGMA_M, HEADING_SIGMA_RAD = 0.05, 0.02, 0.25, 0.02
ASIDE_M = 0.3  # the camera is at most this far beside the middle of the car
FROM_M = (8.0, 40.0)  # station of the vehicle
ROADS = 0.35  # share of roads out of town, with every kind of marking
LAMPS = 0.2  # share of looks with lamps that a wet or polished surface reflects
LAMPS_M = (2.0, 16.0)  # distance of their reflections ahead of the rear axle
STATIONS_M = np.concatenate([np.arange(0.0, 20.0, 0.25), np.arange(20.0, 80.0, 1.0)])


@dataclass(frozen=True)
class Look:
    """An image, and the lane of the car in it."""

    number: int
    kind: str
    image: Image
    left_px: Array  # (n, 2), near to far
    right_px: Array
    one_lane: bool  # the carriageway is one lane


def looks(seed: int, count: int) -> Iterator[Look]:
    """``count`` looks, by the same seed the same. Every second one is mirrored: left-hand traffic."""
    for number in range(count):
        rng = np.random.default_rng((seed, 63, number))
        yield _look(number, rng)


def _look(number: int, rng: np.random.Generator) -> Look:
    station_m = float(rng.uniform(*FROM_M))
    if rng.random() < ROADS:
        kind: str = str(rng.choice(list(MarkingKind)))
        shape = BendShape.BEND if rng.random() < 0.25 else BendShape.STRAIGHT
        street = Street(random_road(MarkingKind(kind), shape, rng), ())
    else:
        kind = str(rng.choice(list(StreetKind)))
        street = random_street(StreetKind(kind), rng, from_m=station_m)
    camera = random_camera(rng)
    offset_m, heading_rad = (float(rng.normal(0, s)) for s in (OFFSET_SIGMA_M, HEADING_SIGMA_RAD))
    x_m, y_m = street.road.position(station_m, offset_m)
    yaw_rad = street.road.heading_at(station_m) + heading_rad
    renderer = Renderer(street.road, camera, seed=int(rng.integers(2**31)))
    image = renderer.render(x_m, y_m, yaw_rad, t_s=0.0, station_m=station_m, vehicles=street.vehicles)
    image = with_lamps(image, camera, np.random.default_rng(int(rng.integers(2**31))))
    left, right = (_edge(street.road, camera, (x_m, y_m, yaw_rad), station_m, side) for side in (1.0, -1.0))
    if number % 2:
        image = np.ascontiguousarray(image[:, ::-1])
        left, right = (side * (-1.0, 1.0) + (WIDTH_PX - 1.0, 0.0) for side in (right, left))
    return Look(number, kind, image, left, right, kind == StreetKind.ONE_WAY)


def with_lamps(image: Image, camera: Camera, rng: np.random.Generator) -> Image:
    """``image``, at times with one to five reflections of tubes on the road, white with soft edges."""
    if rng.random() > LAMPS:
        return image
    light = np.zeros(image.shape[:2], np.float32)
    for _ in range(int(rng.integers(1, 6))):
        middle = np.array([rng.uniform(*LAMPS_M), rng.uniform(-3.0, 3.0)])
        turn_rad = float(rng.choice([0.0, np.pi / 2]) + rng.normal(0, 0.15))
        along = np.array([np.cos(turn_rad), np.sin(turn_rad)]) * rng.uniform(0.4, 2.5) / 2
        across = np.array([-np.sin(turn_rad), np.cos(turn_rad)]) * rng.uniform(0.08, 0.3) / 2
        corners = [middle + along * a + across * b for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))]
        pixels = camera.pixel_from_road(np.array(corners))
        if np.isfinite(pixels).all() and np.abs(pixels).max() < 10 * WIDTH_PX:
            cv2.fillPoly(light, [np.round(pixels * 16).astype(np.int32)], (1.0,), cv2.LINE_AA, 4)
    light = cv2.GaussianBlur(light, (0, 0), float(rng.uniform(0.5, 2.5)))[..., None] * rng.uniform(0.5, 1.0)
    return np.round(image + light * (255.0 - image)).astype(np.uint8)


def random_camera(rng: np.random.Generator) -> Camera:
    """A camera behind a windscreen, of which its images are all that is known."""
    focal_px = WIDTH_PX * FOCAL * float(np.exp(rng.normal(0, FOCAL_SIGMA)))
    return Camera(
        width_px=WIDTH_PX,
        height_px=HEIGHT_PX,
        fx_px=focal_px,
        fy_px=focal_px,
        cx_px=(WIDTH_PX - 1) / 2,
        cy_px=(HEIGHT_PX - 1) / 2,
        x_m=float(rng.uniform(0.8, 2.0)),
        y_m=float(rng.uniform(-ASIDE_M, ASIDE_M)),
        height_m=HEIGHT_M * float(np.exp(rng.normal(0, HEIGHT_SIGMA))),
        pitch_down_rad=float(rng.normal(0.0, PITCH_SIGMA_RAD)),
        yaw_rad=float(rng.normal(0.0, YAW_SIGMA_RAD)),
    )


def _edge(
    road: Road, camera: Camera, pose: tuple[float, float, float], station_m: float, side: float
) -> Array:
    """Pixels of the left (side 1) or right (−1) edge of the kept lane, near to far."""
    x_m, y_m, yaw_rad = pose
    stations_m = station_m + STATIONS_M
    points = np.array([road.position(at_m, side * road.width_at(at_m) / 2) for at_m in stations_m])
    ahead = (points - (x_m, y_m)) @ np.array(
        [[np.cos(yaw_rad), -np.sin(yaw_rad)], [np.sin(yaw_rad), np.cos(yaw_rad)]]
    )
    u, v, depth = camera.pixel_from_road_matrix @ np.column_stack([ahead, np.ones(len(ahead))]).T
    shown = depth > 0.5
    return np.column_stack([u[shown] / depth[shown], v[shown] / depth[shown]])
