"""How a camera is mounted, from driving straight along a lane: pitch, yaw and, with one known length, height.

On a straight road every line along it points at one vanishing point. With pitch θ down and yaw ψ to the left of the
direction in which the car drives it lies at

    u = c_x + f_x·tan ψ / cos θ,    v = c_y − f_y·tan θ

(Hartley and Zisserman, Multiple View Geometry, 2004, section 8.6). Over a while a car that keeps its lane heads
along it, so the median over the frames is that of the camera, not of the car. Lengths on the road are in heights of
the camera then: the known width of the lane, or the known way between two frames, tells how high it stands.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.camera import Camera
from trepid.config import InputError

Array = NDArray[np.float64]
Bgr = NDArray[np.uint8]

LEAST_FRAMES = 5
LEAST_SEGMENT = 0.03  # of the width of the picture
UPRIGHT = 0.12  # rise over length: level segments are shadows, kerbs across, the horizon
GUESSES = 400  # pairs of segments whose crossing is tried
NEAR_RAD, SHARP_RAD = 0.05, 0.006  # segments farther off are none of the road's; how straight LSD's are
ROUNDS = 12
LEAST_SEGMENTS = 4  # in a frame
MOST_SWAY_RAD = 0.02  # spread of the heading over the frames; a driver who keeps a lane needs half of it
WIDE_RAD = 0.35  # from straight ahead: a road in a bend points there somewhere
BEND_OVER_H, MOST_BEND_RAD = 6.0, 0.02  # R = 420 m below a camera at 1.4 m
MOST_ASIDE = 0.2  # of the camera from the middle of the lane, over its width
LEAST_SHARE = 0.3  # of all segments' length points to one place; grass and gravel have 0.10 to 0.25
BONNET_SHARE = 0.92  # below this share of the height the car may see itself
SIDE_H, STEP_H, BLUR_H = 3.5, 0.01, 0.1  # across the road, in heights of the camera
SWAY_H = 0.25  # how far a line may lie from its usual place
ASIDE_H, LEAST_PEAK = 0.15, 0.1  # no line is nearer to the middle; peak over the highest
MOST_SPREAD = 0.1  # of the width or of the way, between quartiles, over their median
CORNERS, QUALITY, APART_PX, LOST_PX = 400, 0.005, 6, 0.3
AHEAD_H, ACROSS_H = (1.5, 7.0), 2.0  # where corners of the road are tracked
LEAST_CORNERS = 10
LEAST_SPEED_MPS = 1.0


@dataclass(frozen=True)
class Step:
    """A frame, and how far the car drove until the next one, if there is one and that is known."""

    image: Bgr
    following: Bgr | None = None
    way_m: float | None = None


@dataclass(frozen=True)
class Mounting:
    """What straight driving says of a camera."""

    pitch_down_rad: float
    yaw_rad: float
    height_m: float
    frames: int  # in which the lines of the road were seen
    sway_rad: float  # standard deviation of the heading over them
    height_from: str  # "the width of the lane", "the speed", "the camera file"
    height_doubt: float | None  # half of the spread between quartiles over the height


def mounting(steps: Sequence[Step], camera: Camera, *, lane_width_m: float | None = None) -> Mounting:
    """Pitch, yaw and height of ``camera``, whose intrinsics are known.

    The height comes from ``lane_width_m``, between the middles of the lines; else from the way between frames; else
    it stays. Raises InputError that says what is missing.
    """
    seen = [_upright(step.image, camera) for step in steps]
    frames = [lines for lines in seen if len(lines.length_px) >= LEAST_SEGMENTS]
    if len(frames) < LEAST_FRAMES:
        raise InputError(
            f"lines along the road in {len(frames)} of {len(steps)} frames, {LEAST_FRAMES} expected"
        )
    start = _most_pointed_at(_joined(frames), camera)
    points = [_refined(lines, start, camera) for lines in frames]
    kept = [(lines, point) for lines, point in zip(frames, points, strict=True) if point is not None]
    if len(kept) < LEAST_FRAMES:
        raise InputError(
            f"lines that meet in one point in {len(kept)} of {len(steps)} frames, {LEAST_FRAMES} expected"
        )
    vanishing = np.array([point for _, point in kept])
    sway_rad = float(np.std(np.arctan((vanishing[:, 0] - camera.cx_px) / camera.fx_px)))
    if sway_rad > MOST_SWAY_RAD:
        raise InputError(
            f"this is no straight driving: the heading sways by {math.degrees(sway_rad):.1f}°,"
            f" {math.degrees(MOST_SWAY_RAD):.1f}° allowed"
        )
    _check_straight([lines for lines, _ in kept], vanishing, camera)
    u_px, v_px = np.median(vanishing, axis=0).tolist()
    turned = camera.model_copy(update=_turn(u_px, v_px, camera))
    height_m, source, doubt = _height(steps, kept, turned, lane_width_m)
    return Mounting(
        pitch_down_rad=turned.pitch_down_rad,
        yaw_rad=turned.yaw_rad,
        height_m=height_m,
        frames=len(kept),
        sway_rad=sway_rad,
        height_from=source,
        height_doubt=doubt,
    )


@dataclass(frozen=True)
class _Lines:
    """Segments of a picture."""

    middle_px: Array  # (n, 2)
    direction: Array  # (n, 2), unit, pointing up
    length_px: Array  # (n,)

    def part(self, chosen: NDArray[np.bool_]) -> "_Lines":
        """Those where ``chosen``, shape (n,), is true."""
        return _Lines(self.middle_px[chosen], self.direction[chosen], self.length_px[chosen])

    def off_rad(self, point_px: Array) -> Array:
        """Angle between each and the way from its middle to a point; π where it lies above the point."""
        to = point_px - self.middle_px
        distance = np.hypot(*to.T) + 1e-9
        sine = (to[:, 0] * self.direction[:, 1] - to[:, 1] * self.direction[:, 0]) / distance
        below = (to * self.direction).sum(axis=1) > 0
        return np.where(below, np.arcsin(np.clip(sine, -1, 1)), np.pi)


def _joined(frames: Sequence[_Lines]) -> _Lines:
    return _Lines(
        np.concatenate([lines.middle_px for lines in frames]),
        np.concatenate([lines.direction for lines in frames]),
        np.concatenate([lines.length_px for lines in frames]),
    )


def _upright(image: Bgr, camera: Camera) -> _Lines:
    """Segments that may run along the road: LSD (Grompone von Gioi et al., IPOL 2012), long and not level."""
    found = cv2.createLineSegmentDetector().detect(_grey(image, camera))[0]
    ends = np.empty((0, 4)) if found is None else np.asarray(found, float).reshape(-1, 4)
    start, end = ends[:, :2], ends[:, 2:]
    span = end - start
    span *= np.where(span[:, 1] > 0, -1.0, 1.0)[:, None]
    length_px = np.hypot(*span.T)
    direction = span / np.maximum(length_px, 1e-9)[:, None]
    middle_px = (start + end) / 2
    chosen = (length_px > LEAST_SEGMENT * camera.width_px) & (np.abs(direction[:, 1]) > UPRIGHT)
    chosen &= middle_px[:, 1] < BONNET_SHARE * camera.height_px
    return _Lines(middle_px, direction, length_px).part(chosen)


def _grey(image: Bgr, camera: Camera) -> Bgr:
    """The picture in grey without lens distortion."""
    grey = image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
    if not any(camera.distortion):
        return grey
    return np.asarray(cv2.undistort(grey, camera.intrinsics, np.array(camera.distortion)), np.uint8)


def _most_pointed_at(lines: _Lines, camera: Camera) -> Array:
    """Of the crossings of pairs of segments the one that most length points at. Raises InputError."""
    rng = np.random.default_rng(0)
    first, second = rng.integers(len(lines.length_px), size=(2, GUESSES))
    crossings = _crossings(lines, first, second)
    inside = (np.abs(crossings / [camera.width_px, camera.height_px] - 0.5) < 0.5).all(axis=1)
    crossings = crossings[inside]
    if not len(crossings):
        raise InputError("no lines that meet within the picture: is a straight road to be seen?")
    votes = [
        float((lines.length_px * np.exp(-0.5 * (lines.off_rad(point) / (NEAR_RAD / 2)) ** 2)).sum())
        for point in crossings
    ]
    best = np.asarray(crossings[int(np.argmax(votes))])
    share = lines.length_px[np.abs(lines.off_rad(best)) < NEAR_RAD].sum() / lines.length_px.sum()
    if share < LEAST_SHARE:
        raise InputError(
            f"only {100 * share:.0f} % of the lines in sight meet in one place, {100 * LEAST_SHARE:.0f} % expected:"
            " a straight road with lines or sharp edges is needed"
        )
    return best


def _crossings(lines: _Lines, first: NDArray[np.int64], second: NDArray[np.int64]) -> Array:
    """Where pairs of segments meet, shape (m, 2); far away where they hardly do."""
    p, q, d, e = (
        lines.middle_px[first],
        lines.middle_px[second],
        lines.direction[first],
        lines.direction[second],
    )
    turn = d[:, 0] * e[:, 1] - d[:, 1] * e[:, 0]
    turn = np.where(np.abs(turn) < 0.05, np.nan, turn)
    along = ((q - p)[:, 0] * e[:, 1] - (q - p)[:, 1] * e[:, 0]) / turn
    return np.asarray(np.nan_to_num(p + along[:, None] * d, nan=1e9))


def _refined(lines: _Lines, start_px: Array, camera: Camera) -> Array | None:
    """Where the lines of a frame meet, near ``start_px``: least squares of angles with Cauchy weights.

    A segment's angle is as good as it is long. None with too few of them, or all on one side.
    """
    near = lines.part(np.abs(lines.off_rad(start_px)) < NEAR_RAD)
    sides = near.direction[:, 0] > 0
    if len(sides) < LEAST_SEGMENTS or sides.all() or not sides.any():
        return None
    normal = np.column_stack([near.direction[:, 1], -near.direction[:, 0]])
    wanted = (normal * near.middle_px).sum(axis=1)
    point = start_px
    for _ in range(ROUNDS):
        distance = np.hypot(*(point - near.middle_px).T) + 1.0
        weight = near.length_px / distance / np.hypot(1.0, near.off_rad(point) / SHARP_RAD)
        point = np.linalg.lstsq(normal * weight[:, None], wanted * weight, rcond=None)[0]
    far = np.hypot(*(point - start_px)) > 0.2 * camera.width_px
    return None if far else np.asarray(point)


def _check_straight(frames: Sequence[_Lines], vanishing: Array, camera: Camera) -> None:
    """Raises InputError when the farther lines of the road point ever farther aside.

    On a bend the heading of the road at the distance d is κ·d: least squares of where each segment, drawn on, meets
    the horizon, over the distance of its middle, with Cauchy weights.
    """
    aside: list[Array] = []
    ahead: list[Array] = []
    length: list[Array] = []
    for lines, (u_px, v_px) in zip(frames, vanishing, strict=True):
        below_px = lines.middle_px[:, 1] - v_px
        rise = np.maximum(-lines.direction[:, 1], UPRIGHT)
        meets_px = lines.middle_px[:, 0] + lines.direction[:, 0] / rise * below_px
        known = (below_px > 0.03 * camera.height_px) & (np.abs(meets_px - u_px) < WIDE_RAD * camera.fx_px)
        aside.append((meets_px[known] - u_px) / camera.fx_px)
        ahead.append(camera.fy_px / below_px[known])
        length.append(lines.length_px[known] / ahead[-1])
    y, x, weight = np.concatenate(aside), np.concatenate(ahead), np.concatenate(length)
    matrix = np.column_stack([np.ones_like(x), x])
    line: Array = np.zeros(2)
    for _ in range(ROUNDS):
        root = weight / np.hypot(1.0, (y - matrix @ line) / NEAR_RAD)
        line = np.asarray(np.linalg.lstsq(matrix * root[:, None], y * root, rcond=None)[0])
    bend_rad = abs(float(line[1])) * BEND_OVER_H
    if bend_rad > MOST_BEND_RAD:
        raise InputError(
            f"this is no straight road: it turns by {math.degrees(bend_rad):.1f}° in view,"
            f" {math.degrees(MOST_BEND_RAD):.1f}° allowed"
        )


def _turn(u_px: float, v_px: float, camera: Camera) -> dict[str, float]:
    """Pitch and yaw with which straight ahead lies at a pixel."""
    pitch_rad = math.atan((camera.cy_px - v_px) / camera.fy_px)
    yaw_rad = math.atan((u_px - camera.cx_px) / camera.fx_px * math.cos(pitch_rad))
    return {"pitch_down_rad": pitch_rad, "yaw_rad": yaw_rad}


def _height(
    steps: Sequence[Step],
    kept: Sequence[tuple[_Lines, Array]],
    camera: Camera,
    lane_width_m: float | None,
) -> tuple[float, str, float | None]:
    """The height [m], what it rests on and its doubt."""
    if lane_width_m is not None:
        widths = _lane_widths_h([_Across.of(lines, point, camera) for lines, point in kept])
        width, doubt = _agreed(widths, "the lane between two lines")
        return lane_width_m / width, "the width of the lane", doubt
    driven = [step for step in steps if step.way_m is not None and step.following is not None]
    if not driven:
        return camera.height_m, "the camera file", None
    flat = camera.model_copy(update={"height_m": 1.0, "x_m": 0.0, "y_m": 0.0})
    heights = [step.way_m / way for step in driven if step.way_m and (way := _way_h(step, flat)) is not None]
    height_m, doubt = _agreed(heights, "the ground moving between two frames")
    return height_m, "the speed", doubt


def _agreed(values: list[float], what: str) -> tuple[float, float]:
    """The median and half of the spread between quartiles over it. Raises InputError."""
    if len(values) < LEAST_FRAMES:
        raise InputError(f"{what} is seen in {len(values)} frames, {LEAST_FRAMES} expected")
    low, middle, high = np.percentile(values, (25, 50, 75)).tolist()
    if (high - low) / middle > MOST_SPREAD:
        raise InputError(
            f"{what} differs by {100 * (high - low) / middle:.0f} % from frame to frame,"
            f" {100 * MOST_SPREAD:.0f} % allowed"
        )
    return middle, (high - low) / 2 / middle


@dataclass(frozen=True)
class _Across:
    """Segments along the road in a frame: where they lie across it [heights of the camera], and their lengths."""

    aside_h: Array
    length_px: Array

    @classmethod
    def of(cls, lines: _Lines, vanishing_px: Array, camera: Camera) -> "_Across":
        """Those that point to the vanishing point of their frame."""
        u_px, v_px = vanishing_px.tolist()
        level = {"height_m": 1.0, "x_m": 0.0, "y_m": 0.0}
        own = camera.model_copy(update=_turn(u_px, v_px, camera) | level)
        along = lines.part(np.abs(lines.off_rad(vanishing_px)) < 2 * SHARP_RAD)
        aside = own.road_from_pixel(along.middle_px)[:, 1]
        known = np.isfinite(aside)
        return cls(aside[known], along.length_px[known])

    def near(self, place_h: float) -> float | None:
        """Mean place of what lies near a place; None when nothing does."""
        close = np.abs(self.aside_h - place_h) < SWAY_H
        return float(np.average(self.aside_h[close], weights=self.length_px[close])) if close.any() else None


def _lane_widths_h(frames: Sequence[_Across]) -> list[float]:
    """Widths of the lane [heights of the camera] in the frames that show both lines next to the middle.

    Which lines those are is what all frames together say: of a dashed one, a single frame may show nothing.
    Raises InputError when a line seems to be missing.
    """
    aside = np.concatenate([frame.aside_h for frame in frames])
    length = np.concatenate([frame.length_px for frame in frames])
    grid = np.arange(-SIDE_H, SIDE_H + STEP_H, STEP_H)
    density = np.exp(-0.5 * ((grid[:, None] - aside) / BLUR_H) ** 2) @ length
    inner, floor = density[1:-1], LEAST_PEAK * density.max()
    peaks = grid[1:-1][(inner >= density[:-2]) & (inner > density[2:]) & (inner > floor)]
    left, right = peaks[peaks > ASIDE_H], peaks[peaks < -ASIDE_H]
    if not len(left) or not len(right):
        return []
    if abs(left.min() + right.max()) / 2 > MOST_ASIDE * (left.min() - right.max()):
        raise InputError(
            "the camera is far from the middle between the two lines next to it: one line may be missing"
        )
    pairs = [(frame.near(float(left.min())), frame.near(float(right.max()))) for frame in frames]
    return [one - other for one, other in pairs if one is not None and other is not None]


def _way_h(step: Step, camera: Camera) -> float | None:
    """How far the ground came nearer between two frames, in heights of the camera; None where too little is seen.

    Corners of Shi and Tomasi on the road, tracked there and back by Lucas and Kanade.
    """
    if step.following is None:
        return None
    before, after = (_grey(image, camera) for image in (step.image, step.following))
    found = cv2.goodFeaturesToTrack(before, CORNERS, QUALITY, APART_PX, mask=_road_mask(camera))
    if found is None:
        return None
    there, good, _ = cv2.calcOpticalFlowPyrLK(before, after, found, found.copy())
    back, good_back, _ = cv2.calcOpticalFlowPyrLK(after, before, there, there.copy())
    kept = (np.asarray(good) & np.asarray(good_back)).ravel().astype(bool)
    kept &= np.abs(back - found).max(axis=(1, 2)) < LOST_PX
    moved = camera.road_from_pixel(found[kept, 0]) - camera.road_from_pixel(there[kept, 0])
    ways = moved[np.isfinite(moved).all(axis=1), 0]
    ways = ways[ways > 0]
    return float(np.median(ways)) if len(ways) >= LEAST_CORNERS else None


def _road_mask(camera: Camera) -> Bgr:
    """Where the road ahead is, for a camera at height 1."""
    corners = [
        (x, y) for x, y in zip(np.repeat(AHEAD_H, 2), (ACROSS_H, -ACROSS_H, -ACROSS_H, ACROSS_H), strict=True)
    ]
    outline = np.nan_to_num(camera.pixel_from_road(np.array(corners)))
    mask = np.zeros((camera.height_px, camera.width_px), np.uint8)
    cv2.fillConvexPoly(mask, np.clip(outline, -1e4, 1e4).astype(np.int32), 255)
    mask[int(BONNET_SHARE * camera.height_px) :] = 0
    return mask
