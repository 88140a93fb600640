"""Every estimator on every frame of a clip, in turn, and the error of each."""

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from lab.bench.frames import bare_canny_chain
from lab.bench.perception.clips import AIM_M, ClipFrame
from perception.estimators import entry_of
from perception.lane.model.geometry import centre_line
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.messages import PixelPath, SteeringEstimate
from trepid.types import Array

NEAR_M, FAR_M = 4.0, 20.0  # ahead of the rear axle: where boundaries are compared
LOOK = np.dtype(
    [
        ("offset_m", "f4"),  # estimate − truth; NaN: not given
        ("aim_m", "f4"),  # offset of the estimated lane centre AIM_M ahead
        ("heading_rad", "f4"),
        ("curvature_1pm", "f4"),  # AIM_M ahead
        ("width_share", "f4"),  # of the true width
        ("angle_rad", "f4"),  # of the road wheels
        ("left_m", "f4"),  # root mean square over the boundary, NEAR_M to FAR_M ahead
        ("right_m", "f4"),
        ("confidence", "f4"),
        ("lines", "i1"),
        ("time_s", "f4"),  # of the processor
        ("bare_chain_s", "f4"),  # of the peer on the same frame, in the same run
    ]
)
TRUTH = np.dtype([("offset_m", "f4"), ("curvature_1pm", "f4"), ("angle_rad", "f4"), ("in_gap", "?")])
Looks = NDArray[np.void]


@dataclass(frozen=True)
class WatchedClip:
    """A clip: the truth, frame by frame, and the results of each estimator."""

    truth: Looks  # (n,) of TRUTH
    looks: Mapping[str, Looks]  # (n,) of LOOK each


def watch(clip: Iterable[ClipFrame], names: Sequence[str], camera: Camera, vehicle: Vehicle) -> WatchedClip:
    """Fresh estimators on the frames of a clip; their order changes from frame to frame."""
    cv2.setNumThreads(1)
    runners = {name: entry_of(name).build(camera, vehicle) for name in names}
    looks: dict[str, list[tuple[float, ...]]] = {name: [] for name in names}
    truth = []
    for number, moment in enumerate(clip):
        truth.append(
            (
                moment.truth.lateral_offset_m,
                moment.truth.curvature_1pm,
                moment.truth.road_wheel_angle_rad,
                moment.in_gap,
            )
        )
        road = _TrueRoad(moment, camera)
        started_s = time.thread_time()
        bare_canny_chain(moment.frame.image)
        bare_s = time.thread_time() - started_s
        first = number % max(len(names), 1)
        for name in (*names[first:], *names[:first]):
            started_s = time.thread_time()
            estimate = runners[name].step(moment.frame, moment.state, now_s=moment.frame.t_s)
            time_s = time.thread_time() - started_s
            looks[name].append((*look(estimate, moment.truth, road), time_s, bare_s))
    arrays = {name: np.array(rows, LOOK) for name, rows in looks.items()}
    return WatchedClip(np.array(truth, TRUTH), arrays)


def look(estimate: SteeringEstimate, truth: SteeringEstimate, road: "_TrueRoad") -> tuple[float, ...]:
    """A row of LOOK without the times."""
    left_m, right_m = road.boundary_errors_m(estimate.left_boundary_px, estimate.right_boundary_px)
    width_m, true_width_m = _number(estimate.lane_width_m), _number(truth.lane_width_m)
    return (
        _number(estimate.lateral_offset_m) - _number(truth.lateral_offset_m),
        road.beside_m(aim(estimate)),
        _number(estimate.heading_error_rad) - _number(truth.heading_error_rad),
        _lane_of(estimate).curvature_at(AIM_M) - _lane_of(truth).curvature_at(AIM_M),
        width_m / true_width_m - 1,
        _number(estimate.road_wheel_angle_rad) - _number(truth.road_wheel_angle_rad),
        left_m,
        right_m,
        estimate.confidence,
        estimate.lanes_detected,
    )


def aim(estimate: SteeringEstimate) -> complex:
    """The lane centre AIM_M along the lane as x + iy in the vehicle frame; NaN without an estimate.

    The centre is that of the exact clothoid; its parabola is 0.3 m off there in a bend of R = 13 m.
    """
    lane = _lane_of(estimate)
    station_m = np.linspace(0.0, AIM_M, 33)
    centre, _ = centre_line(
        station_m,
        station_m * (lane.curvature_1pm + lane.curvature_rate_1pm2 / 2 * station_m),
        offset_m=lane.offset_m,
        heading_rad=lane.heading_rad,
    )
    return complex(centre[-1])


def _lane_of(estimate: SteeringEstimate) -> Lane:
    """The lane of an estimate; NaN without one."""
    return Lane.of_message(estimate) or Lane(math.nan, math.nan, math.nan, math.nan)


class _TrueRoad:
    """The true lane in the vehicle frame; its boundaries are the lines where it is marked, else the edges."""

    def __init__(self, moment: ClipFrame, camera: Camera) -> None:
        self._moment, self._camera = moment, camera

    def beside_m(self, place: complex) -> float:
        """Offset of a place x + iy of the vehicle frame to the left of the lane centre; NaN of NaN."""
        if not np.isfinite(place):
            return np.nan
        return float(self._on_road(np.array([[place.real, place.imag]]), steps=4)[0, 1])

    def boundary_errors_m(self, left: PixelPath, right: PixelPath) -> tuple[float, float]:
        """Root mean square distance of each boundary from the true one; NaN without an estimate."""
        return self._error_m(left, 0.5), self._error_m(right, -0.5)

    def _error_m(self, path: PixelPath, share: float) -> float:
        if not path:
            return np.nan
        ground = self._camera.road_from_pixel(np.array(path))
        ahead = (ground[:, 0] >= NEAR_M) & (ground[:, 0] <= FAR_M)  # NaN is not ahead
        if not ahead.any():
            return np.nan
        station_m, offset_m = self._on_road(ground[ahead], steps=2).T
        return float(np.sqrt(np.mean((offset_m - share * self._moment.road.widths_at(station_m)) ** 2)))

    def _on_road(self, places_m: Array, *, steps: int) -> Array:
        """(station, offset) of places (x, y) of the vehicle frame, shape (n, 2)."""
        moment = self._moment
        cos, sin = np.cos(moment.yaw_rad), np.sin(moment.yaw_rad)
        world = places_m @ np.array([[cos, sin], [-sin, cos]]) + [moment.x_m, moment.y_m]
        return moment.road.nearest_coordinates(world, steps=steps)


def _number(value: float | None) -> float:
    return np.nan if value is None else value
