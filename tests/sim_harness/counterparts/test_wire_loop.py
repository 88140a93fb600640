"""Commands through limiter, CAN actuator, bus, ECU and simulated car, in one process and in given time."""

import can
import can_rig
import pytest

from controller.limiter import build as build_limiter
from sim_harness.counterparts.ecu import Ecu, EcuSettings
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.scenario import Scenario
from vehicle.actuators.node import ActuatorStep
from vehicle.measurement.check import build as build_check

QUIET = load_simulator().model_copy(
    update=dict(speed_noise_ratio=0.0, road_wheel_angle_noise_rad=0.0, yaw_rate_noise_radps=0.0)
)
SCENARIO = Scenario.model_validate(dict(description="", tags=["nominal"], road="straight", duration_s=60.0))


def car_behind(limiter):
    return SimulatedVehicle(SCENARIO, SCENARIO.build_road(), can_rig.VEHICLE, limiter, QUIET, seed=0)


class Loop:
    """Near end: limiter and actuator. Far end: ECU and car."""

    def __init__(self):
        self.bus = can_rig.OneBus()
        self.node = ActuatorStep(build_limiter(can_rig.VEHICLE), build_check(can_rig.VEHICLE))
        self.ecu = Ecu(can_rig.SHUTTLE, EcuSettings(), can_rig.VEHICLE)
        self.car = car_behind(None)
        self.now_s, self.speed_mps, self.wheel_rad, self.state = 10.0, 0.0, 0.0, None

    def step(self, *, near=True, far=True):
        """10 ms with a demand of 1 m/s²; ``near`` or ``far`` may be silent."""
        now_s = self.now_s
        if near:
            read = self.bus.actuator.read(now_s=now_s)
            order = can_rig.command(0.0, 1.0, t_s=now_s)
            applied = self.node.step(order, now_s, read, now_s=now_s)
            if applied.command is not None:
                self.bus.actuator.write(applied.command, now_s=now_s)
            self.state = applied.state
        for frame in self.bus.drain_frames():
            self.ecu.take(frame.arbitration_id, frame.is_extended_id, bytes(frame.data), now_s=now_s)
        acting = self.ecu.command(self.speed_mps, self.wheel_rad, now_s=now_s)
        if acting is None:
            measured, truth = self.car.wait(now_s=now_s)
        else:
            measured, truth = self.car.step(acting, now_s, now_s=now_s)
        self.speed_mps, self.wheel_rad = measured.speed_mps, measured.road_wheel_angle_rad
        for sender, data in self.ecu.reports(measured, now_s=now_s, step_s=0.01) if far else ():
            self.bus.put(sender.address, data)
        self.now_s += 0.01
        return truth

    def steps(self, count, **how):
        for _ in range(count):
            truth = self.step(**how)
        return truth

    def inject(self, sender):
        """A frame of a third party that steers to the left at full drive."""
        third = can.Bus(interface="virtual", channel=self.bus.channel)
        data = sender.frame(can_rig.command_quantities(can_rig.command(0.5, 1.5)))
        third.send(can.Message(arbitration_id=sender.address, data=data, is_extended_id=False))
        third.shutdown()


@pytest.fixture
def loop():
    one = Loop()
    yield one
    one.bus.close()


@pytest.fixture
def foreign():
    return can_rig.SHUTTLE.sender(can_rig.SHUTTLE.settings.commands[0])


def test_a_car_drives_through_the_wire_as_without_it(loop):
    bare = car_behind(build_limiter(can_rig.VEHICLE))
    loop.steps(400)
    for k in range(400):
        now_s = 10.0 + 0.01 * k
        state, _ = bare.step(can_rig.command(0.0, 1.0, t_s=now_s), now_s, now_s=now_s)
    assert loop.speed_mps == pytest.approx(state.speed_mps, abs=0.1)  # a few steps of delay
    assert loop.speed_mps > 3.0


def test_the_car_stops_when_the_sender_falls_silent(loop):
    loop.steps(400)
    loop.steps(300, near=False)
    assert loop.ecu.safe == "no valid STEERING_LTA"
    assert loop.speed_mps < 0.05


def test_the_limiter_stops_the_car_when_the_ecu_reports_nothing(loop):
    loop.steps(400)
    loop.steps(300, far=False)
    assert loop.state.speed_mps is None
    assert loop.ecu.safe == ""
    assert loop.speed_mps < 0.05


def test_the_car_stops_while_a_third_party_sends_wrong_counters(loop, foreign):
    loop.steps(400)
    for _ in range(300):
        for _ in range(20):
            foreign.frame(can_rig.command_quantities(can_rig.command()))  # its counter races
        loop.inject(foreign)
        truth = loop.step()
    assert loop.ecu.refused_frames()["refused STEERING_LTA counter"] > 50
    assert abs(truth.lateral_offset_m) < 0.1
    assert loop.speed_mps < 0.05


def test_a_single_foreign_frame_neither_steers_nor_stops_the_car(loop, foreign):
    loop.steps(400)
    loop.inject(foreign)
    truth = loop.steps(100)
    assert abs(truth.lateral_offset_m) < 0.01
    assert loop.speed_mps > 4.0
