"""A simulated ROS driver: AckermannDriveStamped from the bus to the simulated car, its state or odometry back.

The driver takes accelerations as ``config/actuator.yaml`` names them. Without commands for ``SILENCE_S`` it brakes,
as the drivers of real cars do.
"""

import math
from dataclasses import replace

from sim_harness.counterparts.car import CarBehindWire, wire_settings
from trepid.messages import Command, Odometry, VehicleState
from trepid.processes.process import Process, Ticker, process
from vehicle.actuators.ackermann import AckermannSettings, command_topic, state_topic

SILENCE_S = 0.1
SAFE_DECEL_MPS2 = 3.5
QUICKEST_MPS2 = 3.5  # of a command with acceleration zero
RESPONSE_S = 0.2  # of the speed near its goal


def motion_of(command: Command, age_s: float, speed_mps: float, *, signed: bool = False) -> Command:
    """What ``command`` of the wire does to a car at ``speed_mps``, as a signed acceleration.

    Unless it is ``signed`` already, the acceleration is the rate of change to the target speed, up or down. A
    command that is too old, or based on no frame any more, is a brake.
    """
    if age_s > SILENCE_S or command.t_s is None:
        return replace(command, speed_mps=0.0, accel_mps2=-SAFE_DECEL_MPS2)
    if signed:
        return command
    most_mps2 = abs(command.accel_mps2) or QUICKEST_MPS2
    wanted_mps2 = -most_mps2 if command.speed_mps <= 0.0 else (command.speed_mps - speed_mps) / RESPONSE_S
    return replace(command, accel_mps2=max(-most_mps2, min(most_mps2, wanted_mps2)))


def run(me: Process) -> None:
    """The driver and the car, in real time, on the topics of the block ``ackermann``."""
    settings = wire_settings(me, AckermannSettings, "ackermann")
    reports = state_topic(settings)
    newest, send = me.bus.latest(command_topic(settings)), me.bus.publisher(reports)
    signed, car = settings.acceleration == "signed", CarBehindWire(me)
    me.ready()
    ticker, begun, speed_mps = Ticker(1 / car.settings.period_s), False, 0.0
    while me.running():
        ticker.sleep()
        ticker.due()
        now_s, command = me.now_s(), newest.refresh()
        begun = begun or (command is not None and command.t_s is not None)
        age_s = now_s - (newest.received_s or 0.0)
        acting = motion_of(command, age_s, speed_mps, signed=signed) if begun and command else None
        state = car.step(acting, now_s=now_s)
        speed_mps = state.speed_mps or 0.0
        send(odometry_of(state) if reports.type is Odometry else state)
        me.count_step()


def odometry_of(state: VehicleState) -> Odometry:
    """The part of ``state`` that an odometry holds; NaN where the sensor calls its value invalid."""
    speed_mps, yaw_radps = state.speed_mps, state.yaw_rate_radps
    return Odometry(
        t_s=state.t_s,
        speed_mps=math.nan if speed_mps is None else speed_mps,
        yaw_rate_radps=math.nan if yaw_radps is None else yaw_radps,
    )


if __name__ == "__main__":
    with process() as me:
        run(me)
