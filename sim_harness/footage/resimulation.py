"""Closed loop on real pixels: DAVE-2's simulator (Bojarski et al. 2016, section 5).

The recorded path is used as truth and lane centre. The simulated car has the lateral offset e from it and the
heading ψ relative to it:

    e' = v·sin ψ      ψ' = v·κ - ψ'_rec·(v / v_rec)

with κ of the plant under the commands of the stack and the yaw rate ψ'_rec of the recorded car, measured in the
images. Each frame is the last recorded one, reprojected to the pose of the simulated car. The speed is that of the
recording, so only the steering is judged. A driver drives for the first RUN_UP_S, and on until the supervisor says
that it is ready. When the car stops, the driver takes over, returns to the recorded path as e·exp(-t/RETURN_S), and
begins a new drive, because the recording does not stand still (:mod:`.driver`).
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import cumulative_trapezoid

import controller.controller
import controller.limiter
import supervisor.supervisor
from drive.tally import autonomy_percent
from perception.camera.odometry import StateOdometry
from perception.estimators import Estimator, build_beside
from perception.sight.judge import build as build_judge
from sim_harness.footage.clip import ClipFrames
from sim_harness.footage.driver import SafetyDriver
from sim_harness.footage.reprojection import PoseChange, Reprojection
from sim_harness.lockstep.stack import Perception, Stack
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.plant import Plant
from sim_harness.world.plants.settings import PlantSettings
from trepid.car.vehicle import Vehicle
from trepid.causes import Cause
from trepid.config import InputError
from trepid.messages import Command, Decision, Frame, Mode, SteeringEstimate, VehicleState
from trepid.types import Array, Image, Mask

PERIOD_S = 0.01  # of the vehicle; as in lock-step
CONTROL_TICKS = 2
CAMERA_TICKS = 4  # 25 frames/s
SAME_STATION_M = 1e-6
SAME_TIME_S = 1e-6
LATENCY_S = 0.02  # capture to estimate; as in lock-step
RUN_UP_S = 2.2  # a driver must have driven for 2 s before the supervisor takes over (supervisor.yaml)
SUPERVISED = ("cv", "cnn")  # estimators of the default drive
INTERVENTION_M = 1.0  # Bojarski et al., section 7
LEAST_S = 0.5  # after the run-up
RETURN_S = 1.0  # time constant: the offset from the recorded path falls by e per second under the driver
STAYS = math.exp(-PERIOD_S / RETURN_S)  # of the distance from it, in a period
AFRAID = re.compile(r"\(now [\d.]+: (.+)\)")  # what the car is afraid of
UP_TO_A_NUMBER = re.compile(r"(\D+?)(?: -?\d|$)")
HOME_M = 0.2  # within this distance of the unshifted run the car has returned


@dataclass(frozen=True)
class Resimulation:
    """One run: a sample per frame from the end of the run-up on, and the results."""

    t_s: Array
    offset_m: Array  # of the car from the recorded path, + = left
    heading_rad: Array
    seen_m: Array  # lateral offset of the surest estimator; NaN without a lane
    unseen: Array  # share of the pixels outside the recorded image
    fear: Array
    interventions: int
    engaged: Mask  # by frame: the car drives
    causes: tuple[str, ...]  # of fear, by frame; :func:`cause_of`

    @property
    def duration_s(self) -> float:
        """From the run-up to the end."""
        return float(self.t_s[-1] - self.t_s[0])

    @property
    def engaged_share(self) -> float:
        """Share of the frames in which the car drives."""
        return float(np.mean(self.engaged))

    @property
    def stops(self) -> int:
        """How often a driver has taken over because the car stopped."""
        return int(np.count_nonzero(self.engaged[:-1] & ~self.engaged[1:]))

    @property
    def autonomy_percent(self) -> float | None:
        """100·(1 - 6 s·N/T), not below 0; None where the car was never engaged."""
        if not self.engaged_share:
            return None
        return autonomy_percent(self.interventions, self.duration_s)

    def return_s(self, unshifted: "Resimulation") -> float | None:
        """Time from which on the car stays within HOME_M of the run with an unshifted start; None when never.

        The lane centre of a recording is unknown, so the run without a shift is the reference.
        """
        off = np.abs(self.offset_m - unshifted.offset_m) >= HOME_M
        if off[-1]:
            return None
        last = np.flatnonzero(off)[-1] + 1 if off.any() else 0
        return float(self.t_s[last] - self.t_s[0])

    @property
    def _rms_m(self) -> float | None:
        """Rms distance [m] from the recorded path of the car that drives; None where it never does."""
        return (
            round(float(np.sqrt(np.mean(self.offset_m[self.engaged] ** 2))), 3)
            if self.engaged.any()
            else None
        )

    def row(self) -> dict[str, object]:
        """The run as JSON."""
        tail = self.t_s > self.t_s[-1] - 2.0
        return {
            "duration_s": round(self.duration_s, 2),
            "start_offset_m": round(float(self.offset_m[0]), 3),
            "start_heading_rad": round(float(self.heading_rad[0]), 4),
            "end_offset_m": round(float(self.offset_m[tail].mean()), 3),  # mean of the last 2 s
            "max_offset_m": round(float(np.abs(self.offset_m).max()), 3),
            "rms_offset_m": self._rms_m,
            "interventions": self.interventions,
            "stops": self.stops,
            "autonomy_percent": None if self.autonomy_percent is None else round(self.autonomy_percent, 1),
            "engaged_percent": round(100.0 * self.engaged_share, 1),
            "lane_seen_percent": round(100.0 * float(np.isfinite(self.seen_m).mean()), 1),
            "mean_unseen_percent": round(100.0 * float(self.unseen.mean()), 2),
            "max_unseen_percent": round(100.0 * float(self.unseen.max()), 2),
            "mean_fear": round(float(self.fear.mean()), 3),
            "max_fear": round(float(self.fear.max()), 2),
        }


def resimulate(
    drive: ClipFrames,
    vehicle: Vehicle,
    *,
    start: PoseChange,
    estimators: Sequence[str] = SUPERVISED,
    assumed: bool = False,
    run_up_s: float = RUN_UP_S,
) -> Resimulation:
    """Drive along the recorded path from ``start`` on. Deterministic. Raises InputError for a short recording.

    ``estimators``: names, or files of driving networks. ``assumed``: the camera is self-calibrated, so its height
    is a guess.
    """
    if drive.t_s[-1] < run_up_s + LEAST_S:
        raise InputError(
            f"{drive.name}: {len(drive.frames)} frames last {drive.t_s[-1]:.1f} s: at least"
            f" {run_up_s + LEAST_S:.1f} s expected, with a run-up of {run_up_s:.1f} s"
        )
    # Odometry would measure another camera than that of the simulated world, which is that of the drive.
    built = build_beside(estimators, drive.camera, vehicle, assumed=assumed, odometry=StateOdometry.NONE)
    return _Loop(drive, vehicle, start, built, run_up_s, assumed).run()


def cause_of(decision: Decision) -> str:
    """The cause of fear; of a stop also what the car waits for, in the words of the supervisor without numbers."""
    _, _, awaited = decision.waits_for.partition(f"{decision.cause}: ")
    words = AFRAID.search(awaited) or UP_TO_A_NUMBER.match(awaited)
    return f"{decision.cause}: {words[1]}" if awaited and words else decision.cause


class _Loop:
    """One run: plant and recorded frames around a :class:`Stack`."""

    def __init__(
        self,
        drive: ClipFrames,
        vehicle: Vehicle,
        start: PoseChange,
        estimators: Mapping[str, Estimator],
        run_up_s: float,
        assumed: bool,
    ) -> None:
        self._drive, self._vehicle, self._place, self._returns = drive, vehicle, start, False
        self._stations_m = drive.station_m
        self._yaw_rates_radps = drive.yaw_rates_radps
        self._yaws_rad = cumulative_trapezoid(self._yaw_rates_radps, drive.t_s, initial=0.0)
        self._reprojection = Reprojection(drive.camera)
        self._estimators = estimators
        self._judge = build_judge(drive.camera, vehicle, assumed=assumed)
        self._driver = SafetyDriver(run_up_s)
        self._begin_drive()
        self._limiter = controller.limiter.build(vehicle)
        self._plant: Plant = build_plant(PlantSettings(), vehicle)
        self._run_up_s = run_up_s
        self._state = self._plant.initial(0.0, start.left_m, start.yaw_rad, float(drive.speed_mps[0]))
        self._interventions = 0
        self._rows: list[tuple[float, ...]] = []
        self._engaged: list[bool] = []
        self._causes: list[str] = []

    def _begin_drive(self) -> None:
        """A new supervisor, which starts in STOP, and a new controller."""
        self._stack = Stack(
            supervisor.supervisor.build(cruise_speed_mps=float(self._drive.speed_mps.max())),
            controller.controller.build(self._vehicle),
            self._estimators,
            idle_period_s=None,
        )

    def run(self) -> Resimulation:
        """Simulate all frames."""
        judged = -1
        for tick in range(math.floor(self._drive.t_s[-1] / PERIOD_S) + 1):
            now_s = tick * PERIOD_S
            self._change_driver(now_s)
            stack, driven = self._stack, self._driver.drives
            state = self._vehicle_state(now_s, driven=driven)
            if tick % CAMERA_TICKS == 0:
                number = int(np.searchsorted(self._drive.t_s, now_s + SAME_TIME_S, side="right")) - 1
                image, unseen = self._view(number, now_s)
                frame = Frame(t_s=now_s, image=image)
                estimates = {
                    name: one.step(frame, state, now_s=now_s) for name, one in self._estimators.items()
                }
                lane = next(iter(stack.estimates.values()), None)  # of the frame before
                if number != judged:  # two views of one recorded frame are alike, as behind a dirty lens
                    judged, statistics = number, self._judge.step(frame, lane, state, now_s=now_s)
                stack.send(Perception(now_s + LATENCY_S, estimates, statistics, None))
                if now_s >= self._run_up_s:
                    surest = max(estimates.values(), key=lambda estimate: estimate.confidence)
                    self._note(now_s, surest, unseen)
            stack.step(state, command_due=tick % CONTROL_TICKS == 0, now_s=now_s)
            applied = self._limiter.step(stack.command, stack.commanded_s, state, now_s=now_s)
            self._advance(applied, now_s, driven=driven)
        return self._result()

    def _change_driver(self, now_s: float) -> None:
        """Switch between driver and car.

        The driver takes over at the place of the car. A new drive starts, unless the stop is that of the start.
        """
        drove, decision = not self._driver.drives, self._stack.decision
        if self._driver.step(decision, now_s=now_s) and drove:
            self._place = PoseChange(left_m=self._state.y_m, yaw_rad=self._state.yaw_rad)
            self._returns = True
            if decision is not None and decision.cause != Cause.STARTING:
                self._begin_drive()

    def _view(self, number: int, now_s: float) -> tuple[Image, float]:
        """Recorded frame ``number``, reprojected to the present station, and its share of unrecorded pixels."""
        drive, beside = self._drive, self._state
        station_m = float(np.interp(now_s, drive.t_s, self._stations_m))
        ahead_m = max(station_m - float(self._stations_m[number]), 0.0)
        turned_rad = float(np.interp(now_s, drive.t_s, self._yaws_rad) - self._yaws_rad[number])
        if ahead_m < SAME_STATION_M:
            ahead_m = turned_rad = 0.0
        shift = PoseChange(
            ahead_m - beside.y_m * math.sin(turned_rad),
            ahead_m * turned_rad / 2 + beside.y_m * math.cos(turned_rad),
            turned_rad + beside.yaw_rad,
        )
        return self._reprojection.view(drive.frames[number], shift)

    def _vehicle_state(self, now_s: float, *, driven: bool) -> VehicleState:
        return VehicleState(
            t_s=now_s,
            speed_mps=self._state.speed_mps,
            road_wheel_angle_rad=self._state.road_wheel_angle_rad,
            yaw_rate_radps=self._plant.yaw_rate_radps(self._state),
            driver_override=driven,
        )

    def _advance(self, applied: Command, now_s: float, *, driven: bool) -> None:
        """One period of the plant in a frame that moves along the recorded path."""
        speed_mps = float(np.interp(now_s, self._drive.t_s, self._drive.speed_mps))
        turned_rad = PERIOD_S * float(np.interp(now_s, self._drive.t_s, self._yaw_rates_radps))
        held = replace(self._state, speed_mps=speed_mps, accel_mps2=0.0)
        if driven:  # beside the recorded path, with the wheels at its curvature
            curvature_1pm = turned_rad / PERIOD_S / max(speed_mps, 1.0)
            if self._returns:
                self._place = replace(
                    self._place, left_m=self._place.left_m * STAYS, yaw_rad=self._place.yaw_rad * STAYS
                )
            self._state = self._plant.initial(
                0.0, self._place.left_m, self._place.yaw_rad, speed_mps, curvature_1pm
            )
            return
        moved = self._plant.step(held, replace(applied, accel_mps2=0.0), PERIOD_S)
        self._state = replace(moved, x_m=0.0, yaw_rad=moved.yaw_rad - turned_rad)
        if abs(self._state.y_m) > INTERVENTION_M:
            self._interventions += 1
            speed_mps = self._state.speed_mps  # again on the recorded path, with the wheels at its curvature
            curvature_1pm = turned_rad / PERIOD_S / max(speed_mps, 1.0)
            self._state = self._plant.initial(0.0, 0.0, 0.0, speed_mps, curvature_1pm)

    def _note(self, now_s: float, estimate: SteeringEstimate, unseen: float) -> None:
        seen_m, decision = estimate.lateral_offset_m, self._stack.decision
        seen_m, fear = math.nan if seen_m is None else seen_m, decision.fear if decision else 1.0
        self._rows.append((now_s, self._state.y_m, self._state.yaw_rad, seen_m, unseen, fear))
        self._engaged.append(
            not self._driver.drives and decision is not None and decision.mode is not Mode.STOP
        )
        self._causes.append(cause_of(decision) if decision else Cause.STARTING)

    def _result(self) -> Resimulation:
        t_s, offset_m, heading_rad, seen_m, unseen, fear = np.array(self._rows, float).T
        engaged, causes = np.array(self._engaged), tuple(self._causes)
        return Resimulation(
            t_s, offset_m, heading_rad, seen_m, unseen, fear, self._interventions, engaged, causes
        )
