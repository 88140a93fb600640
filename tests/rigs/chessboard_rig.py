"""Drawn images of a chessboard from a known camera."""

import cv2
import numpy as np

CORNERS = (7, 5)
SIZE_PX = (480, 360)
MATRIX = np.array([[430.0, 0, 251.0], [0, 424.0, 172.0], [0, 0, 1]])
DISTORTION = np.array([-0.22, 0.06, 0.0, 0.0, 0.0])
FINER = 2
POSES = [
    ((0.0, 0.0, 0.0), (-3.5, -2.5, 9.0)),
    ((0.5, 0.0, 0.1), (-5.5, -3.5, 10.0)),
    ((-0.5, 0.1, 0.0), (-2.0, -2.0, 11.0)),
    ((0.0, 0.5, -0.1), (-5.5, -1.0, 10.0)),
    ((0.0, -0.5, 0.2), (-1.5, -1.0, 11.0)),
    ((0.3, 0.4, 0.5), (-2.5, -3.0, 11.0)),
    ((-0.4, -0.3, -0.4), (-4.0, -1.5, 12.0)),
    ((0.2, -0.4, 1.3), (1.5, -3.5, 11.0)),
]


def draw_board(turn: tuple[float, float, float], place: tuple[float, float, float]) -> np.ndarray:
    """The board at a pose, through the lens, oversampled by ``FINER``."""
    width, height = SIZE_PX
    u, v = np.meshgrid(np.arange(FINER * width), np.arange(FINER * height))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1) / FINER - (1 - 1 / FINER) / 2
    rays = cv2.undistortPoints(pixels[:, None, :], MATRIX, DISTORTION)[:, 0]
    rotation, _ = cv2.Rodrigues(np.array(turn))
    homography = np.column_stack([rotation[:, 0], rotation[:, 1], np.array(place)])
    x, y, w = np.linalg.solve(homography, np.column_stack([rays, np.ones(len(rays))]).T)
    x, y = x / w + 1, y / w + 1  # the first inner corner is (1, 1) squares from the border of the pattern
    columns, rows = CORNERS[0] + 1, CORNERS[1] + 1
    on = (x > 0) & (x < columns) & (y > 0) & (y < rows)
    dark = on & ((np.floor(x) + np.floor(y)) % 2 == 0)
    fine = np.where(dark, 30, 225).astype(np.uint8).reshape(FINER * height, FINER * width)
    return cv2.cvtColor(cv2.resize(fine, SIZE_PX, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
