"""The default estimators, the image statistics, the lead detector and the supervisor on footage that others drove.

The footage passes as it was recorded, so the results say how the stack rates it, not where it would drive. The
supervisor begins in STOP; as in a car that drives already, a driver drives for the first :data:`RUN_UP_S` and then
lets go. A recording of Trepid brings its own vehicle states. Elsewhere the speed is given, and the yaw rate is
given or measured in the images (:mod:`sim_harness.footage.visual_motion`), where the angle of the wheels is
atan(L·r/v). A yaw rate that cannot be measured is None, which raises fear.
"""

import math
from bisect import bisect_right
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import cv2
import numpy as np

import supervisor.supervisor
from perception.camera.odometry import StateOdometry
from perception.estimators import ESTIMATORS, build_beside
from perception.lane.outline import with_boundaries
from perception.lead.finder import LeadFinder
from perception.sight.judge import build as build_judge
from sim_harness.footage.clip import undistort
from sim_harness.footage.resimulation import LATENCY_S, RUN_UP_S
from sim_harness.footage.visual_motion import yaw_changes_rad
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.messages import Decision, Frame, ImageStatistics, LeadVehicle, SteeringEstimate, VehicleState
from trepid.types import Array, Image

YAW_WIDTH_PX = 640  # the yaw rate is measured in images of at most this width
SMOOTH_S = 0.2  # the yaw rate is the mean over this time
STANDING_MPS = 0.1  # below, the yaw rate is 0


class StateOf(Protocol):
    """The state of the vehicle at the capture of a frame."""

    odometry: StateOdometry

    def __call__(self, frame: Frame) -> VehicleState:
        """The state at ``frame``."""
        ...


@dataclass(frozen=True, slots=True)
class FrameJudgement:
    """What the stack makes of one frame."""

    estimates: Mapping[str, SteeringEstimate]
    statistics: ImageStatistics
    lead: LeadVehicle | None  # None: no detector runs
    decision: Decision


class Onlooker:
    """Estimators, statistics, lead detector and supervisor, stepped frame by frame."""

    def __init__(
        self,
        camera: Camera,
        vehicle: Vehicle,
        state_of: StateOf,
        *,
        cruise_speed_mps: float | None,
        finder: LeadFinder | None = None,
        assumed: bool = False,
        names: Sequence[str] = tuple(ESTIMATORS),
    ) -> None:
        """``names``: of estimators, or files of driving networks.

        ``cruise_speed_mps`` None: that of ``config/supervisor.yaml``. ``assumed``: the camera is
        self-calibrated. Raises InputError.
        """
        self._camera, self._vehicle, self._state_of = camera, vehicle, state_of
        self._estimators = build_beside(names, camera, vehicle, assumed=assumed, odometry=state_of.odometry)
        self._finder, self._judge = finder, build_judge(camera, vehicle, assumed=assumed)
        self._lane: SteeringEstimate | None = None  # of the frame before, by the first estimator
        self._supervisor = supervisor.supervisor.build(cruise_speed_mps=cruise_speed_mps)

    def step(self, frame: Frame) -> FrameJudgement:
        """The estimates of ``frame`` and the decision after them. Estimates without boundaries are outlined."""
        state, t_s = self._state_of(frame), frame.t_s
        statistics = self._judge.step(frame, self._lane, state, now_s=t_s)
        found = {name: one.step(frame, state, now_s=t_s) for name, one in self._estimators.items()}
        self._lane = next(iter(found.values()), None)
        lead = self._finder.step(frame, state, found.values(), now_s=t_s) if self._finder else None
        people = self._finder.road_users if self._finder else None
        decision = self._supervisor.step(
            found, statistics, lead, state, now_s=t_s + LATENCY_S, road_users=people
        )
        shown = {name: with_boundaries(one, self._camera, self._vehicle) for name, one in found.items()}
        return FrameJudgement(shown, statistics, lead, decision)


class RecordedStates:
    """The recorded state at a frame: the newest one up to its capture."""

    odometry = StateOdometry.WAY_AND_TURN

    def __init__(self, states: Sequence[VehicleState]) -> None:
        """At least one of ``states``, in order of time."""
        self._states, self._times_s = states, [state.t_s for state in states]

    def __call__(self, frame: Frame) -> VehicleState:
        """The state at ``frame``; before the first one, that one."""
        return self._states[max(bisect_right(self._times_s, frame.t_s) - 1, 0)]


class GivenSpeed:
    """The state at a given speed; the yaw rate is that of ``yaw_radps_at``, or measured in the images."""

    def __init__(
        self,
        camera: Camera,
        vehicle: Vehicle,
        speed_mps_at: Callable[[float], float],
        yaw_radps_at: Callable[[float], float] | None = None,
        *,
        logged: bool = False,
    ) -> None:
        """Both functions take the time since the first frame [s]; NaN: unknown.

        ``logged``: the speed is measured, and so is a yaw rate that is given.
        """
        measured = StateOdometry.WAY if yaw_radps_at is None else StateOdometry.WAY_AND_TURN
        self.odometry = measured if logged else StateOdometry.NONE
        width_px = min(camera.width_px, YAW_WIDTH_PX)
        self._camera = camera.resize(width_px, round(camera.height_px * width_px / camera.width_px))
        self._vehicle, self._speed_mps_at, self._yaw_radps_at = vehicle, speed_mps_at, yaw_radps_at
        self._first_s: float | None = None
        self._before: tuple[float, Image] | None = None
        self._rates: deque[tuple[float, float]] = deque()  # time and yaw rate of the last SMOOTH_S

    def __call__(self, frame: Frame) -> VehicleState:
        """The state at ``frame``, driven by a driver for the first RUN_UP_S."""
        self._first_s = frame.t_s if self._first_s is None else self._first_s
        since_s = frame.t_s - self._first_s
        speed_mps = self._speed_mps_at(since_s)
        given = self._yaw_radps_at
        yaw_radps = given(since_s) if given is not None else self._mean_yaw_rate_radps(frame, speed_mps)
        known = math.isfinite(yaw_radps) and math.isfinite(speed_mps)
        bend_1pm = yaw_radps / speed_mps if speed_mps > STANDING_MPS else 0.0
        angle_rad = road_wheel_angle(bend_1pm, wheelbase_m=self._vehicle.wheelbase_m)
        return VehicleState(
            t_s=frame.t_s,
            speed_mps=speed_mps if math.isfinite(speed_mps) else None,
            road_wheel_angle_rad=angle_rad if known else None,
            yaw_rate_radps=yaw_radps if math.isfinite(yaw_radps) else None,
            driver_override=since_s < RUN_UP_S,
        )

    def _mean_yaw_rate_radps(self, frame: Frame, speed_mps: float) -> float:
        """Mean yaw rate [rad/s] of the last SMOOTH_S; NaN where none was measured. Of a first frame it is 0."""
        size = (self._camera.width_px, self._camera.height_px)
        small = cv2.resize(frame.image, size, interpolation=cv2.INTER_AREA).astype(np.uint8, copy=False)
        image = undistort(small, self._camera)
        before, self._before = self._before, (frame.t_s, image)
        if before is None or speed_mps <= STANDING_MPS:
            return 0.0
        dt_s = frame.t_s - before[0]
        if dt_s > 0.0 and math.isfinite(speed_mps):  # else nothing is measured
            step_m: Array = np.array([speed_mps * dt_s])
            rate = float(yaw_changes_rad([before[1], image], self._camera, step_m)[0]) / dt_s
            if math.isfinite(rate):
                self._rates.append((frame.t_s, rate))
        while self._rates and self._rates[0][0] < frame.t_s - SMOOTH_S:
            self._rates.popleft()
        return float(np.mean([rate for _, rate in self._rates])) if self._rates else math.nan
