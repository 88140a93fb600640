"""Exact lane estimates from the simulator, for runs that do not examine perception.

With ``sight: truth`` nothing is rendered, so that a run takes a fraction of the time; every estimator of the
scenario publishes at the rate and with the latency of the camera, and faults of estimators and processes apply.
The image statistics are constants that cause no fear, and the true sight distance: fog and darkness take sight, and
have no other effect in such a run.
"""

from typing import Protocol

from perception.lane.settings import steering_settings
from sim_harness.world.sight_truth import SightDistance
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.clothoid import Lane
from trepid.messages import ImageStatistics, SimTruth, SteeringEstimate

LOOKAHEAD_S = 1.0  # at least ``steering.lookahead_m`` of perception.yaml


class Centre(Protocol):
    """The centre of the lane of a road, or of a world of another package."""

    def curvature_at(self, station_m: float) -> float:
        """Its curvature [1/m], + = bends left."""
        ...


class Oracle:
    """The lane at the capture of a frame: offset, heading, and the clothoid through two curvatures of the road."""

    def __init__(self, name: str, road: Centre, vehicle: Vehicle) -> None:
        """``name``: the estimator whose estimates it replaces."""
        self._name = name
        self._road = road
        self._wheelbase_m = vehicle.wheelbase_m
        self._near_m = steering_settings().lookahead_m * vehicle.scale

    def step(self, truth: SimTruth) -> SteeringEstimate:
        """The lane at ``truth``, with the curvature of the road at the rear axle and at the look-ahead."""
        ahead_m = max(self._near_m, LOOKAHEAD_S * (truth.speed_mps or 0.0))
        ahead_1pm = self._road.curvature_at(truth.station_m + ahead_m)
        rate_1pm2 = (ahead_1pm - truth.curvature_1pm) / ahead_m
        lane = Lane(truth.lateral_offset_m, truth.heading_error_rad, truth.curvature_1pm, rate_1pm2)
        command_1pm = lane.pursuit_curvature(ahead_m)
        return SteeringEstimate(
            t_s=truth.t_s,
            estimator=self._name,
            lateral_offset_m=truth.lateral_offset_m,
            heading_error_rad=truth.heading_error_rad,
            curvature_1pm=ahead_1pm,
            curvature_rate_1pm2=rate_1pm2,
            lookahead_m=ahead_m,
            road_wheel_angle_rad=road_wheel_angle(command_1pm, wheelbase_m=self._wheelbase_m),
            confidence=1.0,
            lanes_detected=2,
            lane_width_m=truth.lane_width_m,
            reason="",
        )


def clear_view(t_s: float, sight: SightDistance | None = None) -> ImageStatistics:
    """Statistics of a bright, sharp, fresh image: well inside "very_low" of every set in fear.yaml.

    ``sight``: the true sight distance, stated without a deviation; None: not known.
    """
    return ImageStatistics(
        t_s=t_s,
        brightness=0.45,
        contrast=0.2,
        over_exposed=0.0,
        under_exposed=0.0,
        sharpness=1000.0,
        frozen_s=0.0,
        spots=0.0,
        sight_m=sight.distance_m if sight else None,
        sight_sigma_m=0.0 if sight else None,
        sight_cause=sight.cause if sight else "",
    )
