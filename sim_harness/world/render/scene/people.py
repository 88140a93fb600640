"""Draws people, cyclists and animals as bodies of balls and the hulls around them.

The proportions of people are those of Drillis and Contini (1966), printed in Winter, Biomechanics and Motor Control
of Human Movement (2009), figure 4.1: heights of the joints as shares of the body height. Legs and arms swing by the
distance walked, so that the feet keep to the ground.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import cv2
import numpy as np

from sim_harness.world.render.scene.painter import NEAR_M, SHIFT, Colour, Painter, Pixels, Pose, shade_colour
from trepid.car.camera import Camera
from trepid.types import Image

Point = tuple[float, float, float]
STRIDE_SHARE = 0.83  # two steps of a walker, of the body height
CRANK_TURN_M = 5.0  # way of a bicycle in one turn of its cranks
SHADE, LIT = 0.78, 1.12  # of a colour in the shade and in the light
LIT_SHARE, LIT_SHIFT = 0.62, 0.30  # radius of the lit part of a limb and its shift to the light, in radii
LIT_FROM_PX = 1.2  # thinner limbs have one colour
ROUND = np.stack([np.cos(np.arange(10) * math.tau / 10), np.sin(np.arange(10) * math.tau / 10)], axis=1)

SKIN = ((150, 178, 224), (120, 150, 205), (90, 120, 172), (62, 84, 122), (44, 60, 92))
HAIR = ((30, 34, 40), (36, 52, 74), (60, 96, 132), (112, 150, 190), (150, 152, 156))
TOPS = (
    *((46, 42, 40), (92, 60, 34), (48, 44, 150), (70, 110, 60), (205, 205, 202), (60, 150, 210)),
    *((120, 90, 70), (150, 60, 90), (40, 190, 225), (96, 96, 98)),
)
TROUSERS = ((52, 44, 38), (98, 68, 46), (60, 62, 64), (74, 92, 118), (130, 104, 84), (34, 32, 34))
COATS = {
    "dog": ((40, 44, 52), (52, 82, 126), (30, 30, 32), (150, 170, 190)),
    "deer": ((52, 84, 128), (66, 92, 124)),
}
SHOE, RUBBER, TUBE = (36, 34, 36), (26, 26, 28), (70, 70, 74)


class Shape(StrEnum):
    """Size class of a road user."""

    ADULT = "adult"
    CHILD = "child"
    CYCLIST = "cyclist"
    DOG = "dog"
    DEER = "deer"


class Kind(StrEnum):
    """The kinds of road users that a detector distinguishes: ``RoadUsers.kinds``."""

    PERSON = "person"
    CYCLIST = "cyclist"
    ANIMAL = "animal"


@dataclass(frozen=True, slots=True)
class Figure:
    """A road user; the origin is the middle of its ground contact."""

    shape: Shape
    kind: Kind
    length_m: float
    width_m: float
    height_m: float
    looks: int = 0  # seed of clothes and colours
    speed_mps: float = 0.0
    walked_m: float = 0.0  # the way so far, for the swing of the legs

    @property
    def rear_m(self) -> float:
        """Its rear end, from the origin."""
        return -self.length_m / 2


FIGURES = {
    Shape.ADULT: Figure(Shape.ADULT, Kind.PERSON, 0.60, 0.50, 1.80),
    Shape.CHILD: Figure(Shape.CHILD, Kind.PERSON, 0.45, 0.30, 1.154),
    Shape.CYCLIST: Figure(Shape.CYCLIST, Kind.CYCLIST, 1.89, 0.50, 1.865),
    Shape.DOG: Figure(Shape.DOG, Kind.ANIMAL, 0.90, 0.25, 0.75),
    Shape.DEER: Figure(Shape.DEER, Kind.ANIMAL, 1.20, 0.35, 1.15),
}
"""Heights and widths of the Euro NCAP pedestrian and bicyclist targets (ISO 19206-2 and -4), lengths of a stride
and of a bicycle; a dog like a German shepherd (withers 0.60 to 0.65 m, FCI standard 166); a roe deer.
"""


class Part(NamedTuple):
    """The hull of balls of one colour."""

    balls: tuple[tuple[Point, float], ...]  # centre and radius
    bgr: Colour


class UprightWheel(NamedTuple):
    """An upright wheel."""

    centre: Point
    radius_m: float
    thick_m: float


class Clothes(NamedTuple):
    """The colours of a person."""

    skin: Colour
    hair: Colour
    top: Colour
    trousers: Colour
    bare_arms: bool
    bare_legs: bool


def draw_figure(image: Image, camera: Camera, figure: Figure, pose: Pose, *, mirrored: bool = False) -> None:
    """Draw ``figure`` at ``pose`` in the camera's vehicle frame into ``image``; nothing when it is behind."""
    if pose[0] - figure.length_m < camera.x_m + NEAR_M:
        return
    painter = Painter(image, camera, pose, mirrored=mirrored)
    if not mirrored:
        painter.shadow(figure.rear_m, -figure.rear_m, figure.width_m / 2)
    for part in sorted(_parts(figure), key=lambda part: _depth_m(painter, part), reverse=True):
        if isinstance(part, UprightWheel):
            _draw_ring(image, painter, part)
        else:
            _draw_part(image, painter, part, upwards=-1.0 if mirrored else 1.0)


def figure_outline(camera: Camera, figure: Figure, pose: Pose) -> Pixels | None:
    """Fixed-point convex outline of a figure; None when it is behind the lens."""
    if pose[0] - figure.length_m < camera.x_m + NEAR_M:
        return None
    painter = Painter(np.empty((0, 0, 3), np.uint8), camera, pose)
    found = [_hull(painter, part, 1.0) for part in _parts(figure) if isinstance(part, Part)]
    return np.asarray(cv2.convexHull(np.concatenate(found)), np.int32)


def _depth_m(painter: Painter, part: Part | UprightWheel) -> float:
    """Distance of the middle of a part."""
    if isinstance(part, UprightWheel):
        return float(painter.optical(np.array([part.centre]))[0, 2])
    return float(painter.optical(np.array([centre for centre, _ in part.balls]))[:, 2].mean())


def _hull(painter: Painter, part: Part, size: float, shift: tuple[float, float] = (0.0, 0.0)) -> Pixels:
    """Fixed-point hull of the balls, their radii times ``size``, shifted by radii (right, down)."""
    optical = painter.optical(np.array([centre for centre, _ in part.balls]))
    pixel = painter.pixels(optical)
    radius = painter.focal_px * np.array([radius for _, radius in part.balls]) / optical[:, 2]
    middle = pixel + radius[:, None] * shift
    circles = middle[:, None, :] + (size * np.maximum(radius, 0.35))[:, None, None] * ROUND
    corners = np.round(circles.reshape(-1, 2) * 2**SHIFT).astype(np.int32)
    return np.asarray(cv2.convexHull(corners), np.int32)


def _draw_part(image: Image, painter: Painter, part: Part, *, upwards: float) -> None:
    """Shade, and towards the light, up and to the left, a lighter core."""
    depth_m = float(painter.optical(np.array([part.balls[0][0]]))[0, 2])
    thick_px = painter.focal_px * max(radius for _, radius in part.balls) / depth_m
    lit = thick_px >= LIT_FROM_PX
    hull = _hull(painter, part, 1.0)
    cv2.fillConvexPoly(image, hull, shade_colour(part.bgr, SHADE if lit else 0.95), cv2.LINE_AA, SHIFT)
    if lit:
        for share, tone in ((0.5, 0.95), (1.0, LIT)):
            size = 1.0 - (1.0 - LIT_SHARE) * share
            shift = (-LIT_SHIFT * share, -LIT_SHIFT * share * 0.5 * upwards)
            hull = _hull(painter, part, size, shift)
            cv2.fillConvexPoly(image, hull, shade_colour(part.bgr, tone), cv2.LINE_AA, SHIFT)


def _draw_ring(image: Image, painter: Painter, ring: UprightWheel) -> None:
    turns = np.arange(24) * math.tau / 24
    x, y, z = ring.centre
    circle = np.stack(
        [x + ring.radius_m * np.cos(turns), np.full(24, y), z + ring.radius_m * np.sin(turns)], axis=1
    )
    optical = painter.optical(circle)
    corners = np.round(painter.pixels(optical) * 2**SHIFT).astype(np.int32)
    thick_px = max(round(painter.focal_px * ring.thick_m / float(optical[:, 2].mean())), 1)
    cv2.polylines(image, [corners], True, RUBBER, thick_px, cv2.LINE_AA, SHIFT)


def _parts(figure: Figure) -> list[Part | UprightWheel]:
    rng = np.random.default_rng((figure.looks, 61))
    match figure.shape:
        case Shape.ADULT | Shape.CHILD:
            return list(_person(figure, _clothes(rng)))
        case Shape.CYCLIST:
            return list(_cyclist(figure, _clothes(rng)))
        case Shape.DOG | Shape.DEER:
            return list(_animal(figure, _one_of(rng, COATS[figure.shape.value])))


def _clothes(rng: np.random.Generator) -> Clothes:
    skin, hair, top, trousers = (_one_of(rng, colours) for colours in (SKIN, HAIR, TOPS, TROUSERS))
    bare_arms, bare_legs = rng.random(2) < (0.3, 0.15)
    return Clothes(skin, hair, top, trousers, bool(bare_arms), bool(bare_legs))


def _one_of(rng: np.random.Generator, colours: tuple[Colour, ...]) -> Colour:
    return colours[int(rng.integers(len(colours)))]


def _limb_end(start: Point, length_m: float, angle_rad: float) -> Point:
    """The end of a limb that hangs from ``start``, swung forwards by an angle."""
    return (start[0] + length_m * math.sin(angle_rad), start[1], start[2] - length_m * math.cos(angle_rad))


def _limb(a: Point, b: Point, from_m: float, to_m: float, bgr: Colour) -> Part:
    return Part(((a, from_m), (b, to_m)), bgr)


def _swing(figure: Figure, stride_m: float) -> tuple[float, float]:
    """Amplitude [rad] and phase [rad] of the legs."""
    amplitude = 0.0 if figure.speed_mps < 0.05 else min(0.28 + 0.10 * figure.speed_mps, 0.6)
    return amplitude, math.tau * figure.walked_m / stride_m


def _person(figure: Figure, clothes: Clothes) -> Iterator[Part]:
    """An upright person. The head of a child is a larger share of its height."""
    tall = figure.height_m
    amplitude, phase = _swing(figure, STRIDE_SHARE * tall)
    stout = figure.width_m / 0.278 / tall  # 1 for the adult target
    head_m = (0.068 if figure.shape is Shape.ADULT else 0.085) * tall
    shoulder_z = tall - 2 * head_m - 0.055 * tall
    legs = [(side, phase + (0.0 if side > 0 else math.pi)) for side in (1, -1)]
    bent = [amplitude * math.sin(turn) for _, turn in legs]
    sink_m = 0.49 * tall * (1 - math.cos(max(map(abs, bent))))
    hip_z = 0.53 * tall - sink_m
    for (side, turn), angle in zip(legs, bent, strict=True):
        hip = (0.0, side * 0.05 * tall * stout, hip_z)
        knee = _limb_end(hip, 0.245 * tall, angle + 0.35 * amplitude * max(math.cos(turn), 0.0))
        ankle = _limb_end(knee, 0.246 * tall, angle - 0.9 * amplitude * max(math.cos(turn), 0.0))
        yield _limb(hip, knee, 0.052 * tall * stout, 0.036 * tall * stout, clothes.trousers)
        shin = clothes.skin if clothes.bare_legs else clothes.trousers
        yield _limb(knee, ankle, 0.035 * tall * stout, 0.024 * tall * stout, shin)
        toe = (ankle[0] + 0.085 * tall, ankle[1], max(ankle[2] - 0.018 * tall, 0.016 * tall))
        yield _limb((ankle[0] - 0.02 * tall, ankle[1], toe[2]), toe, 0.022 * tall, 0.017 * tall, SHOE)
    top_z = shoulder_z - sink_m
    yield from _trunk((0.0, 0.0, hip_z), (0.01 * tall, 0.0, top_z), tall, stout, clothes)
    for (side, _), angle in zip(legs, bent, strict=True):
        shoulder = (0.0, side * (figure.width_m / 2 - 0.032 * tall), top_z - 0.01 * tall)
        elbow = _limb_end(shoulder, 0.18 * tall, -0.8 * angle)
        wrist = _limb_end(elbow, 0.15 * tall, -0.8 * angle + 0.25 + 0.4 * amplitude)
        yield from _arm(shoulder, elbow, wrist, tall * stout, clothes)
    yield from _head((0.015 * tall, 0.0, tall - head_m - sink_m), head_m, clothes)


def _trunk(hip: Point, chest: Point, tall: float, stout: float, clothes: Clothes) -> Iterator[Part]:
    """Trousers' seat and top, from the hips to the shoulders."""
    wide_m, waist_m = 0.078 * tall * stout, 0.055 * tall * stout
    seat = [((hip[0], side * waist_m, hip[2]), 0.058 * tall * stout) for side in (1, -1)]
    yield Part(tuple(seat), clothes.trousers)
    low = (hip[0], 0.0, hip[2] + 0.05 * tall)
    balls = [((low[0], side * waist_m, low[2]), 0.056 * tall * stout) for side in (1, -1)]
    balls += [((chest[0], side * wide_m, chest[2] - 0.035 * tall), 0.056 * tall * stout) for side in (1, -1)]
    yield Part(tuple(balls), clothes.top)


def _arm(shoulder: Point, elbow: Point, wrist: Point, size_m: float, clothes: Clothes) -> Iterator[Part]:
    yield _limb(shoulder, elbow, 0.034 * size_m, 0.026 * size_m, clothes.top)
    sleeve = clothes.skin if clothes.bare_arms else clothes.top
    yield _limb(elbow, wrist, 0.025 * size_m, 0.020 * size_m, sleeve)
    hand = (wrist[0], wrist[1], wrist[2] - 0.035 * size_m)
    yield _limb(wrist, hand, 0.018 * size_m, 0.020 * size_m, clothes.skin)


def _head(centre: Point, radius_m: float, clothes: Clothes) -> Iterator[Part]:
    x, y, z = centre
    slim_m = 0.82 * radius_m
    neck = ((x - 0.02, y, z - 1.35 * radius_m), 0.5 * radius_m)
    yield Part((neck, ((x, y, z - 0.6 * radius_m), 0.5 * radius_m)), clothes.skin)
    face = (
        ((x, y, z + 0.2 * radius_m), slim_m),
        ((x + 0.1 * radius_m, y, z - 0.35 * radius_m), 0.65 * radius_m),
    )
    yield Part(face, clothes.skin)
    back = ((x - 0.35 * radius_m, y, z + 0.05 * radius_m), 0.78 * radius_m)
    yield Part((((x - 0.18 * radius_m, y, z + 0.32 * radius_m), slim_m), back), clothes.hair)


def _cyclist(figure: Figure, clothes: Clothes) -> Iterator[Part | UprightWheel]:
    """A city bicycle with its rider, who sits half upright."""
    size = figure.height_m / 1.865
    phase = math.tau * figure.walked_m / (CRANK_TURN_M * size)

    def at(x: float, y: float, z: float) -> Point:
        return (x * size, y * size, z * size)

    for x in (-0.58, 0.56):
        yield UprightWheel(at(x, 0.0, 0.34), 0.325 * size, 0.045 * size)
    crank, saddle, bar = at(-0.10, 0.0, 0.30), at(-0.28, 0.0, 0.95), at(0.42, 0.0, 1.05)
    frame = clothes.top if sum(clothes.top) < 330 else TUBE
    tubes = [(crank, saddle), (crank, at(0.36, 0.0, 0.78)), (bar, at(0.56, 0.0, 0.34))]
    tubes += [(at(-0.24, 0.0, 0.80), at(0.38, 0.0, 0.85)), (crank, at(-0.58, 0.0, 0.34))]
    tubes += [(at(-0.25, 0.0, 0.82), at(-0.58, 0.0, 0.34))]
    yield from (_limb(a, b, 0.018 * size, 0.018 * size, frame) for a, b in tubes)
    yield _limb(at(0.40, 0.24, 1.06), at(0.40, -0.24, 1.06), 0.018 * size, 0.018 * size, TUBE)
    yield _limb(at(-0.38, 0.0, 0.96), at(-0.18, 0.0, 0.97), 0.05 * size, 0.03 * size, RUBBER)
    for side in (1, -1):
        turn = phase + (0.0 if side > 0 else math.pi)
        foot = at(-0.10 + 0.17 * math.sin(turn), side * 0.11, 0.33 + 0.17 * math.cos(turn))
        hip = at(-0.26, side * 0.09, 0.99)
        knee = _knee(hip, foot, 0.45 * size)
        yield _limb(hip, knee, 0.088 * size, 0.062 * size, clothes.trousers)
        shin = clothes.skin if clothes.bare_legs else clothes.trousers
        yield _limb(knee, foot, 0.058 * size, 0.042 * size, shin)
        toe = (foot[0] + 0.14 * size, foot[1], foot[2] - 0.03 * size)
        yield _limb(foot, toe, 0.042 * size, 0.034 * size, SHOE)
        shoulder, wrist = at(0.10, side * 0.19, 1.46), at(0.38, side * 0.22, 1.08)
        elbow = at(0.14, side * 0.25, 1.22)
        yield from _arm(shoulder, elbow, wrist, 1.8 * size, clothes)
    yield Part(tuple((at(-0.27, side * 0.09, 1.0), 0.115 * size) for side in (1, -1)), clothes.trousers)
    back = [(at(-0.25, side * 0.10, 1.08), 0.10 * size) for side in (1, -1)]
    back += [(at(0.06, side * 0.13, 1.44), 0.10 * size) for side in (1, -1)]
    yield Part(tuple(back), clothes.top)
    yield from _head(at(0.17, 0.0, 1.865 - 0.125), 0.122 * size, clothes)


def _knee(hip: Point, foot: Point, bone_m: float) -> Point:
    """The knee between two bones of one length, in front of the line from hip to foot."""
    along_x, along_z = foot[0] - hip[0], foot[2] - hip[2]
    reach_m = math.hypot(along_x, along_z)
    out_m = math.sqrt(max(bone_m**2 - reach_m**2 / 4, 0.0))
    return (
        (hip[0] + foot[0]) / 2 - out_m * along_z / reach_m,
        (hip[1] + foot[1]) / 2,
        (hip[2] + foot[2]) / 2 + out_m * along_x / reach_m,
    )


def _animal(figure: Figure, coat: Colour) -> Iterator[Part]:
    """A four-legged animal; a deer has long legs, a long neck and a white rump."""
    is_deer = figure.shape is Shape.DEER
    tall, long_m, wide_m = figure.height_m, figure.length_m, figure.width_m
    back_z = (0.62 if is_deer else 0.76) * tall
    deep_m = 0.52 * wide_m if is_deer else 0.56 * wide_m
    front_x, rear_x = 0.24 * long_m, -0.32 * long_m
    amplitude, phase = _swing(figure, 0.9 * long_m)
    for x, side, turn in ((front_x, 1, 0.0), (front_x, -1, 3.1), (rear_x, 1, 3.6), (rear_x, -1, 0.5)):
        hip = (x, side * 0.28 * wide_m, back_z - deep_m)
        angle = amplitude * math.sin(phase + turn)
        knee = _limb_end(hip, 0.48 * (back_z - deep_m), angle + (-0.12 if x < 0 else 0.05))
        foot = _limb_end(knee, 0.50 * (back_z - deep_m), angle + (0.15 if x < 0 else -0.05))
        foot = (foot[0], foot[1], max(foot[2], 0.02))
        yield _limb(hip, knee, (0.58 if x < 0 else 0.42) * deep_m, 0.034, coat)
        yield _limb(knee, foot, 0.028, 0.020, coat)
    chest = ((front_x, 0.0, back_z - deep_m), 1.08 * deep_m)
    yield Part(
        (
            chest,
            ((0.0, 0.0, back_z - 0.85 * deep_m), 0.80 * deep_m),
            ((rear_x, 0.0, back_z - 0.85 * deep_m), 0.85 * deep_m),
        ),
        coat,
    )
    head = (0.46 * long_m if is_deer else 0.42 * long_m, 0.0, 0.90 * tall)
    head_m = 0.075 if is_deer else 0.085
    yield Part((((front_x + 0.05, 0.0, back_z - 0.6 * deep_m), 0.62 * deep_m), (head, 0.7 * head_m)), coat)
    nose = (head[0] + 0.17, 0.0, head[2] - 0.05)
    yield Part(((head, head_m), (nose, 0.38 * head_m)), coat)
    yield Part((((nose[0] + 0.02, 0.0, nose[2]), 0.3 * head_m),), SHOE)
    for side in (1, -1):
        ear = (head[0] - 0.04, side * 0.9 * head_m, head[2] + (1.3 if is_deer else 1.0) * head_m)
        yield _limb((head[0] - 0.02, side * 0.5 * head_m, head[2] + 0.3 * head_m), ear, 0.026, 0.012, coat)
    if is_deer:
        yield Part((((rear_x - 0.55 * deep_m, 0.0, back_z - 0.8 * deep_m), 0.55 * deep_m),), (215, 225, 232))
    else:
        tail = (rear_x - 0.20, 0.0, back_z - 0.35)
        yield _limb((rear_x - 0.08, 0.0, back_z - 0.06), tail, 0.04, 0.03, coat)
