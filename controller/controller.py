"""The controller: decision and vehicle state to the next command.

Every input is checked for age, finiteness and plausibility. A missing or bad input brakes:

| input | longitudinal | lateral |
|---|---|---|
| the next decision or vehicle state is late, or malformed | comfort brake until a good one, or three in time | – |
| no usable decision | comfort stop, after ``lost_s`` emergency stop | along the path while it is young enough |
| no usable vehicle state | the same | holds the last wheel angle |
| a speed that is doubted | the same | along the path, by the last speed and the brake since |
| a doubted wheel angle or yaw rate | as decided | along the path, by the commands and the model of the car |
| no path, but one younger than ``path_memory_s`` | as decided | along the remembered path |
| no path, but one younger than ``stop_memory_s`` | comfort stop, or the demanded emergency stop | likewise |
| no path, and STOP since the start or since a driver | the same | along the arc of the driver's wheels |
| no path at all | comfort stop, or the demanded emergency stop | holds the last curvature, or the wheel angle |
| a report that a process is lost whose loss means a stop | comfort stop | – |
| mode STOP | the stop of the decision | along the path |

The emergency stop for lost inputs latches until standstill, or until a driver takes over.

A path older than ``path_memory_s`` is forgotten under a driver, whose wheels are a better guess of the road.
Without a path the last curvature is held: while a car stops, its bend lasts longer than a gap in the estimates, and
straightening the wheel would leave the lane. A path that is withdrawn before the car has been driven by it is
forgotten: the supervisor refused to drive, and the arc on which the driver left the car is a better guess of the
road. It is followed from the place at which he left it, because the path may have turned the car since.
"""

import math
from operator import attrgetter
from pathlib import Path
from typing import Annotated

from pydantic import Field

from controller.laws.lateral import LateralSettings, build_law
from controller.laws.law import Acting
from controller.model.bicycle import angle_from_curvature, critical_speed, curvature_from_angle
from controller.prediction import Predictor, ReckonedSpeed
from controller.speed_control import STRONGEST_MPS2, SpeedControl
from controller.speed_limits import SpeedSettings, target
from controller.steering_learner import LearningSettings, SteeringLearner
from trepid.bounds import at_least, at_most, within
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.config import CONFIG_DIR, InputError, Settings, fault_line, load, read
from trepid.messages import Command, Decision, Losses, Mode, Stop, VehicleState
from trepid.processes.lateness import Lateness, LatenessLimits
from trepid.scale import ReferenceWorld
from trepid.types import Positive

_MAX_DRIVE_LAG = 0.25  # of k·τ_a: damping 1 of the speed loop
_ROUNDING = 1e-9
_MAX_OVERSTEER = 0.95  # of the critical speed, up to which the bicycle model is trusted
_NUMBERS = attrgetter(  # of a decision; the inputs of the rules may be unknown
    *("t_s", "fear", "path_t_s", "lateral_offset_m", "heading_error_rad", "curvature_1pm"),
    *("curvature_rate_1pm2", "lookahead_m", "disagreement_mps2", "speed_factor", "speed_cap_mps"),
    *("sight_m", "sight_cap_mps", "road_user_m", "lane_unseen_s", "lead_m", "line_crossing_s"),
)
_ARC_M = 200.0  # known length of the arc on which a driver left the car: more than a stop needs
_EASED_SHARE = 0.5  # of the lateral acceleration in bends, left while the limiter cuts the steering


class InputLimits(Settings):
    """``inputs`` in ``config/controller.yaml``: largest age and size of accepted inputs."""

    late: LatenessLimits  # of decisions and states: the car brakes until late ones are in time
    stale_s: Positive  # older decisions and states are ignored
    lost_s: Positive  # without usable inputs for this long: emergency stop
    path_memory_s: Positive  # older paths are not followed while driving on
    stop_memory_s: Positive  # ... nor while stopping
    early_s: Positive  # a stamp may lie this far in the future
    max_speed_mps: Positive
    max_offset_m: Positive
    max_heading_rad: Annotated[float, Field(gt=0, lt=math.pi / 2)]
    max_curvature_1pm: Positive
    max_curvature_rate_1pm2: Positive
    max_lookahead_m: Positive
    max_yaw_rate_radps: Positive


class ControllerSettings(Settings):
    """``config/controller.yaml``."""

    lateral: LateralSettings
    learning: LearningSettings
    speed: SpeedSettings
    inputs: InputLimits


def build(vehicle: Vehicle | None = None, settings_file: Path | None = None) -> "Controller":
    """Controller of ``vehicle`` (default: ``config/vehicle.yaml``). Raises InputError on a bad file."""
    vehicle = vehicle or load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    path = settings_file or CONFIG_DIR / "controller.yaml"
    settings = load(path, ControllerSettings)
    if settings.speed.gain_1ps * vehicle.accel_lag_s > _MAX_DRIVE_LAG:
        raise InputError(
            f"{path}: speed.gain_1ps {settings.speed.gain_1ps} is too high for a drive with a lag of"
            f" {vehicle.accel_lag_s} s: the speed would overshoot; at most"
            f" {_MAX_DRIVE_LAG / vehicle.accel_lag_s:.2f}"
        )
    for name in ("comfort", "emergency"):
        decel_mps2 = getattr(settings.speed, name).decel_mps2 * vehicle.scale
        if decel_mps2 > STRONGEST_MPS2 * (1.0 + _ROUNDING):
            what = f"{decel_mps2:g} m/s² is above {STRONGEST_MPS2:g}, the limit of UN R157 for such a stop"
            raise InputError(fault_line(("speed", name, "decel_mps2"), what, read(path), path))
    return Controller(vehicle, settings)


class Controller:
    """Call ``step`` at every new decision and at least 50 times a second. Starts with the brake applied.

    It computes in the reference world (:mod:`trepid.scale`), in which the settings hold.
    """

    def __init__(self, vehicle: Vehicle, settings: ControllerSettings) -> None:
        enlargement = 1 / vehicle.scale  # of that world: gravity grows with it
        self._reference, vehicle = ReferenceWorld(vehicle.scale), vehicle.in_reference_world
        self.learner = SteeringLearner(vehicle, settings.learning)
        self._settings, self._standstill_mps = settings, vehicle.standstill_mps
        self._top_mps = critical_speed(vehicle) * settings.speed.critical_speed_share
        self._modelled_mps = critical_speed(vehicle) * _MAX_OVERSTEER
        self._predictor = Predictor(
            vehicle,
            command_delay_s=settings.lateral.command_delay_s,
            memory_s=settings.inputs.stop_memory_s + settings.inputs.stale_s,
            timing_share=settings.lateral.timing_share,
        )
        self._law = build_law(settings.lateral, vehicle)
        budget_mps2 = _EASED_SHARE * settings.speed.lateral_accel_mps2
        self._eased = settings.speed.model_copy(update=dict(lateral_accel_mps2=budget_mps2))
        self._speed = SpeedControl(settings.speed, vehicle, enlargement=enlargement)
        self._lateness = Lateness(settings.inputs.late)
        self._now_s: float | None = None
        self._healthy_s = 0.0  # time at which both inputs were last usable
        self._emergency = False  # own emergency stop, latched until standstill
        self._judged: Decision | None = None  # the newest decision ...
        self._sound = False  # ... and whether all its numbers are finite
        self._engaged = False  # a mode other than STOP since the start or since a driver steered
        self._driven: tuple[Lane, float] | None = None  # the arc on which a driver left the car
        self._reckoned = ReckonedSpeed(vehicle.accel_lag_s)
        self._path_t_s: float | None = None  # time at which the newest path was valid
        self._path: tuple[Lane, float] | None = None  # that path at the newest state, and its time
        self._curvature_1pm: float | None = None  # the last demand
        self._angle_rad: float | None = None  # likewise

    def step(
        self,
        decision: Decision | None,
        state: VehicleState | None,
        *,
        now_s: float,
        malformed: bool = False,
        losses: Losses | None = None,
    ) -> Command:
        """The command for ``now_s`` [s]; always finite, and braking where an input is not good.

        ``malformed``: an input is malformed, or of a clock that stepped back; the one that is given is older.
        ``losses``: the newest report of the launcher.
        """
        decision = self._reference.enlarge("decision", decision)
        state = self._reference.enlarge("state", state)
        dt_s = self._elapsed_time_s(now_s)
        frame_s = decision.t_s if decision is not None else None
        if frame_s is not None and not math.isfinite(frame_s):
            frame_s = None
        stamps_s = [
            ("decision", decision.decided_s if decision else None),
            ("state", state.t_s if state else None),
        ]
        possible = {
            name: t_s for name, t_s in stamps_s if t_s is not None and self._fresh(t_s, now_s, math.inf)
        }
        late = self._lateness.step(possible, now_s=now_s)
        decision = self._usable_decision(decision, now_s)
        state = self._usable_state(state, now_s)
        if state is not None:  # below, angles are those of the tyres
            state = self.learner.step(state)
            self._predictor.adopt(self._vehicle)
        speed_mps = state.speed_mps if state is not None else None
        steered_mps = self._reckoned.step(speed_mps, dt_s)
        if state is not None and steered_mps is not None:
            self._predictor.add_state(state, steered_mps)
        acting = self._acting(now_s)
        angle_rad = self._steer(acting, state, steered_mps, dt_s)
        self._predictor.add_command(angle_rad, now_s=now_s)
        drivable = self._fresh(self._path_t_s, now_s, self._settings.inputs.path_memory_s)
        driver = state is not None and state.driver_override
        if driver:  # lost inputs do not matter while a driver steers
            self._healthy_s, self._emergency, self._engaged = now_s, False, False
            self._law.release()
            if acting is None or not drivable:  # the next step holds the wheels as the driver has them
                self._path = self._curvature_1pm = None
        lane = acting.lane if acting is not None and drivable else None
        lost = losses is not None and bool(losses.stop)
        stop = self._stop(decision, lane, speed_mps, now_s, brake=lost or malformed or bool(late))
        cut = state is not None and state.saturated is True
        goal_mps, accel_mps2 = self._drive(decision, lane, speed_mps, stop, dt_s, driver=driver, cut=cut)
        wheel_rad = within(self.learner.command_rad(angle_rad), self._vehicle.max_road_wheel_angle_rad)
        command = Command(
            t_s=frame_s, road_wheel_angle_rad=wheel_rad, speed_mps=goal_mps, accel_mps2=accel_mps2
        )
        self._reckoned.demand_mps2 = accel_mps2
        return self._reference.restore(command)

    @property
    def _vehicle(self) -> Vehicle:
        """The vehicle with the learned parameters."""
        return self.learner.vehicle

    def _elapsed_time_s(self, now_s: float) -> float:
        """Time since the last step, 0 on the first; 0 where the clock runs backwards."""
        if self._now_s is None:
            self._now_s = self._healthy_s = now_s
        dt_s = at_least(now_s - self._now_s, 0.0)
        self._now_s = at_least(now_s, self._now_s)
        return dt_s

    def _usable_decision(self, decision: Decision | None, now_s: float) -> Decision | None:
        """The decision; None unless it is fresh and every number of it is finite."""
        if decision is None or not self._fresh(decision.decided_s, now_s, self._settings.inputs.stale_s):
            return None
        if decision is not self._judged:
            self._judged, self._sound = decision, _all_finite(decision)
            if self._sound:
                self._take_path(decision, now_s)
        return decision if self._sound else None

    def _take_path(self, decision: Decision, now_s: float) -> None:
        """Keep the path of a new decision, if it has a usable one."""
        limits, path_t_s = self._settings.inputs, decision.path_t_s
        lane = _lane_from_decision(decision, limits, self._vehicle)
        if lane is not None and path_t_s is not None and self._fresh(path_t_s, now_s, limits.path_memory_s):
            self._path_t_s, self._path = path_t_s, (lane, path_t_s)
        self._engaged = self._engaged or decision.mode is not Mode.STOP
        if lane is None and not self._engaged:
            self._path_t_s, self._path = decision.decided_s, self._driven

    def _usable_state(self, state: VehicleState | None, now_s: float) -> VehicleState | None:
        """The state; None unless it is fresh and plausible. Any quantity may be None, a speed only if doubted."""
        if state is None or not self._fresh(state.t_s, now_s, self._settings.inputs.stale_s):
            return None
        return state if _plausible(state, self._settings.inputs) else None

    def _fresh(self, t_s: float | None, now_s: float, max_age_s: float) -> bool:
        """False also for None and NaN, and for a stamp from the future."""
        return t_s is not None and -self._settings.inputs.early_s <= now_s - t_s <= max_age_s

    def _acting(self, now_s: float) -> Acting | None:
        """Car and newest path, at the moment at which a command given now acts; None without a recent path."""
        if self._path is None or not self._fresh(self._path_t_s, now_s, self._settings.inputs.stop_memory_s):
            return None
        lane, valid_s = self._path = self._predictor.at_last_state(self._path[0], valid_s=self._path[1])
        return self._predictor.when_steering_acts(lane, valid_s=valid_s, now_s=now_s)

    def _steer(
        self, acting: Acting | None, state: VehicleState | None, speed_mps: float | None, dt_s: float
    ) -> float:
        """Road-wheel angle demand [rad], within the limit of the vehicle."""
        if state is None or speed_mps is None:
            return self._angle_rad or 0.0
        model_mps = at_most(abs(speed_mps), self._modelled_mps)
        measured_rad = state.road_wheel_angle_rad
        wheels_rad = (self._angle_rad or 0.0) if measured_rad is None else measured_rad
        held_1pm = curvature_from_angle(wheels_rad, speed_mps=model_mps, vehicle=self._vehicle)
        if state.driver_override or self._driven is None:
            self._driven = Lane(0.0, 0.0, held_1pm or 0.0, 0.0, _ARC_M), state.t_s
        self._driven = self._predictor.at_last_state(self._driven[0], valid_s=self._driven[1])
        if acting is None:
            self._law.release()
        if acting is not None:
            self._curvature_1pm = self._law.curvature(acting, dt_s=dt_s)
        elif self._curvature_1pm is None:  # no path so far, or a driver steered: hold the wheels
            self._curvature_1pm = held_1pm
        demand_1pm = self._curvature_1pm or 0.0
        angle_rad = angle_from_curvature(demand_1pm, speed_mps=model_mps, vehicle=self._vehicle)
        self._angle_rad = within(angle_rad, self._vehicle.max_road_wheel_angle_rad)
        return self._angle_rad

    def _stop(
        self,
        decision: Decision | None,
        lane: Lane | None,
        speed_mps: float | None,
        now_s: float,
        *,
        brake: bool,
    ) -> Stop:
        """The kind of stop, or none; at least the comfort stop with ``brake``."""
        if self._emergency and speed_mps is not None and speed_mps <= self._standstill_mps:
            self._emergency = False
        if decision is not None and speed_mps is not None:
            self._healthy_s = now_s
        elif now_s - self._healthy_s > self._settings.inputs.lost_s:
            self._emergency = True
        if self._emergency or (decision is not None and decision.stop is Stop.EMERGENCY):
            return Stop.EMERGENCY
        if brake or decision is None or speed_mps is None or lane is None or decision.mode is Mode.STOP:
            return Stop.COMFORT
        return decision.stop

    def _drive(
        self,
        decision: Decision | None,
        lane: Lane | None,
        speed_mps: float | None,
        stop: Stop,
        dt_s: float,
        *,
        driver: bool,
        cut: bool,
    ) -> tuple[float, float]:
        """Target speed [m/s] and acceleration demand [m/s²]; under a driver the speed of the car and 0.

        While the limiter cuts the steering demand, bends are planned at a lower speed.
        """
        if driver and speed_mps is not None:
            return speed_mps, self._speed.release()
        if stop is not Stop.NONE or decision is None or lane is None or speed_mps is None:
            return 0.0, self._speed.stop(stop, speed_mps=speed_mps, dt_s=dt_s)
        cap_mps = at_least(at_most(decision.speed_cap_mps, self._top_mps), 0.0)
        goal = target(
            lane,
            cap_mps=cap_mps,
            speed_mps=speed_mps,
            drive_lag_s=self._vehicle.accel_lag_s,
            settings=self._eased if cut else self._settings.speed,
        )
        return goal.speed_mps, self._speed.track(goal, speed_mps=speed_mps, dt_s=dt_s)


def _lane_from_decision(decision: Decision, limits: InputLimits, vehicle: Vehicle) -> Lane | None:
    """The decision's path with its curvature brought to the axle; None unless complete and plausible."""
    lane, ahead_1pm = Lane.of_message(decision, known_m=decision.lookahead_m), decision.curvature_1pm
    if lane is None or ahead_1pm is None:
        return None
    plausible = (
        abs(lane.offset_m) <= limits.max_offset_m
        and abs(lane.heading_rad) <= limits.max_heading_rad
        and max(abs(ahead_1pm), abs(lane.curvature_1pm)) <= vehicle.possible_1pm(limits.max_curvature_1pm)
        and abs(lane.curvature_rate_1pm2) <= limits.max_curvature_rate_1pm2
        and 0.0 <= decision.lookahead_m <= limits.max_lookahead_m
    )
    return lane if plausible else None


def _plausible(state: VehicleState, limits: InputLimits) -> bool:
    return (
        (bool(state.doubted) if state.speed_mps is None else abs(state.speed_mps) <= limits.max_speed_mps)
        and (state.road_wheel_angle_rad is None or abs(state.road_wheel_angle_rad) <= math.pi / 2)
        and (state.yaw_rate_radps is None or abs(state.yaw_rate_radps) <= limits.max_yaw_rate_radps)
        and (state.driver_torque_nm is None or math.isfinite(state.driver_torque_nm))
    )


def _all_finite(decision: Decision) -> bool:
    """True when every number of ``decision`` that is known is finite."""
    numbers = (*_NUMBERS(decision), *decision.rule_strengths, *decision.trust)
    return all(map(math.isfinite, [number for number in numbers if number is not None]))
