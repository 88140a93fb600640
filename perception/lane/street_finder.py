"""The lane of the car in a street: profile, pairs of boundaries, and a fit to the chosen pair."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from perception.lane.detection.fitter import LaneFitter
from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import KAPPA, PSI, LaneState, RoadPoints, parallel_curve
from perception.lane.settings import LaneCvSettings
from perception.lane.street.pairs import Boundary, BoundaryKind, Pair, boundaries, pairs
from perception.lane.street.profile import LevelImage, Profile, StreetCourse, StreetView
from perception.lane.view import make_view
from trepid.car.camera import Camera
from trepid.types import Array, Image

SPARE = 1.3  # height of the level image over that of the image, so that a low horizon cuts nothing off


@dataclass(frozen=True)
class StreetLane:
    """The most probable lane of a street."""

    pair: Pair
    rest: tuple[Pair, ...]  # the other pairs, the most probable first
    profile: Profile
    fit: LaneFit
    camera: Camera  # of the image, level, at the height of the belief


@lru_cache(maxsize=4)
def street_view(settings: LaneCvSettings, camera: Camera) -> StreetView | None:
    """The tables for images from a camera like ``camera``; None when the image shows no road."""
    width_px = settings.working_width_px
    scale = width_px / camera.width_px
    height_px = round(SPARE * camera.height_px * scale)
    level = camera.model_copy(
        update=dict(
            width_px=width_px, height_px=height_px, fx_px=camera.fx_px * scale, fy_px=camera.fy_px * scale,
            cx_px=(camera.cx_px + 0.5) * scale - 0.5, cy_px=(height_px - 1) / 2, pitch_down_rad=0.0,
        )
    )  # fmt: skip
    view = make_view(settings, level)
    return None if view is None else StreetView(settings.street.search, view.grid, view.markings)


def horizon_of(camera: Camera) -> float:
    """Row of the horizon straight ahead, in widths of the image."""
    return camera.horizon_row_px / camera.width_px


def street_lane(
    image: Image,
    camera: Camera,
    settings: LaneCvSettings,
    *,
    height_sigma: float,
    on_left: float = 0.5,
    near: StreetCourse | None = None,
    before: Sequence[Pair] = (),
) -> StreetLane | None:
    """The lane of the car in ``image`` from ``camera``, whose height is the median of the belief; None without one.

    ``near``: the course of the frame before; the other arguments: see
    :func:`perception.lane.street.pairs.pairs`.
    """
    level = camera.model_copy(update={"pitch_down_rad": 0.0, "cy_px": (camera.height_px - 1) / 2})
    view = street_view(settings, level)
    if view is None:
        return None
    size = settings.working_width_px, round(camera.height_px * settings.working_width_px / camera.width_px)
    if image.shape[1::-1] != size:
        image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
    profile, levelled = view.profile(image, horizon_of(camera), near)
    found = boundaries(profile, settings.street.pairs)
    ranked = pairs(
        profile, found, settings.street.pairs, height_sigma=height_sigma, on_left=on_left, before=before
    )
    if not ranked:
        return None
    fit = _fit_lane(view, levelled, profile.course, ranked[0], settings)
    seen = camera.model_copy(
        update={"pitch_down_rad": 0.0, "cy_px": profile.course.horizon * camera.width_px}
    )
    return StreetLane(ranked[0], tuple(ranked[1:]), profile, fit, seen)


def _fit_lane(
    view: StreetView, levelled: LevelImage, course: StreetCourse, pair: Pair, settings: LaneCvSettings
) -> LaneFit:
    """The lane fitted to the paint and the steps near the boundaries of ``pair``."""
    start = np.array([pair.offset_m, course.heading_rad, course.curvature_1pm, 0.0, pair.width_m, 0.0])
    mean = np.array([0.0, 0.0, 0.0, 0.0, pair.width_m, 0.0])
    loose = LaneState(mean=mean, covariance=settings.prior.lane.covariance)
    both = [_near(view, levelled, start, one) for one in (pair.left, pair.right)]
    points = RoadPoints._make(np.concatenate(columns) for columns in zip(*both, strict=True))
    side = np.concatenate(
        [np.full(len(near.x_m), sign) for near, sign in zip(both, (1.0, -1.0), strict=True)]
    )
    fitter = LaneFitter(view.grid, settings.fit, settings.evidence)
    fitted = fitter.solve(points, side, loose, start, None)
    return fitter.with_evidence(fitted, points, side, count=len(levelled.points.x_m))


def _near(view: StreetView, levelled: LevelImage, lane: Array, boundary: Boundary) -> RoadPoints:
    """Points of ``boundary`` near its curve, far to near."""
    gate = view.settings.gate_m
    if boundary.kind == BoundaryKind.MIDDLE:
        return levelled.points.part(np.empty(0, int))
    if boundary.kind == BoundaryKind.LINE:
        points = levelled.points
        y_m = parallel_curve(points.x_m, lane[PSI], lane[KAPPA], np.array(boundary.left_m))
        return points.part(
            np.flatnonzero(np.abs(points.y_m - y_m) < gate + view.settings.gate_growth * points.x_m)
        )
    return view.step_points(levelled, lane, boundary.left_m)
