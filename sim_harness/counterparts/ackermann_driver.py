"""A simulated ROS driver: AckermannDriveStamped from the bus to the simulated car, its state or odometry back.

Without commands for ``SILENCE_S`` the driver brakes, as the drivers of real cars do.
"""

from dataclasses import replace
from typing import Any

from sim_harness.counterparts.car import CarBehindWire, wire_settings
from trepid.messages import Command, Odometry, VehicleState
from trepid.processes.process import Process, Ticker, process
from trepid.topics import Topic
from vehicle.actuators.ackermann import RATE_HZ, AckermannSettings

SILENCE_S = 0.1
SAFE_DECEL_MPS2 = 3.5


def followed(command: Command, age_s: float) -> Command:
    """The command that acts: ``command`` itself, or the brake when it is too old or asks for no drive any more."""
    if age_s <= SILENCE_S and command.t_s is not None:
        return command
    return replace(command, speed_mps=0.0, accel_mps2=-SAFE_DECEL_MPS2)


def run(me: Process) -> None:
    """The driver and the car, in real time, on the topics of the block ``ackermann``."""
    settings = wire_settings(me, AckermannSettings, "ackermann")
    kind: Any = Odometry if settings.state == "odometry" else VehicleState
    newest = me.bus.latest(Topic(settings.command_topic, Command, RATE_HZ))
    send = me.bus.publisher(Topic(settings.state_topic, kind, RATE_HZ))
    car = CarBehindWire(me)
    me.ready()
    ticker, begun = Ticker(1 / car.settings.period_s), False
    while me.running():
        ticker.sleep()
        ticker.due()
        now_s, command = me.now_s(), newest.refresh()
        begun = begun or (command is not None and command.t_s is not None)
        acting = followed(command, now_s - (newest.received_s or 0.0)) if begun and command else None
        state = car.step(acting, now_s=now_s)
        send(_odometry(state) if kind is Odometry else state)
        me.stepped()


def _odometry(state: VehicleState) -> Odometry:
    return Odometry(
        t_s=state.t_s, speed_mps=state.speed_mps or 0.0, yaw_rate_radps=state.yaw_rate_radps or 0.0
    )


if __name__ == "__main__":
    with process() as me:
        run(me)
