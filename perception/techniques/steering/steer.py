"""From boundaries and lane state to the road-wheel angle."""

from trepid.clothoid import Lane
from trepid.steering import road_wheel_angle
from trepid.types import Positive


def pursuit(lane: Lane, wheelbase_m: float, *, lookahead_m: Positive = 8.0) -> float:
    """Road-wheel angle [rad], + left, of the arc to the lane centre ``lookahead_m`` ahead: δ = atan(L·2y/ℓ²).

    Source: Coulter, CMU-RI-TR-92-01; 8 m is about 1 s at the speeds of the shuttle.
    """
    return road_wheel_angle(lane.pursuit_curvature(lookahead_m), wheelbase_m=wheelbase_m)
