"""The judge of the image: its statistics and the sight distance, one message for every frame.

Glare is not fog. The veil of a lamp or of the sun falls off with the angle from the source (CIE 146), while the
light of fog is that of the whole sky: in fog the sky is even, also where it is white.
"""

from dataclasses import replace

import numpy as np

from perception.camera.grey import small_grey
from perception.camera.image_statistics import ImageStatistician
from perception.lane.model.prediction import VehicleMotion
from perception.sight.observer import SightObserver
from perception.sight.settings import GlareSettings, SightSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.causes import Cause
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, ImageStatistics, SteeringEstimate, VehicleState
from trepid.scale import ReferenceWorld, scaled_settings
from trepid.types import Image

DARKEST = 10  # percentile of the sky: away from the source


def is_glare(image: Image, over_exposed: float, horizon: float, settings: GlareSettings) -> bool:
    """Whether a source of light stands in a darker sky.

    ``over_exposed``: share of white pixels; ``horizon``: share of the rows of ``image`` above the horizon. False
    where the image shows no sky.
    """
    if over_exposed < settings.least_source:
        return False
    grey = small_grey(image)
    sky = grey[: round(min(max(horizon, 0.0), 1.0) * len(grey)) : 2, ::2]
    return sky.size > 0 and float(np.percentile(sky, DARKEST)) < 255 * settings.darker_sky


class ImageJudge:
    """Image statistics with the sight distance of a camera on a car."""

    def __init__(
        self, settings: SightSettings, camera: Camera, scale: float, *, assumed: bool = False
    ) -> None:
        """``scale``: of the world of the car (:mod:`trepid.scale`), whose lengths ``camera`` has.

        ``assumed``: the camera is self-calibrated.
        """
        self._observer = SightObserver(settings, scaled_settings(camera, 1 / scale), assumed=assumed)
        self._reference, self._scale = ReferenceWorld(scale), scale
        self._glare, self._horizon = settings.glare, camera.horizon_row_px / camera.height_px
        self._statistician, self._height_m = ImageStatistician(self._horizon), camera.height_m

    def step(
        self, frame: Frame, lane: SteeringEstimate | None, state: VehicleState | None, *, now_s: float
    ) -> ImageStatistics:
        """The statistics of ``frame``; its sight is None where the image does not say how far it reaches.

        ``lane``: the newest estimate of the lane, of this frame in a live drive, of the frame before in lock-step;
        None: the ground straight ahead counts.
        """
        speed_mps = VehicleMotion.of(state).speed_mps
        speed_hps = None if speed_mps is None else speed_mps / self._height_m
        statistics = self._statistician.step(frame, now_s=now_s, speed_hps=speed_hps)
        enlarged = self._reference.enlarge
        sight = self._observer.step(frame, enlarged("lane", lane), enlarged("state", state))
        if sight is None:
            return statistics
        return replace(
            statistics,
            sight_m=sight.distance_m * self._scale,
            sight_sigma_m=sight.sigma_m * self._scale,
            sight_cause=self._cause(frame, statistics, sight.cause),
        )

    def _cause(self, frame: Frame, statistics: ImageStatistics, cause: str) -> str:
        """``cause``, where a source of light in the image veils it instead of the air: over-exposed."""
        veiled = cause == Cause.FOG and is_glare(
            frame.image, statistics.over_exposed, self._horizon, self._glare
        )
        return str(Cause.OVER_EXPOSED if veiled else cause)


def build(
    camera: Camera | None = None, vehicle: Vehicle | None = None, *, assumed: bool = False
) -> ImageJudge:
    """The judge for ``camera`` on ``vehicle``; None: those of the configuration. Raises InputError.

    ``assumed``: the camera is self-calibrated.
    """
    camera = camera or load(CONFIG_DIR / "camera.yaml", Camera)
    vehicle = vehicle or load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    return ImageJudge(load(CONFIG_DIR / "sight.yaml", SightSettings), camera, vehicle.scale, assumed=assumed)
