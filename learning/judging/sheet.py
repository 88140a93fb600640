"""The worst frames of a model as one picture, with what they rest on.

Saliency by occlusion (Zeiler and Fergus, Visualizing and Understanding Convolutional Networks, 2014): each cell of
a grid over the image in turn is replaced by the mean colour of the image, and the change of the angle is the weight
of the cell. It needs no gradient and no access to layers, and shows dependence, not a reason. A recurrent network
is occluded without its memory.
"""

import math
from collections.abc import Sequence

import cv2
import numpy as np

from learning.dataset.dataset import Dataset, Rows
from learning.judging.scores import Angles
from perception.net.driver import DriverNetwork
from trepid.types import Image

COLUMNS_OF_SHEET = 4
TILE_PX = (320, 240)
GRID = (8, 12)  # rows and columns of cells
RECORDED, PREDICTED = (120, 220, 60), (0, 140, 255)  # BGR: green, orange
DRAWN_RATIO = 2.0  # of the drawn lines to the angle: small angles stay visible


def occlusion(network: DriverNetwork, image: Image, grid: tuple[int, int] = GRID) -> Angles:
    """|Δangle| [rad] of each cell of ``grid`` (rows, columns) where it is replaced by the mean colour."""
    size = (network.record.width, network.record.height)
    small = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
    mean = small.reshape(-1, 3).mean(axis=0).astype(np.uint8)
    whole = network(small, network.initial_state).road_wheel_rad
    rows, columns = (
        np.linspace(0, n, cells + 1).astype(int) for n, cells in zip(size[::-1], grid, strict=True)
    )
    found = np.zeros(grid)
    for r, c in np.ndindex(grid):
        covered = small.copy()
        covered[rows[r] : rows[r + 1], columns[c] : columns[c + 1]] = mean
        found[r, c] = abs(network(covered, network.initial_state).road_wheel_rad - whole)
    return found


def draw_heat(image: Image, weights: Angles) -> Image:
    """``image`` with the weights of its cells as colours from blue (0) to red (the greatest)."""
    share = weights / max(float(weights.max()), 1e-12)
    wide = cv2.resize(share.astype(np.float32), image.shape[1::-1], interpolation=cv2.INTER_CUBIC)
    colours = cv2.applyColorMap((255 * np.clip(wide, 0, 1)).astype(np.uint8), cv2.COLORMAP_JET)
    return np.asarray(cv2.addWeighted(image, 0.55, colours, 0.45, 0.0), np.uint8)


def tile(image: Image, lines: Sequence[str], true_rad: float, predicted_rad: float) -> Image:
    """The frame with text, and recorded and predicted angle as directions from the bottom centre."""
    drawn = np.asarray(cv2.resize(image, TILE_PX, interpolation=cv2.INTER_AREA), np.uint8)
    for angle_rad, colour in ((true_rad, RECORDED), (predicted_rad, PREDICTED)):
        turn = float(np.clip(DRAWN_RATIO * angle_rad, -1.4, 1.4))
        end = (TILE_PX[0] / 2 - 90 * math.sin(turn), TILE_PX[1] - 90 * math.cos(turn))
        cv2.line(drawn, (TILE_PX[0] // 2, TILE_PX[1] - 1), tuple(map(round, end)), colour, 3, cv2.LINE_AA)
    drawn[: 18 * len(lines) + 6] //= 4
    for number, line in enumerate(lines):
        at = (6, 18 + 18 * number)
        cv2.putText(drawn, line, at, cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return drawn


def frames_sheet(
    dataset: Dataset,
    rows: Rows,
    true_deg: Angles,
    predicted_deg: Angles,
    predicted_rad: Angles,
    network: DriverNetwork | None,
) -> Image:
    """The frames of ``rows`` with rank and angles as one picture; of a network each with its occlusion below."""
    tiles: list[Image] = []
    for number, row in enumerate(rows):
        image = dataset.image(row)
        error_deg = predicted_deg[number] - true_deg[number]
        lines = [
            f"{number + 1}: {str(row['route'])[-30:]} frame {row['frame']}",
            f"recorded {true_deg[number]:+z.1f}, predicted {predicted_deg[number]:+z.1f}: {error_deg:+z.1f} deg",
        ]
        angles = float(row["road_wheel_rad"]), float(predicted_rad[number])
        one = tile(image, lines, *angles)
        if network is not None:
            plain = np.asarray(cv2.resize(image, TILE_PX, interpolation=cv2.INTER_AREA), np.uint8)
            one = np.vstack([one, draw_heat(plain, occlusion(network, image))])
        tiles.append(one)
    black = np.zeros_like(tiles[0])
    tiles += [black] * (-len(tiles) % COLUMNS_OF_SHEET)
    starts = range(0, len(tiles), COLUMNS_OF_SHEET)
    return np.vstack([np.hstack(tiles[start : start + COLUMNS_OF_SHEET]) for start in starts])
