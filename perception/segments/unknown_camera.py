"""The lane in pictures of masks from a camera without a camera file."""

from perception.camera.odometry import StateOdometry
from perception.camera.self_calibration import Horizon, typical_camera
from perception.lane.settings import LaneCvSettings
from perception.lane.which_lane import WhichLane
from perception.segments.estimator import Segments, segmenter_of
from perception.segments.settings import lane_settings, segment_settings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Image

MATERIAL = 0.01  # change of the horizon, in widths of the image, with which the search begins anew


class LaneOfPictures:
    """The lane in pictures of an unknown camera, whose horizon is that of the lines in all of them so far.

    The masks leave nothing but the road, so that its lines, and not those of houses, point to the horizon.
    """

    def __init__(self, settings: LaneCvSettings, vehicle: Vehicle) -> None:
        self._settings, self._vehicle = settings, vehicle
        self._horizon = Horizon(settings.self_calibration)
        self.camera: Camera | None = None  # as known so far
        self._finder: WhichLane | None = None

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The more probable lane of both finders of :class:`WhichLane`."""
        return self._finder_of(frame.image).step(frame, state, now_s=now_s)

    def _finder_of(self, picture: Image) -> WhichLane:
        """The finder for the camera of all pictures so far."""
        height_px, width_px = picture.shape[:2]
        horizon = self._horizon.update(picture)
        camera = typical_camera(width_px, height_px, horizon, self._settings.self_calibration)
        if self._finder is None or _differs(camera, self.camera):
            self.camera = camera
            self._finder = WhichLane(self._settings, camera, self._vehicle, StateOdometry.NONE, bonnet=False)
        return self._finder


def _differs(one: Camera, other: Camera | None) -> bool:
    return other is None or abs(one.horizon_row_px - other.horizon_row_px) > MATERIAL * one.width_px


def build(vehicle: Vehicle, lane_cv: LaneCvSettings) -> Segments:
    """The estimator ``segments`` without a camera file. Raises InputError."""
    own = segment_settings()
    finder = LaneOfPictures(lane_settings(lane_cv, own), vehicle)
    return Segments(segmenter_of(own), finder, lookahead_m=lane_cv.steering.lookahead_m)
