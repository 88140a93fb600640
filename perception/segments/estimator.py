"""The estimator ``segments``: the lane that the masks of a segmentation network show.

1. **Masks** of lane lines and drivable area of the frame (:mod:`.network`).
2. **Picture**: the masks drawn as a clean road (:mod:`.picture`).
3. **Lane**: the finder of ``cv`` reads the picture in place of the image. It decides which boundaries are those of
   the own lane, fits, tracks and rates them.
4. **Surface**: the lane is at most as sure as its surface is drivable. Where no lane is sure, a wide surface is
   named as a junction (:mod:`.picture`).
"""

from dataclasses import replace
from typing import Protocol

import numpy as np

from perception.lane.lane_cv import LaneCv
from perception.lane.model.paths import ROW_STEP_PX
from perception.lane.rating import Features
from perception.lane.settings import LaneCvSettings
from perception.lane.view import as_bgr, unusable
from perception.segments.network import Segmenter
from perception.segments.picture import draw_masks, drivable_share, surface_width
from perception.segments.settings import SegmentSettings, network_description, network_file, segment_settings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState

NAME = "segments"
ROAD_M = 10.0  # of four lanes in a town
NO_SURFACE = "the network does not call its surface drivable"
JUNCTION = "the drivable surface is {:.0f} m wide ahead, as at a junction"


class LaneFinder(Protocol):
    """Measures the lane in a picture of the masks. Its only state comes from earlier steps."""

    @property
    def camera(self) -> Camera | None:
        """Of the pictures; None before the first one where it is not known."""
        ...

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in the picture of ``frame``."""
        ...


class Segments:
    """Estimator ``segments``. Its state is that of the lane finder."""

    def __init__(self, segmenter: Segmenter, finder: LaneFinder, *, lookahead_m: float) -> None:
        self._segmenter, self._finder, self._lookahead_m = segmenter, finder, lookahead_m

    @property
    def features(self) -> Features | None:
        """Those of the last confidence; None without a lane, or without a camera file."""
        return self._finder.features if isinstance(self._finder, LaneCv) else None

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; ``state`` gives the motion since the last frame."""
        if problem := unusable(frame.image):
            return self._nothing(frame, problem)
        image = as_bgr(frame.image)
        masks = self._segmenter(image)
        if not masks.finite:
            return self._nothing(frame, "the network's output is not finite")
        picture = draw_masks(masks)
        found = self._finder.step(replace(frame, image=picture), state, now_s=now_s)
        scale = image.shape[1] / picture.shape[1]
        paths = found.left_boundary_px, found.right_boundary_px
        share = 1.0 if masks.area is None else drivable_share(masks.area, *paths)
        confidence = min(found.confidence, share)
        reason = found.reason or (NO_SURFACE if share < 1 / 2 else "")
        if confidence < 1 / 2 and masks.area is not None and self._finder.camera is not None:
            wide_m = surface_width(masks.area, self._finder.camera)
            if wide_m > ROAD_M:
                reason = "; ".join(filter(None, (JUNCTION.format(wide_m), reason)))
        return replace(
            found,
            estimator=NAME,
            confidence=confidence,
            reason=reason,
            left_boundary_px=_path_in_image(paths[0], scale),
            right_boundary_px=_path_in_image(paths[1], scale),
        )

    def _nothing(self, frame: Frame, reason: str) -> SteeringEstimate:
        return SteeringEstimate.nothing(
            frame.t_s, estimator=NAME, lookahead_m=self._lookahead_m, reason=reason
        )


def _path_in_image(path: PixelPath, scale: float) -> PixelPath:
    """Places in the picture as places in the image, ``scale`` times as wide: every ten rows, from the bottom up."""
    if not path:
        return ()
    x_px, y_px = (np.array(path[::-1]).T + 0.5) * scale - 0.5
    rows = np.arange(y_px[-1] // ROW_STEP_PX * ROW_STEP_PX, y_px[0], -ROW_STEP_PX)
    return tuple(zip(np.interp(rows, y_px, x_px).tolist(), rows.tolist(), strict=True))


def segmenter_of(settings: SegmentSettings) -> Segmenter:
    """The network that ``settings`` choose. Raises InputError."""
    return Segmenter(network_file(settings), network_description(settings.network))


def build(camera: Camera, vehicle: Vehicle, lane_cv: LaneCvSettings) -> Segments:
    """The estimator for ``camera``. Raises InputError."""
    own = segment_settings()
    settings = lane_cv.model_copy(update={"confidence": own.confidence, "drawn_step_px": 1})
    finder = LaneCv(settings, camera, vehicle)
    return Segments(segmenter_of(own), finder, lookahead_m=lane_cv.steering.lookahead_m)
