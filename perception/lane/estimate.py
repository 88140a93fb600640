"""The message of the lane estimator."""

from perception.lane.model.geometry import WIDTH, LaneState
from perception.lane.model.paths import boundary_paths, known_reach_m
from perception.lane.settings import LaneCvSettings
from trepid.camera import Camera
from trepid.messages import SteeringEstimate
from trepid.steering import road_wheel_angle

NAME = "cv"


def lane_estimate(
    lane: LaneState,
    camera: Camera,
    settings: LaneCvSettings,
    *,
    t_s: float,
    wheelbase_m: float,
    confidence: float,
    lanes_detected: int,
    marked: bool,
    reason: str,
) -> SteeringEstimate:
    """The estimate for ``lane`` at ``t_s``, with its boundaries in the image of ``camera``."""
    lookahead_m, clothoid = settings.steering.lookahead_m, lane.clothoid
    commanded = clothoid.pursuit_curvature(lookahead_m)
    reach_m = known_reach_m(lane, settings.drawn_reach_m, settings.evidence.drawn_sigma_m)
    left, right = boundary_paths(lane, camera, reach_m=reach_m)
    return SteeringEstimate(
        t_s=t_s,
        estimator=NAME,
        lateral_offset_m=clothoid.offset_m,
        heading_error_rad=clothoid.heading_rad,
        curvature_1pm=clothoid.curvature_at(lookahead_m),
        curvature_rate_1pm2=clothoid.curvature_rate_1pm2,
        lookahead_m=lookahead_m,
        road_wheel_angle_rad=road_wheel_angle(commanded, wheelbase_m=wheelbase_m),
        confidence=confidence,
        lanes_detected=lanes_detected,
        lane_width_m=float(lane.mean[WIDTH]),
        latency_ms=None,
        reason=reason,
        left_boundary_px=left,
        right_boundary_px=right,
        marked=marked,
    )
