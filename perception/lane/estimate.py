"""The message of an estimate from a lane state."""

from perception.lane.model.geometry import WIDTH, LaneState
from perception.lane.model.paths import boundary_paths, known_reach_m
from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.messages import SteeringEstimate

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
) -> SteeringEstimate:
    """The estimate for ``lane`` at ``t_s``, with its boundaries in the image of ``camera``."""
    clothoid, lookahead_m = lane.clothoid, settings.steering.lookahead_m
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
        ahead_sigma_m=lane.ahead_sigma_m,
    )
