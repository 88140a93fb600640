"""Intrinsics and lens distortion of a camera from images of a chessboard.

Zhang, A Flexible New Technique for Camera Calibration, IEEE PAMI 22(11), 2000; corners as Duda and Frese,
Accurate Detection and Localization of Checkerboard Corners for Calibration, BMVC 2018, both through OpenCV. A
fisheye is measured by the model of Kannala and Brandt, and stated as a camera file does
(:mod:`cockpit.calibration.fisheye`).
"""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

import cv2
import numpy as np

from cockpit.calibration.fisheye import FIT_PX, corner_radius, fit_quotient
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
REFINED_SHARE, REFINED_PX = 0.25, (2, 8)  # half of the window of a corner: of their distance; in pixels
CELLS = 8  # along each side of the image, to measure the cover


@dataclass(frozen=True)
class Intrinsics:
    """A calibrated lens, and how well the boards determine it."""

    size_px: tuple[int, int]  # width, height
    matrix: Array  # K, shape (3, 3)
    distortion: Array  # k1 k2 p1 p2 k3 k4 k5 k6, or the first five; 0 for terms that were not estimated
    reprojection_px: float  # root mean square over all corners
    doubts: Array  # standard deviations of fx fy cx cy and of the terms that were estimated
    board_rms_px: Mapping[str, float]  # by the names of the images used
    normals: Array  # of the boards, shape (n, 3)
    cover: float  # share of the image with corners
    left_out: Mapping[str, str]  # reason by the name of each image that was not used
    fisheye: Array | None = None  # k1 k2 k3 k4 of Kannala and Brandt; None: no fisheye

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


def intrinsics(
    pictures: Mapping[str, Image], corners: tuple[int, int], *, fisheye: bool = False
) -> Intrinsics:
    """The lens that took ``pictures`` of a board with ``corners`` inner corners (columns, rows).

    Raises InputError with the reason: too few boards, too similar boards, too little of the image covered.
    """
    found, left_out = _boards(pictures, corners, fisheye=fisheye)
    _enough(found, left_out, corners)
    size_px = _size(next(iter(pictures[name] for name in found)))
    fit = _fit_fisheye if fisheye else _fit
    lens = fit(found, corners, size_px)
    bad = lens.outliers()
    if bad:
        left_out |= {name: f"its corners are {error:.1f} px off" for name, error in bad.items()}
        found = {name: points for name, points in found.items() if name not in bad}
        _enough(found, left_out, corners)
        lens = fit(found, corners, size_px)
    lens.check()
    return replace(lens if lens.fisheye is None else _as_quotient(lens), left_out=left_out)


def _boards(
    pictures: Mapping[str, Image], corners: tuple[int, int], *, fisheye: bool
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
            places = np.asarray(points, np.float64).reshape(-1, 2)
            found[name] = _refine(grey(image), places) if fisheye else places
        else:
            left_out[name] = "no board of {} x {} inner corners".format(*corners)
    return found, left_out


def _refine(image: Image, points: Array) -> Array:
    """``points`` each at the saddle of grey around it: the detector takes the rows of a board for straight."""
    apart_px = np.linalg.norm(np.diff(points, axis=0), axis=1).min()
    reach = int(np.clip(REFINED_SHARE * apart_px, *REFINED_PX))
    wanted = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
    moved = cv2.cornerSubPix(image, points.astype(np.float32), (reach, reach), (-1, -1), wanted)
    return np.asarray(moved, np.float64).reshape(-1, 2)


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


FISHEYE_TERMS = (cv2.CALIB_FIX_K4, cv2.CALIB_FIX_K3, cv2.CALIB_FIX_K2, cv2.CALIB_FIX_K1)
"""That leave out the last term of a fisheye, the one before, …"""


def _fit_fisheye(
    found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int]
) -> Intrinsics:
    """The fisheye by Kannala and Brandt, without last terms that are not significant. Raises InputError."""
    fixed, fit = 0, _fit_fisheye_terms(found, corners, size_px, 0)
    for left_out, flag in enumerate(FISHEYE_TERMS):
        assert fit.fisheye is not None
        last = 3 - left_out
        if abs(fit.fisheye[last]) >= SIGNIFICANT * fit.doubts[4 + last]:
            break
        fixed |= flag
        fit = _fit_fisheye_terms(found, corners, size_px, fixed)
    return fit


def _fit_fisheye_terms(
    found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int], fixed: int
) -> Intrinsics:
    board = _board(corners).astype(np.float64)[None]
    seen = [np.asarray(points, np.float64)[None] for points in found.values()]
    flags = cv2.CALIB_RECOMPUTE_EXTRINSIC | cv2.CALIB_FIX_SKEW | fixed
    try:
        rms, found_matrix, found_terms, turns, places = cv2.fisheye.calibrate(
            [board] * len(seen), seen, size_px, np.eye(3), np.zeros(4), flags=flags
        )
    except cv2.error as error:
        raise InputError(
            f"the boards do not determine a fisheye; without --fisheye, or with other pictures? ({error.err})"
        ) from error
    matrix, terms = np.asarray(found_matrix, np.float64), np.asarray(found_terms, np.float64).ravel()
    free = [*range(4), *(4 + k for k in range(4) if not fixed & FISHEYE_TERMS[3 - k])]
    normal, squares = np.zeros((len(free), len(free))), 0.0
    board_rms: list[float] = []
    for points, turn, place in zip(seen, turns, places, strict=True):
        shown, jacobian = cv2.fisheye.projectPoints(board, turn, place, matrix, terms)
        error_px = shown.reshape(-1, 2) - points[0]
        squares += float((error_px**2).sum())
        board_rms.append(float(np.sqrt((error_px**2).sum(axis=1).mean())))
        lens, pose = jacobian[:, free], jacobian[:, 8:14]
        # The pose of each board is estimated too: Schur complement of its part of the normal equations.
        across = lens.T @ pose
        normal += lens.T @ lens - across @ np.linalg.solve(pose.T @ pose, across.T)
    spare = 2 * sum(points.shape[1] for points in seen) - len(free) - 6 * len(seen)
    doubts = np.zeros(8)
    doubts[free] = np.sqrt(squares / max(spare, 1) * np.diag(np.linalg.inv(normal)))
    cells = np.unique(np.floor(np.concatenate(seen, axis=1)[0] / size_px * CELLS).astype(int), axis=0)
    return Intrinsics(
        size_px=size_px,
        matrix=matrix,
        distortion=np.zeros(0),
        reprojection_px=float(rms),
        doubts=doubts,
        board_rms_px=dict(zip(found, board_rms, strict=True)),
        normals=np.array([cv2.Rodrigues(turn)[0][:, 2] for turn in turns]),
        cover=len(cells) / CELLS**2,
        left_out={},
        fisheye=terms,
    )


def _as_quotient(lens: Intrinsics) -> Intrinsics:
    """``lens`` with the distortion of a camera file. Raises InputError where none comes near enough."""
    assert lens.fisheye is not None
    distortion, error = fit_quotient(lens.fisheye.tolist(), corner_radius(lens.matrix, lens.size_px))
    if not error * lens.matrix[0, 0] <= FIT_PX:
        raise InputError(f"no lens of a camera file comes within {FIT_PX:g} px of this fisheye")
    return replace(lens, distortion=np.array(distortion))


def _board(corners: tuple[int, int]) -> Array:
    """The inner corners, shape (n, 3), in squares."""
    columns, rows = corners
    board = np.zeros((columns * rows, 3))
    board[:, :2] = np.mgrid[:columns, :rows].T.reshape(-1, 2)
    return board


def _fit_lens(
    found: Mapping[str, Array], corners: tuple[int, int], size_px: tuple[int, int], flags: int
) -> Intrinsics:
    board = _board(corners).astype(np.float32)
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
