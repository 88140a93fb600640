"""The message of an estimate from a lane state."""

import numpy as np

from perception.lane.model.geometry import WIDTH, LaneState
from perception.lane.model.paths import boundary_paths, known_reach_m
from perception.lane.model.prediction import unseen_variance_m2
from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.messages import SIGMA_AHEAD_M, SteeringEstimate

NAME = "cv"


def lane_estimate(
    lane: LaneState,
    camera: Camera,
    settings: LaneCvSettings,
    vehicle: Vehicle,
    *,
    t_s: float,
    confidence: float,
    lanes_detected: int,
    reason: str,
    marked: bool,
    end_m: float,
) -> SteeringEstimate:
    """The estimate for ``lane`` at ``t_s``, with its boundaries in the image of ``camera``.

    Pixels support the lane up to ``end_m``; beyond it the deviation grows by :func:`unseen_variance_m2`.
    """
    clothoid, lookahead_m = lane.clothoid, settings.steering.lookahead_m
    reach_m = known_reach_m(lane, settings.drawn_reach_m, settings.evidence.drawn_sigma_m)
    unseen_m2 = unseen_variance_m2(np.array(SIGMA_AHEAD_M), end_m, settings.track)
    left, right = boundary_paths(lane, camera, reach_m=reach_m)
    return SteeringEstimate(
        t_s=t_s,
        estimator=NAME,
        lateral_offset_m=clothoid.offset_m,
        heading_error_rad=clothoid.heading_rad,
        curvature_1pm=clothoid.curvature_at(lookahead_m),
        curvature_rate_1pm2=clothoid.curvature_rate_1pm2,
        lookahead_m=lookahead_m,
        road_wheel_angle_rad=road_wheel_angle(
            clothoid.pursuit_curvature(lookahead_m), wheelbase_m=vehicle.wheelbase_m
        ),
        confidence=confidence,
        lanes_detected=lanes_detected,
        lane_width_m=float(lane.mean[WIDTH]),
        reason=reason,
        left_boundary_px=left,
        right_boundary_px=right,
        marked=marked,
        ahead_sigma_m=tuple(np.hypot(lane.ahead_sigma_m, np.sqrt(unseen_m2)).tolist()),
    )
