"""Labelled strips for the lead detector: vehicles of all sizes and colours on random roads, in all weathers.

One seed is one road with its own curves, looks, light and weather. The labels are the true places of the vehicles,
never measured in the image. Among the vehicles stand things that are none: boxes of other sizes.
"""

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from learning.drawn_frames import random_disturbances, random_road
from perception.lead.view import LeadView, Strips
from sim_harness.scenarios.traffic import BODIES
from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.vehicles import Body, outline
from sim_harness.world.render.scene.view import Motion
from sim_harness.world.roads.appearance import Light
from sim_harness.world.roads.disturbances import DisturbanceKind
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Image

MAX_VEHICLES = 6
LABEL = ("ahead_m", "left_m", "width_m", "visible")
NEAREST_M, FARTHEST_M = 2.2, 60.0
PITCH_DOUBT_RAD = 0.004  # uncertainty of the calibration and of body pitch: 0.23 deg
DISTURBED_SHARE, EMPTY_SHARE, CLUTTER_SHARE = 0.45, 0.2, 0.3
CAMERAS_PER_ROAD = 3
MOST_GRADE = 3.5
KINDS = tuple(
    kind for kind in DisturbanceKind if kind not in (DisturbanceKind.OCCLUSION, DisturbanceKind.TUNNEL_EXIT)
)


@dataclass(frozen=True, slots=True)
class LeadSample:
    """The strips of a frame and the nearer ends of its vehicles in the camera frame."""

    strips: Strips
    vehicles: NDArray[np.float32]  # (MAX_VEHICLES, LABEL): NaN rows are empty; visible is a share of the end


def lead_samples(seed: int, camera: Camera, *, frames: int) -> list[LeadSample]:
    """``frames`` frames of the road ``seed``, taken by cameras like ``camera``."""
    rng = np.random.default_rng((seed, 20))
    road = random_road(rng)
    disturbances = random_disturbances(rng, KINDS, MOST_GRADE) if rng.random() < DISTURBED_SHARE else []
    ground = None if disturbances else Ground(road, seed=seed)
    samples = []
    for _ in range(CAMERAS_PER_ROAD):
        eye = _random_camera(camera, rng)
        renderer = Renderer(road, eye, seed=seed, ground=ground, disturbances=disturbances)
        tilt_rad = float(rng.normal(0, PITCH_DOUBT_RAD))
        view = LeadView(eye.model_copy(update={"pitch_down_rad": eye.pitch_down_rad + tilt_rad}))
        for index in range(frames // CAMERAS_PER_ROAD):
            samples.append(_sample(renderer, view, road, rng, index))
    return samples


def _sample(
    renderer: Renderer, view: LeadView, road: Road, rng: np.random.Generator, index: int
) -> LeadSample:
    station_m = float(rng.uniform(5.0, road.length_m - 30.0))
    x_m, y_m = road.position(station_m, float(rng.normal(0, 0.3)))
    yaw_rad = road.heading_at(station_m) + float(rng.normal(0, 0.05))
    count = 0 if rng.random() < EMPTY_SHARE else int(rng.integers(1, MAX_VEHICLES - 1))
    vehicles = [(_random_pose(road, station_m, rng), random_body(rng)) for _ in range(count)]
    image = renderer.render(
        x_m,
        y_m,
        yaw_rad,
        t_s=float(index),
        station_m=station_m,
        vehicles=vehicles,
        motion=Motion(float(rng.uniform(0, 12)), float(rng.normal(0, 0.2))),
        light=_random_light(rng) if rng.random() < 0.5 else None,
    )
    seen = [(_relative(pose, (x_m, y_m, yaw_rad)), body) for pose, body in vehicles]
    if rng.random() < CLUTTER_SHARE:
        image = cluttered(image, renderer.camera, seen, rng)
    return LeadSample(view.strips(image), labels(renderer.camera, seen))


def labels(camera: Camera, vehicles: list[tuple[Pose, Body]]) -> NDArray[np.float32]:
    """The nearer end of each vehicle: ahead and left of the camera, width, and its visible share."""
    out = np.full((MAX_VEHICLES, len(LABEL)), np.nan, np.float32)
    nearest_first = sorted(vehicles, key=lambda vehicle: math.hypot(*vehicle[0][:2]))
    hidden = np.zeros((camera.height_px, camera.width_px), np.uint8)
    for row, (pose, body) in enumerate(nearest_first[:MAX_VEHICLES]):
        x_m, y_m = near_end(pose, body)
        ahead_m, left_m = x_m - camera.x_m, y_m - camera.y_m
        shape = outline(camera, body, pose) if ahead_m > 0.5 else None
        if shape is None:
            continue
        mask = np.zeros_like(hidden)
        cv2.fillConvexPoly(mask, shape, 1, cv2.LINE_8, 4)
        end_m = np.array([(x_m, y_m - body.width_m / 2), (x_m, y_m + body.width_m / 2)])
        (right_px, foot_px), (left_px, _) = camera.pixel_from_road(end_m)
        inside = np.clip(
            (min(right_px, camera.width_px) - max(left_px, 0)) / max(right_px - left_px, 1), 0, 1
        )
        inside *= foot_px < camera.height_px  # its lower edge must be in the image
        free = 1.0 - float((mask & hidden).sum()) / max(int(mask.sum()), 1)
        out[row] = ahead_m, left_m, body.width_m, inside * free
        hidden |= mask
    return out


def near_end(pose: Pose, body: Body) -> tuple[float, float]:
    """The centre of the nearer end of a vehicle in the ego frame."""
    x_m, y_m, yaw_rad = pose
    cos, sin = math.cos(yaw_rad), math.sin(yaw_rad)
    return min((x_m + end_m * cos, y_m + end_m * sin) for end_m in (body.rear_m, body.front_m))


def random_body(rng: np.random.Generator) -> Body:
    """A car, van or truck, a little larger or smaller than usual, of any colour."""
    body = list(BODIES.values())[int(rng.choice(3, p=(0.6, 0.2, 0.2)))]
    grey, tint = rng.uniform(15, 235), rng.normal(0, 35, 3) * (rng.random() < 0.6)
    length, width, height = rng.uniform(0.9, 1.12), rng.uniform(0.92, 1.08), rng.uniform(0.92, 1.1)
    blue, green, red = (int(v) for v in np.clip(grey + tint, 0, 255))
    return replace(
        body,
        rear_m=body.rear_m * float(length),
        front_m=body.front_m * float(length),
        width_m=body.width_m * float(width),
        height_m=body.height_m * float(height),
        waist_m=body.waist_m * float(height * rng.uniform(0.9, 1.1)),
        clearance_m=body.clearance_m * float(rng.uniform(0.7, 1.3)),
        bgr=(blue, green, red),
    )


def cluttered(
    image: Image, camera: Camera, vehicles: list[tuple[Pose, Body]], rng: np.random.Generator
) -> Image:
    """``image`` with posts, walls and signs beside the vehicles: upright, not of the size of a vehicle."""
    image = image.copy()
    taken = [near_end(pose, body) for pose, body in vehicles]
    for _ in range(int(rng.integers(1, 6))):
        ahead_m, left_m = float(rng.uniform(4, 45)), float(rng.uniform(-12, 12))
        width_m, height_m = [(0.2, 3.0), (5.0, 3.5), (0.7, 0.8), (8.0, 6.0), (0.5, 1.7)][int(rng.integers(5))]
        feet = camera.pixel_from_road([(ahead_m, left_m - width_m / 2), (ahead_m, left_m + width_m / 2)])
        wide = (2.0 + width_m / 2) / ahead_m
        hides = any(abs(left_m / ahead_m - y / max(x, 2.0)) < wide + 1.5 / max(x, 2.0) for x, y in taken)
        if hides or np.isnan(feet).any():
            continue
        top_px = feet[0, 1] - height_m * camera.fy_px / max(ahead_m - camera.x_m, 1.0)
        corners = [
            (feet[1, 0], feet[1, 1]),
            (feet[0, 0], feet[0, 1]),
            (feet[0, 0], top_px),
            (feet[1, 0], top_px),
        ]
        colour = tuple(float(v) for v in np.clip(rng.uniform(10, 230) + rng.normal(0, 25, 3), 0, 255))
        cv2.fillConvexPoly(image, np.round(np.clip(corners, -4e3, 4e3)).astype(np.int32), colour, cv2.LINE_AA)
    return image


def _random_pose(road: Road, station_m: float, rng: np.random.Generator) -> Pose:
    """A pose mostly on the ego lane, else beside it; along the road, oncoming, or seldom at a random angle."""
    ahead_m = NEAREST_M + 2.0 + (FARTHEST_M - NEAREST_M) * float(rng.random()) ** 1.6
    lane = float(rng.choice([0.0, 1.0, -1.0], p=[0.6, 0.28, 0.12]))
    offset_m = lane * road.width_at(station_m) + float(rng.normal(0, 0.5))
    x_m, y_m = road.position(station_m + ahead_m, offset_m)
    turned = float(rng.normal(0, 0.08)) if rng.random() < 0.85 else float(rng.uniform(-1.0, 1.0))
    against = math.pi if lane == 1.0 and rng.random() < 0.6 else 0.0
    return x_m, y_m, road.heading_at(station_m + ahead_m) + turned + against


def _random_light(rng: np.random.Generator) -> Light:
    return Light(
        gain=math.exp(float(np.clip(rng.normal(0, 0.3), -1.2, 0.5))),
        gamma=math.exp(float(rng.normal(0, 0.25))),
        glare=float(rng.uniform(0.1, 0.7)) if rng.random() < 0.1 else 0.0,
        haze=float(rng.uniform(0, 0.5)) if rng.random() < 0.25 else 0.0,
        noise=float(rng.uniform(0.5, 8)),
        blur_px=float(rng.uniform(0, 1.2)) if rng.random() < 0.4 else 0.0,
    )


def _random_camera(camera: Camera, rng: np.random.Generator) -> Camera:
    """Another focal length, height and tilt, and a small lateral shift."""
    zoom = math.exp(float(rng.normal(0, 0.2)))
    return camera.model_copy(
        update=dict(
            fx_px=camera.fx_px * zoom,
            fy_px=camera.fy_px * zoom,
            height_m=camera.height_m * float(rng.uniform(0.85, 1.15)),
            pitch_down_rad=camera.pitch_down_rad / zoom + float(rng.normal(0, 0.02)),
            yaw_rad=float(rng.normal(0, 0.01)),
        )
    )


def _relative(pose: Pose, origin: Pose) -> Pose:
    """``pose`` in the frame of ``origin``."""
    dx, dy = pose[0] - origin[0], pose[1] - origin[1]
    cos, sin = math.cos(origin[2]), math.sin(origin[2])
    return cos * dx + sin * dy, cos * dy - sin * dx, pose[2] - origin[2]
