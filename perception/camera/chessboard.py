"""Intrinsics and lens distortion of a camera from pictures of a chessboard.

Zhang, A Flexible New Technique for Camera Calibration, IEEE PAMI 22(11), 2000; corners as Duda and Frese, Accurate
Detection and Localization of Checkerboard Corners for Calibration, BMVC 2018, both through OpenCV.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from trepid.config import InputError
from trepid.types import Array, Image

LEAST_BOARDS = 6  # three suffice for exact corners; each further one halves what one bad board can do
LEAST_TILT_RAD = np.radians(
    10.0
)  # between two boards: parallel ones say nothing about the focal length (section 4)
LEAST_COVER = 0.25  # share of the picture: where no corner was, distortion is a guess
MOST_FOCAL_DOUBT = 0.01  # standard deviation of the focal length over itself
OUTLIER, OUTLIER_PX = (
    3.0,
    1.0,
)  # a board whose corners fit worse than the median of the boards, and than a pixel
SURE = 2.0  # standard deviations that a term of the distortion must be from nothing
CELLS = 8  # into which the picture is divided, along each side, to see what is covered


@dataclass(frozen=True)
class Intrinsics:
    """What the boards say of a camera."""

    size_px: tuple[int, int]  # width, height
    matrix: Array  # K, shape (3, 3)
    distortion: tuple[float, ...]  # k1 k2 p1 p2 k3; terms that are not there are 0
    reprojection_px: float  # root mean square over all corners
    focal_doubt: float  # standard deviation of f over f
    cover: float  # share of the picture with corners
    boards: tuple[str, ...]  # names of the pictures used
    left_out: Mapping[str, str]  # name of a picture and why it is not used


def intrinsics(pictures: Mapping[str, Image], corners: tuple[int, int]) -> Intrinsics:
    """The camera that took ``pictures`` of a board with ``corners`` inner corners (columns, rows).

    Raises InputError that says what is missing: too few boards, all alike, too little of the picture covered.
    """
    found, left_out = _boards(pictures, corners)
    _enough(found, left_out, corners)
    size_px = _size(next(iter(pictures[name] for name in found)))
    fit = _fit(found, corners, size_px)
    bad = fit.outliers()
    if bad:
        left_out |= {name: f"its corners are {error:.1f} px off" for name, error in bad.items()}
        found = {name: points for name, points in found.items() if name not in bad}
        _enough(found, left_out, corners)
        fit = _fit(found, corners, size_px)
    fit.check()
    return Intrinsics(
        size_px=size_px,
        matrix=fit.matrix,
        distortion=tuple(float(value) for value in fit.distortion),
        reprojection_px=fit.rms_px,
        focal_doubt=fit.focal_doubt,
        cover=fit.cover,
        boards=tuple(found),
        left_out=left_out,
    )


def _boards(
    pictures: Mapping[str, Image], corners: tuple[int, int]
) -> tuple[dict[str, Array], dict[str, str]]:
    """Corners, shape (n, 2), by the name of the picture, and why the others are left out."""
    usual = Counter(_size(image) for image in pictures.values()).most_common(1)
    found: dict[str, Array] = {}
    left_out: dict[str, str] = {}
    for name, image in pictures.items():
        if _size(image) != usual[0][0]:
            left_out[name] = "of {} x {} px, the others of {} x {}".format(*_size(image), *usual[0][0])
            continue
        seen, points = cv2.findChessboardCornersSB(_grey(image), corners, flags=cv2.CALIB_CB_ACCURACY)
        if seen:
            found[name] = np.asarray(points, np.float64).reshape(-1, 2)
        else:
            left_out[name] = "no board of {} x {} inner corners".format(*corners)
    return found, left_out


def _enough(found: Mapping[str, Array], left_out: Mapping[str, str], corners: tuple[int, int]) -> None:
    if len(found) >= LEAST_BOARDS:
        return
    why = f"; {next(iter(left_out))}: {next(iter(left_out.values()))}" if left_out else ""
    board = "{} x {}".format(*corners)
    raise InputError(
        f"{len(found)} usable pictures of a board with {board} inner corners, {LEAST_BOARDS} expected{why}"
    )


@dataclass(frozen=True)
class _Fit:
    """A calibration and what speaks for it."""

    matrix: Array
    distortion: Array  # (5,)
    rms_px: float
    doubts: Array  # standard deviations of fx fy cx cy k1 k2 p1 p2 k3
    board_rms_px: Mapping[str, float]
    normals: Array  # of the boards, shape (n, 3)
    cover: float

    @property
    def focal_doubt(self) -> float:
        """Standard deviation of f over f."""
        return float(max(self.doubts[0] / self.matrix[0, 0], self.doubts[1] / self.matrix[1, 1]))

    def outliers(self) -> dict[str, float]:
        """Boards that fit much worse than the others, and how far their corners are off [px]."""
        limit_px = max(OUTLIER * float(np.median(list(self.board_rms_px.values()))), OUTLIER_PX)
        return {name: error for name, error in self.board_rms_px.items() if error > limit_px}

    def check(self) -> None:
        """Raises InputError when the boards are too alike to tell the camera."""
        cosines = np.clip(self.normals @ self.normals.T, -1, 1)
        tilt_rad = float(np.arccos(np.abs(cosines)).max())
        if tilt_rad < LEAST_TILT_RAD:
            most, least = np.degrees(tilt_rad), np.degrees(LEAST_TILT_RAD)
            raise InputError(
                f"the boards are too alike: tilted by {most:.1f}° at most, {least:.0f}° expected"
            )
        if self.cover < LEAST_COVER:
            raise InputError(
                f"the boards cover {100 * self.cover:.0f} % of the picture, {100 * LEAST_COVER:.0f} % expected:"
                " hold the board near its borders too"
            )
        if self.focal_doubt > MOST_FOCAL_DOUBT:
            raise InputError(
                f"the boards are too alike: they leave a doubt of {100 * self.focal_doubt:.1f} % in the focal"
                f" length, {100 * MOST_FOCAL_DOUBT:.0f} % allowed; tilt the board more, or take more pictures"
            )


def _fit(found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int]) -> _Fit:
    """Zhang's calibration, without the terms of the distortion that the boards do not show."""
    terms = (
        (cv2.CALIB_FIX_K3, (8,)),
        (cv2.CALIB_ZERO_TANGENT_DIST, (6, 7)),
        (cv2.CALIB_FIX_K2, (5,)),
    )
    flags, fit = 0, _fitted(found, corners, size_px, 0)
    for flag, places in terms:
        values = np.concatenate([fit.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], fit.distortion])
        if all(abs(values[place]) < SURE * fit.doubts[place] for place in places):
            flags |= flag
            fit = _fitted(found, corners, size_px, flags)
    return fit


def _fitted(
    found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int], flags: int
) -> _Fit:
    columns, rows = corners
    board = np.zeros((columns * rows, 3), np.float32)
    board[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2)  # in squares: their size does not matter here
    points = [np.asarray(seen, np.float32) for seen in found.values()]
    rms, matrix, distortion, turns, _, doubts, _, errors = cv2.calibrateCameraExtended(
        [board] * len(points), points, size_px, np.eye(3), np.zeros(5), flags=flags
    )
    cells = np.unique(np.floor(np.concatenate(points) / size_px * CELLS).astype(int), axis=0)
    return _Fit(
        matrix=np.asarray(matrix, np.float64),
        distortion=np.asarray(distortion, np.float64).ravel()[:5],
        rms_px=float(rms),
        doubts=np.asarray(doubts, np.float64).ravel()[:9],
        board_rms_px=dict(zip(found, np.asarray(errors, float).ravel().tolist(), strict=True)),
        normals=np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns]),
        cover=len(cells) / CELLS**2,
    )


def _size(image: Image) -> tuple[int, int]:
    return image.shape[1], image.shape[0]


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)
