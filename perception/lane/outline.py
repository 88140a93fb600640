"""Boundaries in the image of an estimate that measures the lane but no boundaries, such as that of `cnn`."""

from dataclasses import replace

import numpy as np

from perception.lane.model.geometry import KAPPA, LaneState
from perception.lane.model.paths import boundary_paths
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import SteeringEstimate
from trepid.scale import scaled_message, scaled_settings

REACH_M = 20.0  # of the drawn boundaries, in the reference world (trepid.scale)


def with_boundaries(estimate: SteeringEstimate, camera: Camera, vehicle: Vehicle) -> SteeringEstimate:
    """``estimate`` with boundaries half of its lane width left and right of its lane centre.

    An estimate that has boundaries, or no lane state, is returned as it is. Without a measured width that of
    ``vehicle`` is assumed, and ``lane_width_m`` stays None. Boundaries are pixels of the image of ``camera``, one
    every ten rows.
    """
    lane = scaled_message(estimate, 1 / vehicle.scale)
    fields = lane.lateral_offset_m, lane.heading_error_rad, lane.curvature_1pm
    if estimate.left_boundary_px or estimate.right_boundary_px or None in fields:
        return estimate
    eye = scaled_settings(camera, 1 / vehicle.scale)
    width_m = lane.lane_width_m or vehicle.in_reference_world.lane_width_m
    rate_1pm2 = lane.curvature_rate_1pm2 or 0.0
    mean = np.array([*fields, rate_1pm2, width_m, 0.0], float)
    mean[KAPPA] -= rate_1pm2 * lane.lookahead_m
    left, right = boundary_paths(LaneState(mean, np.zeros((6, 6))), eye, reach_m=REACH_M)
    return replace(estimate, left_boundary_px=left, right_boundary_px=right)
