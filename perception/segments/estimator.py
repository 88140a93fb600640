"""The estimator ``segments``: the lane that the masks of a segmentation network show.

1. **Masks** of lane lines and drivable area of the frame (:mod:`.network`).
2. **Picture**: the masks drawn as a clean road (:mod:`.picture`).
3. **Lane**: the finder of ``cv`` reads the picture in place of the image. It decides which boundaries are those of
   the own lane, fits, tracks and rates them.
"""

from dataclasses import replace

from perception.camera.odometry import Odometry
from perception.camera.self_calibration import CALIBRATION_FRAMES, self_calibrated
from perception.lane.lane_cv import LaneCv
from perception.lane.rating import Features
from perception.lane.settings import LaneCvSettings
from perception.lane.view import as_bgr, unusable
from perception.lane.which_lane import WhichLane
from perception.segments.network import Segmenter
from perception.segments.picture import drawn
from perception.segments.settings import SegmentSettings, described, network_file, segment_settings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState
from trepid.types import Image

NAME = "segments"
MATERIAL = 0.01  # change of the horizon, in widths of the image, with which the search begins anew


class Segments:
    """Estimator ``segments``. Its state is that of the lane finder."""

    def __init__(
        self, segmenter: Segmenter, finder: "LaneCv | LaneOfPictures", *, lookahead_m: float
    ) -> None:
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
        picture = drawn(masks)
        found = self._finder.step(replace(frame, image=picture), state, now_s=now_s)
        scale = image.shape[1] / picture.shape[1]
        return replace(
            found,
            estimator=NAME,
            left_boundary_px=_enlarged(found.left_boundary_px, scale),
            right_boundary_px=_enlarged(found.right_boundary_px, scale),
        )

    def _nothing(self, frame: Frame, reason: str) -> SteeringEstimate:
        return SteeringEstimate.nothing(
            frame.t_s, estimator=NAME, lookahead_m=self._lookahead_m, reason=reason
        )


class LaneOfPictures:
    """The lane in pictures of an unknown camera, whose horizon is that of the lines in the first of them.

    The masks leave nothing but the road, so that its lines, and not those of houses, point to the horizon.
    """

    def __init__(self, settings: LaneCvSettings, vehicle: Vehicle) -> None:
        self._settings, self._vehicle = settings, vehicle
        self._pictures: list[Image] = []
        self.camera: Camera | None = None  # as known so far
        self._finder: WhichLane | None = None

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The more probable lane of both finders of :class:`WhichLane`."""
        return self._finder_of(frame.image).step(frame, state, now_s=now_s)

    def _finder_of(self, picture: Image) -> WhichLane:
        """The finder for the camera of all pictures so far."""
        if self._finder is None or len(self._pictures) < CALIBRATION_FRAMES:
            self._pictures.append(picture)
            camera = self_calibrated(self._pictures, self._settings.self_calibration)
            if self._finder is None or _differs(camera, self.camera):
                self.camera = camera
                self._finder = WhichLane(self._settings, camera, self._vehicle, Odometry.NONE)
        return self._finder


def _enlarged(path: PixelPath, scale: float) -> PixelPath:
    """Places in the picture as places in the image, ``scale`` times as wide."""
    return tuple(((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5) for x, y in path)


def _differs(one: Camera, other: Camera | None) -> bool:
    return other is None or abs(one.horizon_row_px - other.horizon_row_px) > MATERIAL * one.width_px


def segmenter_of(settings: SegmentSettings) -> Segmenter:
    """The network that ``settings`` choose. Raises InputError."""
    return Segmenter(network_file(settings), described(settings.network))


def build(camera: Camera, vehicle: Vehicle, lane_cv: LaneCvSettings, *, assumed: bool = False) -> Segments:
    """The estimator for ``camera``; of an ``assumed`` one only the size is used. Raises InputError."""
    own = segment_settings()
    segmenter = segmenter_of(own)
    if assumed:
        finder: LaneCv | LaneOfPictures = LaneOfPictures(lane_cv, vehicle)
    else:
        finder = LaneCv(lane_cv.model_copy(update={"confidence": own.confidence}), camera, vehicle)
    return Segments(segmenter, finder, lookahead_m=lane_cv.steering.lookahead_m)
