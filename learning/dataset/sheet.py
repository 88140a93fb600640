"""The picture of a data set: images over the steering angles, distribution and course of the labels."""

from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np

from learning.dataset.dataset import NONE, SPLITS, Dataset
from learning.dataset.motion import suspicious
from trepid.images.figure_style import BLUE, GREEN, GREY, ORANGE, VERMILION, bare, new_figure, save
from trepid.types import Image

COLUMNS, ROWS = 7, 4
TILE_PX = 150, 100
COLOURS = dict(zip(SPLITS, (BLUE, GREEN, ORANGE), strict=True))


def draw(dataset: Dataset, path: Path) -> None:
    """Write the picture to ``path``. Raises InputError where that fails."""
    rows = dataset.rows()
    used = rows[rows["split"] != NONE]
    angles = np.degrees(rows["road_wheel_rad"])
    figure = new_figure(11, 11, layout="constrained")
    top, left, course, light = figure.subplots(4, 1, height_ratios=(5, 1.5, 1.8, 1.0))
    sheet, titles = contact_sheet(dataset)
    top.imshow(cv2.cvtColor(sheet, cv2.COLOR_BGR2RGB))
    top.set_xticks((np.arange(COLUMNS) + 0.5) * TILE_PX[0], titles)
    top.set_yticks([])
    top.set_title(f"{dataset.folder.name}: images by road-wheel angle, + = left")
    parts = [np.degrees(used["road_wheel_rad"][used["split"] == name]) for name in SPLITS]
    left.hist(parts, bins=41, stacked=True, color=list(COLOURS.values()), label=list(SPLITS))
    left.set(xlabel="road-wheel angle [°]", ylabel="frames", yscale="log")
    left.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, fontsize=8)
    place, bad = np.arange(len(rows)), suspicious(rows)
    for name, colour in {**COLOURS, NONE: GREY}.items():
        mine = rows["split"] == name
        course.plot(place[mine], angles[mine], ".", markersize=1.5, color=colour)
        light.plot(place[mine], rows["light"][mine], ".", markersize=1.5, color=colour)
    course.plot(place[bad], angles[bad], "x", markersize=4, color=VERMILION, label="suspicious")
    course.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, fontsize=8)
    course.set(ylabel="angle [°]")
    light.set(xlabel="frame in the order of the index", ylabel="mean grey", ylim=(0, 1))
    for axes in (left, course, light):
        bare(axes)
    save(figure, path)


def contact_sheet(dataset: Dataset) -> tuple[Image, list[str]]:
    """ROWS images spread over each of COLUMNS bins of the angle, from left to right, and the titles of the bins."""
    rows = dataset.rows()
    used = rows[rows["split"] != NONE]
    angles = np.degrees(used["road_wheel_rad"])
    most = max(float(np.percentile(np.abs(angles), 99.5)), 0.5) if len(angles) else 1.0
    edges = np.linspace(most, -most, COLUMNS + 1)
    sheet = np.full((ROWS * TILE_PX[1], COLUMNS * TILE_PX[0], 3), 255, np.uint8)
    wanted: dict[int, list[tuple[int, int]]] = {}
    for column in range(COLUMNS):
        inside = np.flatnonzero((angles <= edges[column]) & (angles >= edges[column + 1]))
        chosen = inside[np.linspace(0, len(inside) - 1, min(ROWS, len(inside))).astype(int)]
        for line, number in enumerate(chosen.tolist()):
            wanted.setdefault(number, []).append((line, column))
    for number in sorted(wanted):  # in the order of the index, for videos
        image = dataset.image(used[number])
        scale = min(TILE_PX[0] / image.shape[1], TILE_PX[1] / image.shape[0])
        size = int(image.shape[1] * scale), int(image.shape[0] * scale)
        small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        for line, column in wanted[number]:
            y, x = line * TILE_PX[1], column * TILE_PX[0]
            sheet[y : y + size[1], x : x + size[0]] = small
    return sheet, [f"{a:+z.0f}° to {b:+z.0f}°" for a, b in pairwise(edges)]
