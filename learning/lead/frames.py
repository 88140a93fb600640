"""Labelled strips for the lead detector: vehicles of all sizes and colours on random roads, in all weathers.

One seed is one road with its own curves, looks, light and weather. The labels are the true places of the vehicles,
never measured in the image. Every scene is rendered twice, with its vehicles and without: what is there besides,
like shadows, reflections, marks and boxes of other sizes, is seen as often alone as beside a vehicle. The
difference between the two pictures measures how visible a vehicle is in the weather.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from learning.drawn_frames import drawn_road, highway, random_disturbances, random_road
from learning.roadside import things_beside
from perception.lead.view import DISTANCES_M, LeadView, Strips
from sim_harness.scenarios.traffic import BODIES
from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.vehicles import Body, outline
from sim_harness.world.render.scene.view import ShutterMotion
from sim_harness.world.roads.appearance import Light
from sim_harness.world.roads.disturbances import DisturbanceKind, disturb
from sim_harness.world.roads.drawn import BendShape, random_segments
from sim_harness.world.roads.elevation import ElevationPoint
from sim_harness.world.roads.features import MarkKind, RoadMark
from sim_harness.world.roads.road import Road
from sim_harness.world.streets import StreetKind, random_street
from trepid.car.camera import Camera
from trepid.types import Floats, Image

MAX_VEHICLES = 6
MIN_VISIBLE, HIDDEN = 0.6, 0.15  # visible share: below the first not in the loss, below the second no vehicle
LABEL = ("ahead_m", "left_m", "width_m", "visible")
NEAREST_M = 2.2
FARTHEST_M = float(DISTANCES_M[-1])
FASTEST_MPS = 25.0
PITCH_DOUBT_RAD = 0.004  # uncertainty of the calibration and of body pitch: 0.23 deg
CLEAR, HILLS = "clear", "hills"
DISTURBED_SHARE, CLUTTER_SHARE, THINGS_SHARE, MARKED_SHARE = 0.7, 0.3, 0.4, 0.3
ROADS = (random_road, drawn_road, highway)
ROAD_SHARES = (0.3, 0.15, 0.3, 0.25)  # of these, and of streets
LANE_SHARES = (0.55, 0.27, 0.18)  # of the vehicles: the own lane, the left and the right one
CAMERAS_PER_ROAD = 3
MOST_GRADE = 4.0
HILL_M, HILL_GRADE = (25.0, 80.0), 0.07  # between two changes of the grade, and the greatest grade
CHANGED_GREY = 12.0  # a pixel of a vehicle on a hill differs by this much
LEAST_HEIGHT = 0.4  # share of the height of a vehicle behind a crest that makes it a label
SEEN_GREY = 10.0  # difference that a vehicle makes [grey levels], above which it is wholly visible
WEIGHTS = dict.fromkeys(DisturbanceKind, 1.0) | {
    DisturbanceKind.RAIN: 4.0,
    **dict.fromkeys((DisturbanceKind.WET_ROAD, DisturbanceKind.BUILDING_SHADOWS), 3.0),
    **dict.fromkeys((DisturbanceKind.TREE_SHADOWS, DisturbanceKind.BRIDGE_SHADOWS), 2.0),
    **dict.fromkeys((DisturbanceKind.FOG, DisturbanceKind.NIGHT, DisturbanceKind.SNOW), 2.0),
    **dict.fromkeys((DisturbanceKind.OCCLUSION, DisturbanceKind.TUNNEL_EXIT), 0.0),
}
"""How often a kind is drawn; never occlusion, which draws vehicles without a label, and never a tunnel."""


@dataclass(frozen=True, slots=True)
class LeadSample:
    """The strips of a frame and the nearer ends of its vehicles in the camera frame."""

    strips: Strips
    vehicles: NDArray[np.float32]  # (MAX_VEHICLES, LABEL): NaN rows are empty; visible is a share of the end
    lane_left_m: NDArray[
        np.float32
    ]  # (STRIPS,): the centre of the own lane on each strip, + left of the camera


@dataclass(frozen=True, slots=True)
class LeadRoad:
    """The frames of one road, those with vehicles and their twins without in turn."""

    samples: list[LeadSample]
    weather: tuple[str, ...]  # kinds of disturbance on it, or CLEAR


def lead_road(seed: int, camera: Camera, *, frames: int, hills: float = 0.0) -> LeadRoad:
    """``frames`` frames of the road ``seed``, taken by cameras like ``camera``; a share ``hills`` of all is hilly.

    On a hill there is one vehicle in a frame, in clear weather, so that all that changes is its visible part.
    """
    rng, ups = np.random.default_rng((seed, 20)), np.random.default_rng((seed, 21))
    road = _random_place(rng)
    hilly = bool(ups.random() < hills)
    if hilly:
        road = Road(road.settings.model_copy(update={"elevation": _random_profile(road, ups)}))
    things = things_beside(road, rng) if rng.random() < THINGS_SHARE else []
    disturbances = (
        random_disturbances(rng, tuple(WEIGHTS), MOST_GRADE, weights=tuple(WEIGHTS.values()))
        if rng.random() < DISTURBED_SHARE
        else []
    )
    disturbances = [] if hilly else disturbances
    road = Road(disturb(road.settings, disturbances))
    ground = Ground(road, seed=seed)
    samples: list[LeadSample] = []
    for _ in range(CAMERAS_PER_ROAD):
        eye = _random_camera(camera, rng)
        renderer = Renderer(road, eye, seed=seed, ground=ground, disturbances=disturbances, things=things)
        tilt_rad = float(rng.normal(0, PITCH_DOUBT_RAD))
        view = LeadView(eye.model_copy(update={"pitch_down_rad": eye.pitch_down_rad + tilt_rad}))
        for index in range(frames // CAMERAS_PER_ROAD // 2):
            samples += _twins(renderer, view, road, rng, index)
    weather = (HILLS,) if hilly else tuple(sorted({one.kind.value for one in disturbances}))
    return LeadRoad(samples, weather or (CLEAR,))


def _random_profile(road: Road, rng: np.random.Generator) -> tuple[ElevationPoint, ...]:
    """Crests and sags with radii of a few hundred metres."""
    points, at_m = [], float(rng.uniform(0.0, 40.0))
    while at_m < road.length_m:
        points.append(ElevationPoint(at_m=at_m, grade=float(rng.uniform(-HILL_GRADE, HILL_GRADE))))
        at_m += float(rng.uniform(*HILL_M))
    return tuple(points)


def _random_place(rng: np.random.Generator) -> Road:
    """A road outside towns or a street, at times with painted marks."""
    kind = int(rng.choice(len(ROAD_SHARES), p=ROAD_SHARES))
    if kind < len(ROADS):
        road = ROADS[kind](rng)
    else:
        shape = BendShape.BEND if rng.random() < 0.5 else BendShape.STRAIGHT
        street = tuple(StreetKind)[int(rng.integers(len(StreetKind)))]
        road = random_street(street, rng, from_m=10.0, segments=random_segments(shape, rng)).road
    if rng.random() >= MARKED_SHARE:
        return road
    kinds = tuple(one for one in MarkKind if one is not MarkKind.TEXT)
    marks = tuple(
        RoadMark(
            kind=kinds[int(rng.integers(len(kinds)))], at_m=float(rng.uniform(5.0, road.length_m - 10.0))
        )
        for _ in range(int(rng.integers(1, 4)))
    )
    return Road(road.settings.model_copy(update={"marks": (*road.settings.marks, *marks)}))


def _twins(
    renderer: Renderer, view: LeadView, road: Road, rng: np.random.Generator, index: int
) -> tuple[LeadSample, LeadSample]:
    """The same place with vehicles and without."""
    station_m = float(rng.uniform(5.0, road.length_m - 30.0))
    x_m, y_m = road.position(station_m, float(rng.normal(0, 0.3)))
    pose = (x_m, y_m, road.heading_at(station_m) + float(rng.normal(0, 0.05)))
    vehicles = [
        (_random_pose(road, station_m, rng), random_body(rng))
        for _ in range(1 if road.elevation else int(rng.integers(1, MAX_VEHICLES - 1)))
    ]
    motion = ShutterMotion(float(rng.uniform(0, FASTEST_MPS)), float(rng.normal(0, 0.2)))
    light = _random_light(rng) if rng.random() < 0.5 else None
    seen = [(_relative(place, pose), body) for place, body in vehicles]
    cluttered_by = int(rng.integers(2**31)) if rng.random() < CLUTTER_SHARE else None

    def image_of(there: Sequence[tuple[Pose, Body]]) -> Image:
        image = renderer.render(
            *pose, t_s=float(index), station_m=station_m, vehicles=there, motion=motion, light=light
        )
        if cluttered_by is None:
            return image
        return add_clutter(image, renderer.camera, seen, np.random.default_rng(cluttered_by))

    full, empty = image_of(vehicles), image_of(())
    difference = np.abs(full.astype(np.float32) - empty).mean(axis=2)
    lane_left_m = _lane_left_m(road, station_m, pose, renderer.camera)
    nothing = np.full((MAX_VEHICLES, len(LABEL)), np.nan, np.float32)
    if road.elevation:
        there = apparent_label(renderer.camera, seen[0], difference)
    else:
        there = labels(renderer.camera, seen, difference=difference)
    return (
        LeadSample(view.strips(full), there, lane_left_m),
        LeadSample(view.strips(empty), nothing, lane_left_m),
    )


def _lane_left_m(road: Road, station_m: float, pose: Pose, camera: Camera) -> NDArray[np.float32]:
    """Lateral place of the centre of the own lane on each strip, + left of the camera."""
    along_m = np.linspace(0.0, 1.5 * FARTHEST_M, 256)
    centre = road.positions(station_m + along_m, np.zeros(len(along_m))) - pose[:2]
    cos, sin = math.cos(pose[2]), math.sin(pose[2])
    ahead_m = centre @ (cos, sin) - camera.x_m
    left_m = centre @ (-sin, cos) - camera.y_m
    until = int(np.argmax(np.append(np.diff(ahead_m) <= 0, True))) + 1  # where it turns back
    return np.interp(DISTANCES_M, ahead_m[:until], left_m[:until]).astype(np.float32)


def labels(
    camera: Camera, vehicles: list[tuple[Pose, Body]], *, difference: Floats | None = None
) -> NDArray[np.float32]:
    """The nearer end of each vehicle: ahead and left of the camera, width, and its visible share.

    ``difference`` is what the vehicles change in each pixel [grey levels]: where its mean over the free part of a
    vehicle is below SEEN_GREY, as in fog and at night, the visible share falls with it.
    """
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
        shown = 1.0
        if difference is not None:
            apart = difference[(mask > 0) & (hidden == 0)]
            shown = min(float(apart.mean()) / SEEN_GREY, 1.0) if apart.size else 0.0
        out[row] = ahead_m, left_m, body.width_m, inside * free * shown
        hidden |= mask
    return out


def apparent_label(camera: Camera, vehicle: tuple[Pose, Body], difference: Floats) -> NDArray[np.float32]:
    """The label of a vehicle on a hill: where what is seen of it would stand on a plane, (MAX_VEHICLES, LABEL).

    The lower edge of its visible part counts: behind a crest that is the crest, which is nearer than the vehicle.
    """
    out = np.full((MAX_VEHICLES, len(LABEL)), np.nan, np.float32)
    (x_m, y_m), body = near_end(*vehicle), vehicle[1]
    rows, columns = np.nonzero(difference > CHANGED_GREY)
    if x_m <= camera.x_m or not rows.size:
        return out
    foot_px, high_px = float(rows.max() + 0.5), rows.max() - rows.min() + 1
    ((ahead_m, _),) = (
        camera.road_from_pixel([(float(columns.mean()), foot_px)]) - (camera.x_m, 0.0)
    ).tolist()
    nearer = ahead_m / (x_m - camera.x_m)
    share = high_px / (body.height_m * camera.fy_px / (x_m - camera.x_m))
    inside = columns.min() > 0 and columns.max() < camera.width_px - 1 and rows.max() < camera.height_px - 1
    if not (inside and 0 < ahead_m <= 1.1 * FARTHEST_M and share >= LEAST_HEIGHT):
        visible = (HIDDEN + MIN_VISIBLE) / 2  # neither a vehicle nor none
        out[0] = x_m - camera.x_m, y_m - camera.y_m, body.width_m, visible
        return out
    contrast = min(float(difference[rows, columns].mean()) / SEEN_GREY, 1.0)
    out[0] = ahead_m, nearer * (y_m - camera.y_m), nearer * body.width_m, contrast
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


def add_clutter(
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
    """A pose mostly on the ego lane, else beside it; along the road, oncoming, or seldom at a random angle.

    As many are near as far, in ratios of the distance: every strip has equally many.
    """
    least_m = NEAREST_M + 2.0
    ahead_m = least_m * (FARTHEST_M / least_m) ** float(rng.random())
    lane = float(rng.choice([0.0, 1.0, -1.0], p=LANE_SHARES))
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
