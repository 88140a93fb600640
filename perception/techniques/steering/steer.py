"""From boundaries and lane state to the road-wheel angle."""

from perception.techniques.image.picture import Lane
from trepid.steering import pursuit_curvature, road_wheel_angle
from trepid.types import Positive


def pursuit(lane: Lane, wheelbase_m: float, *, lookahead_m: Positive = 8.0) -> float:
    """Road-wheel angle [rad], + left, of the arc to the lane centre ``lookahead_m`` ahead: δ = atan(L·2y/ℓ²).

    Source: Coulter, CMU-RI-TR-92-01; 8 m is about 1 s at the speeds of the shuttle.
    """
    curvature_1pm = pursuit_curvature(
        lookahead_m,
        offset_m=lane.offset_m,
        heading_rad=lane.heading_rad,
        curvature_1pm=lane.curvature_1pm,
        curvature_rate_1pm2=lane.curvature_rate_1pm2,
    )
    return road_wheel_angle(curvature_1pm, wheelbase_m=wheelbase_m)
