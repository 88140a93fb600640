"""Actuator process: the newest command through the limiter to the wire of the car; the car's state to the bus.

The limiter and the actuator are in one process: nothing but ``write`` follows the limiter. The process writes at
``RATE_HZ`` with and without commands. At its end, by a signal, an error or the end of the launcher, it brings the
actuator to the safe state; where it cannot, because it was killed or is frozen, the wire falls silent, and the car
itself has to stop.
"""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NamedTuple, TypeVar

from controller.limiter import Limiter
from controller.limiter import build as build_limiter
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, Health, VehicleState
from trepid.processes.process import Process, Ticker, process
from trepid.processes.timing import Timekeeper
from trepid.topics import COMMAND, DRIVER_INPUT, VEHICLE_STATE
from vehicle.actuators.actuator import Actuator, Car
from vehicle.actuators.table import build as build_actuator
from vehicle.driver.arbitration import arbitrate, reported
from vehicle.driver.settings import load_driver

RATE_HZ = 100.0  # of UN R79
T = TypeVar("T")


class Applied(NamedTuple):
    """Result of one step."""

    command: Command  # for the wire
    state: VehicleState  # for the bus


class ActuatorStep:
    """The step between bus and wire: the limiter, and the state that travels."""

    def __init__(self, limiter: Limiter) -> None:
        self._limiter = limiter

    def step(
        self,
        command: Command | None,
        received_s: float | None,
        state: VehicleState | None,
        *,
        refused: bool = False,
        now_s: float,
    ) -> Applied:
        """The command for the wire, and the state for the bus.

        ``received_s``: arrival of ``command``. ``state``: as the car reports it; None when it reports nothing.
        ``refused``: the wire has failed since the last step, so that the car may have missed a command: the limiter
        stops the car, latched until standstill.

        An old state travels with its own time. An absent state travels as such, with all quantities None.
        """
        if refused:
            self._limiter.stopping = True
        applied = self._limiter.step(command, received_s, state, now_s=now_s)
        return Applied(applied, self._limiter.report(absent(now_s) if state is None else state))


def absent(now_s: float) -> VehicleState:
    """The state of a car that reports nothing."""
    return VehicleState(
        t_s=now_s, speed_mps=None, road_wheel_angle_rad=None, yaw_rate_radps=None, driver_override=False
    )


class Wire:
    """An actuator whose failures are counted; each is reported, none ends the loop."""

    def __init__(self, actuator: Actuator, name: str) -> None:
        self._actuator = actuator
        self._name = name
        self.failures = 0
        self.last = ""
        """The last failure, as text."""

    def read(self, now_s: float) -> VehicleState | None:
        """State of the car; None also when the wire fails."""
        return self._tried(lambda: self._actuator.read(now_s=now_s))

    def write(self, command: Command, now_s: float) -> None:
        """Send ``command``; a failure counts, and the next call sends the next command."""
        self._tried(lambda: self._actuator.write(command, now_s=now_s))

    def values(self) -> tuple[tuple[str, str], ...]:
        """Values for the heartbeat."""
        counted = (("wire_failures", str(self.failures)),) if self.failures else ()
        return (("actuator", self._name), *counted, *self._actuator.values())

    def _tried(self, act: Callable[[], T]) -> T | None:
        try:
            return act()
        except OSError as error:
            self.failures += 1
            self.last = " ".join(str(error).split()) or type(error).__name__
            return None


@contextmanager
def safe_at_end(actuator: Actuator) -> Iterator[None]:
    """Bring ``actuator`` to its safe state at the end of the body, whatever ends it.

    When the wire refuses that, a line on standard error says so: the car then notices the silence.
    """
    try:
        yield
    finally:
        try:
            actuator.close()
        except OSError as error:
            print(f"actuator: the safe state was not sent: {error}", file=sys.stderr)


def run(me: Process) -> None:
    """Read, step, write and publish until the process is to stop."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    name, actuator = build_actuator(Car(vehicle, me.bus, me.now_s))
    with safe_at_end(actuator):
        drive(me, actuator, name, ActuatorStep(build_limiter(vehicle)))


def drive(me: Process, actuator: Actuator, name: str, node: ActuatorStep) -> None:
    """The loop of :func:`run`."""
    newest, send_state = me.bus.latest(COMMAND), me.bus.publisher(VEHICLE_STATE)
    driver, hand = me.bus.latest(DRIVER_INPUT), load_driver()
    wire = Wire(actuator, name)
    times = Timekeeper(me.bus, me.name, me.now_s)
    me.ready(values=wire.values)
    ticker, known = Ticker(RATE_HZ), 0
    while me.running():
        ticker.sleep()
        ticker.due()
        fresh = newest.take()
        driver.take()
        now_s = me.now_s()
        demand = arbitrate(
            newest.message,
            newest.received_s,
            driver.message,
            driver.received_s,
            required=hand.required,
            timeout_s=hand.timeout_s,
            now_s=now_s,
        )
        state = wire.read(now_s)
        failed, known = wire.failures > known, wire.failures
        applied = node.step(demand.command, demand.received_s, state, refused=failed, now_s=now_s)
        wire.write(applied.command, now_s)
        if fresh is not None:
            times.note(fresh.t_s, newest, began_s=now_s)
        send_state(reported(applied.state, demand))
        if failed or wire.failures > known:
            me.stepped(Health.ERROR, f"actuator {name}: {wire.last}")
        elif state is None:
            me.stepped(Health.WARN, f"actuator {name}: the car reports no state")
        elif demand.reason:
            me.stepped(Health.WARN, demand.reason)
        else:
            me.stepped()


if __name__ == "__main__":
    with process() as me:
        run(me)
