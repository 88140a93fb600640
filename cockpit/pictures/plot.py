"""Plots with axes, drawn by OpenCV, which is here anyway: a plotting library would double the base installation.

Colours are those of Okabe and Ito, Color Universal Design (2008), and the perceptually even, colour-blind-safe
map ``viridis``; lines that stand beside each other differ in brightness too.
"""

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from trepid.config import InputError
from trepid.types import Column, Image

Colour = tuple[int, int, int]  # BGR

PAPER: Colour = (255, 255, 255)
INK: Colour = (45, 40, 38)
GREY: Colour = (125, 120, 118)
FAINT: Colour = (226, 224, 222)
BLUE: Colour = (178, 114, 0)
SKY: Colour = (233, 180, 86)
GREEN: Colour = (115, 158, 0)
ORANGE: Colour = (0, 159, 230)
VERMILION: Colour = (0, 94, 213)
FIVE = (BLUE, SKY, GREEN, ORANGE, VERMILION)
"""From calm to worst."""
SCALE = 2  # lines and text are drawn as large as that, for sharp print
_SHIFT = 4  # fractional bits of line points
_FONTS = {weight: cv2.FontFace("sans") for weight in (400, 600)}


@dataclass(frozen=True, slots=True)
class Axes:
    """A rectangle of a canvas [px], and the ranges that it shows."""

    left: float
    top: float
    right: float
    bottom: float
    x: tuple[float, float]
    y: tuple[float, float]

    def at(self, x: Column | float, y: Column | float) -> Column:
        """Pixels of points, shape (n, 2)."""
        across = (np.asarray(x, float) - self.x[0]) / (self.x[1] - self.x[0])
        up = (np.asarray(y, float) - self.y[0]) / (self.y[1] - self.y[0])
        across, up = np.broadcast_arrays(across, up)
        return np.stack(
            [self.left + across * (self.right - self.left), self.bottom + up * (self.top - self.bottom)],
            axis=-1,
        ).reshape(-1, 2)


def blank(width: int, height: int) -> Image:
    """White paper."""
    return np.full((height * SCALE, width * SCALE, 3), PAPER, np.uint8)


def write(
    canvas: Image,
    text: str,
    x: float,
    y: float,
    *,
    size: int = 13,
    colour: Colour = INK,
    bold: bool = False,
    anchor: str = "left",
    upright: bool = False,
) -> None:
    """``text`` with its base line at ``y``, from, around or up to ``x``; ``upright`` reads from bottom to top."""
    weight = 600 if bold else 400
    width = text_width(text, size=size, bold=bold)
    start = {"left": 0.0, "centre": width / 2, "right": width}[anchor]
    font = _FONTS[weight]
    if not upright:
        at = (round((x - start) * SCALE), round(y * SCALE))
        cv2.putText(canvas, text, at, colour, font, size * SCALE, weight)
        return
    strip = np.full((2 * size * SCALE, round(width + 8) * SCALE, 3), canvas[0, 0], np.uint8)
    cv2.putText(strip, text, (4 * SCALE, round(1.4 * size * SCALE)), colour, font, size * SCALE, weight)
    turned = cv2.rotate(strip, cv2.ROTATE_90_COUNTERCLOCKWISE)
    top = round((y - width + start - 4) * SCALE)
    left = round((x - 1.4 * size) * SCALE)
    canvas[top : top + turned.shape[0], left : left + turned.shape[1]] = turned


def text_width(text: str, *, size: int = 13, bold: bool = False) -> float:
    """Width of ``text`` [px]."""
    weight = 600 if bold else 400
    (_, _, width, _) = cv2.getTextSize((10_000, 1_000), text, (0, 0), _FONTS[weight], size * SCALE, weight)
    return float(width) / SCALE


def line(canvas: Image, points: Column, colour: Colour, *, width: float = 1.0) -> None:
    """A polyline through ``points`` [px], shape (n, 2)."""
    fixed = np.round(points * SCALE * 2**_SHIFT).astype(np.int32)
    cv2.polylines(canvas, [fixed], False, colour, max(1, round(width * SCALE)), cv2.LINE_AA, _SHIFT)


def frame(
    canvas: Image,
    axes: Axes,
    *,
    x_label: str,
    y_label: str,
    y_ticks: list[float] | None = None,
    grid: bool = True,
) -> None:
    """Ticks and labels of ``axes``; a grid, or only marks beside what is drawn there."""
    colour = FAINT if grid else GREY
    for tick in ticks(axes.x):
        ((x, _),) = axes.at(tick, axes.y[0])
        end = axes.top if grid else axes.bottom + 4
        line(canvas, np.array([[x, axes.bottom], [x, end]]), colour, width=0.5)
        write(canvas, f"{tick:g}", x, axes.bottom + 15, size=11, colour=GREY, anchor="centre")
    for tick in ticks(axes.y) if y_ticks is None else y_ticks:
        ((_, y),) = axes.at(axes.x[0], tick)
        end = axes.right if grid else axes.left - 4
        line(canvas, np.array([[axes.left, y], [end, y]]), colour, width=0.5)
        write(canvas, f"{tick:g}", axes.left - 6, y + 4, size=11, colour=GREY, anchor="right")
    outline(canvas, axes)
    middle_x, middle_y = (axes.left + axes.right) / 2, (axes.top + axes.bottom) / 2
    write(canvas, x_label, middle_x, axes.bottom + 33, size=12, anchor="centre")
    if y_label:
        write(canvas, y_label, axes.left - 42, middle_y, size=12, anchor="centre", upright=True)


def outline(canvas: Image, axes: Axes) -> None:
    """The lines below and to the left of ``axes``."""
    corners = [[axes.left, axes.top], [axes.left, axes.bottom], [axes.right, axes.bottom]]
    line(canvas, np.array(corners), GREY, width=0.8)


def ticks(span: tuple[float, float], most: int = 6) -> list[float]:
    """Round numbers within ``span``, at most about ``most``: steps of 1, 2 or 5 times a power of ten."""
    rough = (span[1] - span[0]) / most
    power = 10.0 ** np.floor(np.log10(rough))
    step = next(power * factor for factor in (1, 2, 5, 10) if power * factor >= rough - 1e-12)
    first = int(np.ceil(span[0] / step - 1e-9))
    last = int(np.floor(span[1] / step + 1e-9))
    return [round(n * step, 12) + 0.0 for n in range(first, last + 1)]


def shade(canvas: Image, axes: Axes, values: Column) -> None:
    """Fill ``axes`` with ``values`` in 0..1 by viridis; row 0 of ``values`` stands at the bottom."""
    grey = np.round(np.clip(values[::-1], 0.0, 1.0) * 255).astype(np.uint8)
    size = (round((axes.right - axes.left) * SCALE), round((axes.bottom - axes.top) * SCALE))
    large = cv2.resize(grey, size, interpolation=cv2.INTER_LINEAR)
    top, left = round(axes.top * SCALE), round(axes.left * SCALE)
    canvas[top : top + size[1], left : left + size[0]] = cv2.applyColorMap(large, cv2.COLORMAP_VIRIDIS)


def save(image: Image, path: Path) -> None:
    """Write a picture. Raises InputError when that fails."""
    try:
        written = cv2.imwrite(str(path), image)
    except cv2.error as error:
        raise InputError(f"{path}: no picture is called that: .png and .jpg are known") from error
    if not written:
        raise InputError(f"{path}: cannot be written")
