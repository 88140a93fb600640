"""The middle of a road with lines as the centre of a corridor, for closed paths of a single vehicle (V03).

The estimator `cv` looks for two boundaries at a known distance. With ``corridor: road`` in ``vehicle.yaml`` that is
the width of the road, and the boundaries are its outer lines or its edges; a line between them, such as the middle
line, is none. The corridor around the middle is as wide as a lane: supervisor, line warning and rules rate the
place of the car in it as in a lane.
"""

from dataclasses import replace

from perception.lane.lane_cv import LaneCv
from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, SteeringEstimate, VehicleState

WIDTH_SIGMA_M, EDGES_SIGMA_M = 0.3, 0.6  # of the measured width: between lines, and between ragged edges
SPREAD_M = 1.5  # a road of a lane more or less is another one


class RoadMiddle:
    """Estimator "cv" of the middle of a road: offset from the middle, width of the corridor."""

    def __init__(self, settings: LaneCvSettings, camera: Camera, vehicle: Vehicle) -> None:
        """``vehicle`` has a ``road_width_m``."""
        assert vehicle.road_width_m is not None
        self._inner = LaneCv(road_settings(settings, vehicle.road_width_m), camera, vehicle)
        self._beside_m = vehicle.road_width_m - vehicle.lane_width_m  # of the road, beside the corridor

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The road in ``frame``; the boundaries in the image are those of the road."""
        found = self._inner.step(frame, state, now_s=now_s)
        width_m = found.lane_width_m  # an unusual width of the road stays one of the corridor
        return found if width_m is None else replace(found, lane_width_m=width_m - self._beside_m)


def road_settings(settings: LaneCvSettings, width_m: float) -> LaneCvSettings:
    """``settings`` for boundaries that are ``width_m`` apart."""
    prior = settings.prior.model_copy(
        update={
            "width_m": width_m,
            "width_sigma_m": WIDTH_SIGMA_M,
            "road_width_m": width_m,
            "road_width_sigma_m": EDGES_SIGMA_M,
        }
    )
    evidence = settings.evidence.model_copy(
        update={
            "road_width_m": width_m,
            "road_width_sigma_m": EDGES_SIGMA_M,
            "min_width_m": width_m - SPREAD_M,
        }
    )
    return settings.model_copy(update={"prior": prior, "evidence": evidence})
