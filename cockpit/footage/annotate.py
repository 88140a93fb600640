"""Annotated images: boundaries, lane, lane centre and the numbers of an estimate."""

import math
from collections.abc import Iterable, Iterator, Mapping
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from trepid.bounds import at_least
from trepid.config import InputError
from trepid.messages import Decision, PixelPath, SteeringEstimate
from trepid.types import Image

Colour = tuple[int, int, int]

LEFT: Colour = (255, 170, 60)
RIGHT: Colour = (60, 170, 255)
HIGH: Colour = (110, 200, 70)
MEDIUM: Colour = (50, 190, 240)
LOW: Colour = (70, 70, 230)
WHITE: Colour = (245, 245, 245)
PANEL: Colour = (32, 26, 22)
MIN_WIDTH_PX = 640  # smaller images are enlarged for legible text
SINGLE_IMAGE_SUFFIXES = frozenset({".png", ".jpg", ".jpeg", ".webp", ".bmp"})


def annotate(image: Image, estimate: SteeringEstimate) -> Image:
    """A copy of ``image``, at least 640 px wide, with the lane and the numbers of ``estimate`` drawn into it."""
    return _panel(with_lane(image, estimate), estimate, _confidence_colour(estimate.confidence))


def with_lane(image: Image, estimate: SteeringEstimate) -> Image:
    """A copy of ``image``, at least 640 px wide, with the lane of ``estimate`` drawn into it."""
    canvas, scale = enlarge(image)
    left, right = (
        np.array(path, float).reshape(-1, 2) * scale
        for path in (estimate.left_boundary_px, estimate.right_boundary_px)
    )
    unit = max(1, round(canvas.shape[1] / 480))
    colour = _confidence_colour(estimate.confidence)
    canvas = _lane(canvas, left, right, colour)
    for line, line_colour in ((left, LEFT), (right, RIGHT)):
        _polyline(canvas, line, line_colour, 2 * unit)
    _centre(canvas, left, right, 2 * unit)
    return canvas


def enlarge(image: Image) -> tuple[Image, float]:
    """A copy of ``image``, at least 640 px wide, and the factor of enlargement."""
    scale = max(1.0, MIN_WIDTH_PX / image.shape[1])
    size = (round(image.shape[1] * scale), round(image.shape[0] * scale))
    return cv2.resize(image, size, interpolation=cv2.INTER_CUBIC).astype(np.uint8, copy=False), scale


def _confidence_colour(confidence: float) -> Colour:
    if confidence >= 0.6:
        return HIGH
    return MEDIUM if confidence >= 0.25 else LOW


def _common_rows(left: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rows (x_left, x_right, y), from the bottom up, where both boundaries are known."""
    at_right = {y: x for x, y in right.tolist()}
    return np.array([(x, at_right[y], y) for x, y in left.tolist() if y in at_right]).reshape(-1, 3)


def _lane(canvas: Image, left: NDArray[np.float64], right: NDArray[np.float64], colour: Colour) -> Image:
    rows = _common_rows(left, right)
    if len(rows) < 2:
        return canvas
    outline = np.concatenate([rows[:, [0, 2]], rows[::-1][:, [1, 2]]])
    tinted = canvas.copy()
    cv2.fillPoly(tinted, [np.round(outline * 16).astype(np.int32)], colour, cv2.LINE_AA, 4)
    return cv2.addWeighted(tinted, 0.28, canvas, 0.72, 0).astype(np.uint8, copy=False)


def _polyline(canvas: Image, line: NDArray[np.float64], colour: Colour, thickness: int) -> None:
    if len(line) < 2:
        return
    points = [np.round(line * 16).astype(np.int32)]
    cv2.polylines(canvas, points, False, PANEL, thickness + 2, cv2.LINE_AA, 4)
    cv2.polylines(canvas, points, False, colour, thickness, cv2.LINE_AA, 4)


def _centre(canvas: Image, left: NDArray[np.float64], right: NDArray[np.float64], thickness: int) -> None:
    """Dots along the lane centre: on a flat road the middle of an image row is the middle of the lane."""
    for x_left, x_right, y in _common_rows(left, right).tolist():
        at = (round((x_left + x_right) / 2), round(y))
        radius = max(1, round(abs(x_right - x_left) / 120))
        cv2.circle(canvas, at, min(radius, 2 * thickness), WHITE, -1, cv2.LINE_AA)


def _panel(canvas: Image, estimate: SteeringEstimate, colour: Colour) -> Image:
    """A dark strip on top with the numbers and a bar for the confidence."""
    width = canvas.shape[1]
    unit = width / 640
    height = round(46 * unit)
    strip = canvas[:height]
    strip[:] = cv2.addWeighted(strip, 0.25, np.full_like(strip, PANEL), 0.75, 0)
    for number, (name, value) in enumerate(_numbers(estimate)):
        x = round((12 + 103 * number) * unit)
        text(canvas, name, (x, round(16 * unit)), 0.36 * unit, (190, 190, 190))
        text(canvas, value, (x, round(36 * unit)), 0.52 * unit, WHITE)
    x, bar = round(530 * unit), round(98 * unit)
    text(canvas, "confidence", (x, round(16 * unit)), 0.36 * unit, (190, 190, 190))
    top, bottom = round(24 * unit), round(36 * unit)
    cv2.rectangle(canvas, (x, top), (x + bar, bottom), (80, 80, 80), -1)
    cv2.rectangle(canvas, (x, top), (x + round(bar * at_least(estimate.confidence, 0.0)), bottom), colour, -1)
    text(
        canvas, f"{estimate.confidence:z.2f}", (x + round(34 * unit), round(34.5 * unit)), 0.36 * unit, WHITE
    )
    if estimate.reason:
        text(canvas, estimate.reason, (round(12 * unit), round(62 * unit)), 0.45 * unit, colour)
    return canvas


def _numbers(estimate: SteeringEstimate) -> list[tuple[str, str]]:
    heading, wheel = estimate.heading_error_rad, estimate.road_wheel_angle_rad
    return [
        ("offset", number(estimate.lateral_offset_m, "{:+z.2f} m")),
        ("heading", number(None if heading is None else math.degrees(heading), "{:+z.1f} deg")),
        ("curvature", number(estimate.curvature_1pm, "{:+z.4f} 1/m")),
        ("wheel angle", number(None if wheel is None else math.degrees(wheel), "{:+z.1f} deg")),
        ("lane width", number(estimate.lane_width_m, "{:z.2f} m")),
    ]


def number(value: float | None, pattern: str) -> str:
    """The value in the format ``pattern``; a dash for None."""
    return "-" if value is None else pattern.format(value)


def text(canvas: Image, words: str, at: tuple[int, int], size: float, colour: Colour) -> None:
    """Draw ``words`` with a dark edge, legible on any background.

    The edge is the same text, shifted: letters of another thickness have another width, and stand beside it.
    """
    thickness = max(1, round(size * 1.6))
    for right, down in product((-1, 0, 1), repeat=2):
        place = at[0] + right, at[1] + down
        cv2.putText(canvas, words, place, cv2.FONT_HERSHEY_SIMPLEX, size, PANEL, thickness, cv2.LINE_AA)
    cv2.putText(canvas, words, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, thickness, cv2.LINE_AA)


def label(canvas: Image, words: str, at: tuple[int, int], size: float) -> None:
    """Draw ``words`` in white on a dark box with the lower left corner ``at``, within the canvas."""
    (width, height), below = cv2.getTextSize(words, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    x = max(0, min(at[0], canvas.shape[1] - width - 4))
    y = max(height + 4, min(at[1], canvas.shape[0] - below))
    cv2.rectangle(canvas, (x, y - height - 4), (x + width + 4, y + below - 1), PANEL, -1)
    cv2.putText(canvas, words, (x + 2, y - 2), cv2.FONT_HERSHEY_SIMPLEX, size, WHITE, 1, cv2.LINE_AA)


class AnnotationWriter:
    """Writer of annotated frames: an image file, a video, or a folder (an image per still, a video per clip)."""

    def __init__(self, out: Path, inputs: Iterable[Path]) -> None:
        """A file of ``inputs``, or in a folder of them, is never overwritten."""
        self._out, self._inputs = out, frozenset(filter(None, map(_identity, _files(inputs))))
        self._video: cv2.VideoWriter | None = None
        self._size = (0, 0)
        self._clip: Path | None = None  # whose frames go to the video ``_film`` in the folder
        self._film = out
        self._names: set[str] = set()  # of files in the folder
        self._written = 0

    def write(self, image: Image, source: Path, *, is_clip: bool, fps: float) -> None:
        """Add one annotated frame of ``source``, whose video plays at ``fps``.

        Raises InputError when it cannot be written, or would replace an input.
        """
        suffix = self._out.suffix.lower()
        if suffix == ".mp4":
            self._write_video(image, self._out, fps)
        elif suffix in SINGLE_IMAGE_SUFFIXES and not is_clip:
            if self._written:
                raise InputError(f"{self._out}: holds one image only; name a folder or an .mp4 file")
            self._write_image(image, self._out)
        elif suffix:
            raise InputError(f"{self._out}: name an image, an .mp4 file or a folder for the annotated frames")
        elif is_clip:
            if source != self._clip:
                self.close()
                self._clip, self._film = source, self._new_file(source, ".mp4")
            self._write_video(image, self._film, fps)
        else:
            self._write_image(image, self._new_file(source, ".png"))
        self._written += 1

    def close(self) -> None:
        """Finish the video, if any."""
        if self._video is not None:
            self._video.release()
            self._video = None

    def _new_file(self, source: Path, suffix: str) -> Path:
        """``source`` by its name in the folder; by name and number after another of the same name."""
        name, number = f"{source.stem}{suffix}", 1
        while name in self._names:
            number += 1
            name = f"{source.stem}_{number}{suffix}"
        self._names.add(name)
        return self._out / name

    def _write_image(self, image: Image, path: Path) -> None:
        self._make_way(path)
        if not cv2.imwrite(str(path), image):
            raise InputError(f"{path}: cannot be written")

    def _write_video(self, image: Image, path: Path, fps: float) -> None:
        if self._video is None:
            self._make_way(path)
            self._size = (image.shape[1] // 2 * 2, image.shape[0] // 2 * 2)
            rate = float(f"{fps:.4g}")  # MPEG-4 has no finer one
            self._video = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, self._size)
            if not self._video.isOpened():
                raise InputError(f"{path}: cannot be written")
        self._video.write(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA))

    def _make_way(self, path: Path) -> None:
        """Make the folder of ``path``. Raises InputError when that fails, or ``path`` is an input."""
        if _identity(path) in self._inputs:
            raise InputError(f"{path}: is an input, which is never overwritten; name another file or folder")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error


def _files(inputs: Iterable[Path]) -> Iterator[Path]:
    """``inputs``, with the files in a folder instead of it."""
    for path in inputs:
        try:
            yield from path.iterdir() if path.is_dir() else (path,)
        except OSError:
            continue  # the folder has no input either: reading it raises InputError


def _identity(path: Path) -> tuple[int, int] | None:
    """Device and inode: one file may have several paths. None when there is no such file."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_dev, found.st_ino


def as_path(points: PixelPath) -> list[list[float]]:
    """The boundary as JSON lists, to a tenth of a pixel."""
    return [[round(x, 1), round(y, 1)] for x, y in points]


SOME_FROM, MUCH_FROM = 0.35, 0.65  # fear at which the colour of the strip changes


def with_decision(
    canvas: Image, decision: Decision | None, estimates: Mapping[str, SteeringEstimate]
) -> Image:
    """``canvas`` itself, with the strip drawn into it; dashes where there is no decision."""
    width = canvas.shape[1]
    unit = width / 640
    strip = canvas[: round(46 * unit)]
    strip[:] = cv2.addWeighted(strip, 0.25, np.full_like(strip, PANEL), 0.75, 0)
    top, bottom, x, bar = round(24 * unit), round(36 * unit), round(12 * unit), round(98 * unit)
    text(canvas, "fear", (x, round(16 * unit)), 0.36 * unit, (190, 190, 190))
    cv2.rectangle(canvas, (x, top), (x + bar, bottom), (80, 80, 80), -1)
    if decision is not None:
        colour = HIGH if decision.fear < SOME_FROM else MEDIUM if decision.fear < MUCH_FROM else LOW
        cv2.rectangle(canvas, (x, top), (x + round(bar * decision.fear), bottom), colour, -1)
    fear = "-" if decision is None else f"{decision.fear:.2f}"
    text(canvas, fear, (x + round(34 * unit), round(34.5 * unit)), 0.36 * unit, WHITE)
    names = ("level", "cause", "mode")
    shown = {name: "-" if decision is None else str(getattr(decision, name)) for name in names}
    shown["confidence"] = "  ".join(f"{name} {found.confidence:.2f}" for name, found in estimates.items())
    for place, (name, value) in zip((122, 200, 365, 470), shown.items(), strict=True):
        text(canvas, name, (round(place * unit), round(16 * unit)), 0.36 * unit, (190, 190, 190))
        text(canvas, value, (round(place * unit), round(36 * unit)), 0.42 * unit, WHITE)
    return canvas
