"""The camera of an image: checks, conversion to the working image, and tables that depend on the camera alone."""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lane.detection.edges import RoadEdgeFinder, edge_grid
from perception.lane.detection.grid import LateralGrid, lateral_grid
from perception.lane.detection.points import MarkingFilter
from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.types import Image

MIN_SIZE_PX = 32  # smaller images are not processed
MIN_BANDS = 8  # rows of road


@dataclass(frozen=True)
class ViewTables:
    """Tables for images of one size from one camera."""

    camera: Camera  # of the input image
    undistort: tuple[cv2.typing.MatLike, cv2.typing.MatLike] | None  # maps for the working image
    grid: LateralGrid  # of the working image
    markings: MarkingFilter
    edges: RoadEdgeFinder

    def working_image(self, image: NDArray[np.uint8]) -> Image:
        """``image`` as BGR at working size, without lens distortion."""
        image, working = as_bgr(image), self.grid.camera
        if image.shape[1] != working.width_px:
            size = (working.width_px, working.height_px)
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        if self.undistort is not None:
            image = cv2.remap(image, *self.undistort, cv2.INTER_LINEAR).astype(np.uint8, copy=False)
        return image


@lru_cache(maxsize=8)
def make_view(settings: LaneCvSettings, camera: Camera) -> ViewTables | None:
    """The view of ``camera``, at most ``working_width_px`` wide; None when the image shows no road."""
    width_px = min(camera.width_px, settings.working_width_px)
    height_px = max(1, round(camera.height_px * width_px / camera.width_px))
    working = camera.resize(width_px, height_px)
    grid = lateral_grid(
        working, reach_m=settings.reach_m, band_m=settings.band_m, max_band_px=settings.max_band_px
    )
    edges = edge_grid(settings.edges, grid.camera)
    if len(grid.ahead_m) < MIN_BANDS or not len(edges.ahead_m):
        return None
    return ViewTables(
        camera=camera,
        undistort=undistortion_maps(working),
        grid=grid,
        markings=MarkingFilter(settings.markings, grid),
        edges=RoadEdgeFinder(settings.edges, edges),
    )


def unusable(image: NDArray[np.uint8]) -> str:
    """The reason why ``image`` cannot be processed; empty when it can."""
    channels = image.shape[2] if image.ndim == 3 else 1
    if image.dtype != np.uint8 or image.ndim not in (2, 3) or channels not in (1, 3, 4):
        return f"not an 8-bit image: {image.dtype} {image.shape}"
    return "image too small" if min(image.shape[:2]) < MIN_SIZE_PX else ""


def as_bgr(image: NDArray[np.uint8]) -> Image:
    """The image with three channels; grey and BGRA images are converted."""
    if image.ndim == 2 or image.shape[2] == 1:
        return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR).astype(np.uint8, copy=False)
    if image.shape[2] == 4:
        return cv2.cvtColor(image, cv2.COLOR_BGRA2BGR).astype(np.uint8, copy=False)
    return image


def undistortion_maps(working: Camera) -> tuple[cv2.typing.MatLike, cv2.typing.MatLike] | None:
    """Maps for :func:`cv2.remap` that take the lens distortion out of an image; None for a lens without any."""
    if not any(working.distortion):
        return None
    size = (working.width_px, working.height_px)
    return cv2.initUndistortRectifyMap(
        working.intrinsics, working.lens, np.eye(3), working.intrinsics, size, cv2.CV_16SC2
    )
