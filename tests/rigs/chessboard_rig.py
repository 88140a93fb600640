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
FISHEYE_MATRIX = np.array([[232.0, 0, 243.0], [0, 229.0, 177.0], [0, 0, 1]])
FISHEYE = np.array([0.03, -0.012, 0.004, -0.001])  # of Kannala and Brandt: 74° in the corners
FISHEYE_POSES = [
    ((-0.58, -0.37, 0.36), (-2.17, -2.84, 6.6)),
    ((-0.1, -0.31, 0.29), (2.0, -2.78, 5.45)),
    ((0.28, 0.14, 0.45), (-4.8, -3.06, 3.81)),
    ((0.39, -0.14, 0.14), (-2.63, -0.09, 3.17)),
    ((-0.64, 0.1, -0.22), (-3.26, -3.5, 6.94)),
    ((0.06, -0.02, -0.01), (0.43, 0.03, 5.31)),
    ((0.26, 0.16, -0.08), (-6.82, 0.38, 5.88)),
    ((0.01, -0.3, -0.5), (0.03, -2.38, 4.58)),
    ((-0.24, 0.18, 0.34), (-5.66, -4.83, 6.76)),
    ((0.77, -0.16, 0.51), (0.23, -1.15, 4.6)),
]


def draw_board(
    turn: tuple[float, float, float], place: tuple[float, float, float], *, fisheye: bool = False
) -> np.ndarray:
    """The board at a pose, through the lens, oversampled by ``FINER``."""
    width, height = SIZE_PX
    u, v = np.meshgrid(np.arange(FINER * width), np.arange(FINER * height))
    pixels = np.stack([u.ravel(), v.ravel()], axis=1) / FINER - (1 - 1 / FINER) / 2
    if fisheye:
        rays = cv2.fisheye.undistortPoints(pixels[:, None, :], FISHEYE_MATRIX, FISHEYE)[:, 0]
    else:
        rays = cv2.undistortPoints(pixels[:, None, :], MATRIX, DISTORTION)[:, 0]
    rotation, _ = cv2.Rodrigues(np.array(turn))
    homography = np.column_stack([rotation[:, 0], rotation[:, 1], np.array(place)])
    x, y, w = np.linalg.solve(homography, np.column_stack([rays, np.ones(len(rays))]).T)
    x, y = x / w + 1, y / w + 1  # the first inner corner is (1, 1) squares from the border of the pattern
    columns, rows = CORNERS[0] + 1, CORNERS[1] + 1
    on = (w > 0) & (x > 0) & (x < columns) & (y > 0) & (y < rows)
    dark = on & ((np.floor(x) + np.floor(y)) % 2 == 0)
    fine = np.where(dark, 30, 225).astype(np.uint8).reshape(FINER * height, FINER * width)
    return cv2.cvtColor(cv2.resize(fine, SIZE_PX, interpolation=cv2.INTER_AREA), cv2.COLOR_GRAY2BGR)
