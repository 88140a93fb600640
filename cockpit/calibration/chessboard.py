"""Intrinsics and lens distortion of a camera from images of a chessboard.

Zhang, A Flexible New Technique for Camera Calibration, IEEE PAMI 22(11), 2000; corners as Duda and Frese,
Accurate Detection and Localization of Checkerboard Corners for Calibration, BMVC 2018, both through OpenCV.
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from perception.camera.grey import grey
from trepid.config import InputError
from trepid.types import Array, Image

MIN_BOARDS = 6  # three suffice for exact corners; more reduce the effect of a bad one
MIN_TILT_RAD = math.radians(10)  # between two boards; parallel ones leave the focal length open (section 4)
MIN_COVER = 0.25  # share of the image with corners; elsewhere the distortion is extrapolated
MAX_FOCAL_SIGMA = 0.01  # standard deviation of the focal length over itself
OUTLIER, OUTLIER_PX = (
    3.0,
    1.0,
)  # least rms of the corners of an outlier: over the median of the boards; in pixels
SIGNIFICANT = 2.0  # standard deviations of a distortion term from 0
CELLS = 8  # along each side of the image, to measure the cover


@dataclass(frozen=True)
class Intrinsics:
    """A calibrated lens, and how well the boards determine it."""

    size_px: tuple[int, int]  # width, height
    matrix: Array  # K, shape (3, 3)
    distortion: Array  # k1 k2 p1 p2 k3; 0 for terms that were not estimated
    reprojection_px: float  # root mean square over all corners
    doubts: Array  # standard deviations of fx fy cx cy k1 k2 p1 p2 k3
    board_rms_px: Mapping[str, float]  # by the names of the images used
    normals: Array  # of the boards, shape (n, 3)
    cover: float  # share of the image with corners
    left_out: Mapping[str, str]  # reason by the name of each image that was not used

    @property
    def boards(self) -> tuple[str, ...]:
        """Names of the images used."""
        return tuple(self.board_rms_px)

    @property
    def focal_doubt(self) -> float:
        """Relative standard deviation of the focal length."""
        return float(max(self.doubts[0] / self.matrix[0, 0], self.doubts[1] / self.matrix[1, 1]))

    def outliers(self) -> dict[str, float]:
        """Rms error of the corners [px] of the boards that fit much worse than the others."""
        limit_px = max(OUTLIER * float(np.median(list(self.board_rms_px.values()))), OUTLIER_PX)
        return {name: error for name, error in self.board_rms_px.items() if error > limit_px}

    def check(self) -> None:
        """Raises InputError when the boards do not determine the camera."""
        cosines = np.clip(self.normals @ self.normals.T, -1, 1)
        tilt_rad = float(np.arccos(np.abs(cosines)).max())
        if tilt_rad < MIN_TILT_RAD:
            most, least = np.degrees(tilt_rad), np.degrees(MIN_TILT_RAD)
            raise InputError(
                f"the boards are too alike: tilted by {most:.1f}° at most, {least:.0f}° expected"
            )
        if self.cover < MIN_COVER:
            raise InputError(
                f"the boards cover {100 * self.cover:.0f} % of the image, {100 * MIN_COVER:.0f} % expected:"
                " hold the board near its borders too"
            )
        if self.focal_doubt > MAX_FOCAL_SIGMA:
            raise InputError(
                f"the boards are too alike: the focal length is uncertain by {100 * self.focal_doubt:.1f} %,"
                f" {100 * MAX_FOCAL_SIGMA:.0f} % allowed; tilt the board more, or take more pictures"
            )


def intrinsics(pictures: Mapping[str, Image], corners: tuple[int, int]) -> Intrinsics:
    """The lens that took ``pictures`` of a board with ``corners`` inner corners (columns, rows).

    Raises InputError with the reason: too few boards, too similar boards, too little of the image covered.
    """
    found, left_out = _boards(pictures, corners)
    _enough(found, left_out, corners)
    size_px = _size(next(iter(pictures[name] for name in found)))
    lens = _fit(found, corners, size_px)
    bad = lens.outliers()
    if bad:
        left_out |= {name: f"its corners are {error:.1f} px off" for name, error in bad.items()}
        found = {name: points for name, points in found.items() if name not in bad}
        _enough(found, left_out, corners)
        lens = _fit(found, corners, size_px)
    lens.check()
    return replace(lens, left_out=left_out)


def _boards(
    pictures: Mapping[str, Image], corners: tuple[int, int]
) -> tuple[dict[str, Array], dict[str, str]]:
    """Corners, shape (n, 2), by the name of the image, and the reason for each image left out."""
    usual = Counter(_size(image) for image in pictures.values()).most_common(1)
    found: dict[str, Array] = {}
    left_out: dict[str, str] = {}
    for name, image in pictures.items():
        if _size(image) != usual[0][0]:
            left_out[name] = "of {} x {} px, the others of {} x {}".format(*_size(image), *usual[0][0])
            continue
        seen, points = cv2.findChessboardCornersSB(grey(image), corners, flags=cv2.CALIB_CB_ACCURACY)
        if seen:
            found[name] = np.asarray(points, np.float64).reshape(-1, 2)
        else:
            left_out[name] = "no board of {} x {} inner corners".format(*corners)
    return found, left_out


def _enough(found: Mapping[str, Array], left_out: Mapping[str, str], corners: tuple[int, int]) -> None:
    if len(found) >= MIN_BOARDS:
        return
    why = f"; {next(iter(left_out))}: {next(iter(left_out.values()))}" if left_out else ""
    board = "{} x {}".format(*corners)
    raise InputError(
        f"{len(found)} usable pictures of a board with {board} inner corners, {MIN_BOARDS} expected{why}"
    )


def _fit(found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int]) -> Intrinsics:
    """Zhang's calibration, without distortion terms that are not significant."""
    terms = ((cv2.CALIB_FIX_K3, (8,)), (cv2.CALIB_ZERO_TANGENT_DIST, (6, 7)), (cv2.CALIB_FIX_K2, (5,)))
    flags, fit = 0, _fit_lens(found, corners, size_px, 0)
    for flag, places in terms:
        values = np.concatenate([fit.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], fit.distortion])
        if all(abs(values[place]) < SIGNIFICANT * fit.doubts[place] for place in places):
            flags |= flag
            fit = _fit_lens(found, corners, size_px, flags)
    return fit


def _fit_lens(
    found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int], flags: int
) -> Intrinsics:
    columns, rows = corners
    board = np.zeros((columns * rows, 3), np.float32)
    board[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2)  # in squares
    points = [np.asarray(seen, np.float32) for seen in found.values()]
    rms, matrix, distortion, turns, _, doubts, _, errors = cv2.calibrateCameraExtended(
        [board] * len(points), points, size_px, np.eye(3), np.zeros(5), flags=flags
    )
    cells = np.unique(np.floor(np.concatenate(points) / size_px * CELLS).astype(int), axis=0)
    return Intrinsics(
        size_px=size_px,
        matrix=np.asarray(matrix, np.float64),
        distortion=np.asarray(distortion, np.float64).ravel()[:5],
        reprojection_px=float(rms),
        doubts=np.asarray(doubts, np.float64).ravel()[:9],
        board_rms_px=dict(zip(found, np.asarray(errors, float).ravel().tolist(), strict=True)),
        normals=np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns]),
        cover=len(cells) / CELLS**2,
        left_out={},
    )


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]
