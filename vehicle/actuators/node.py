"""Actuator process: the newest command through the limiter to the wire of the car; the car's state to the bus.

The limiter and the actuator are in one process: nothing but ``write`` follows the limiter. From the first reported
wheel angle on the process writes at ``RATE_HZ``, with and without commands. When it is to end while the car moves,
by a signal or the end of the launcher, the limiter first brings the car to a standstill within ``STOP_S``; the
controller still steers. At its end, also by an error, it brings the actuator to the safe state; where it cannot,
because it was killed or is frozen, the wire falls silent, and the car itself has to stop.
"""

import errno
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple, TypeVar

from controller.limiter import Limiter
from controller.limiter import build as build_limiter
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.loudness import warn
from trepid.messages import Command, Health, VehicleState
from trepid.processes.journal import Timekeeper
from trepid.processes.process import STOP_S, Process, Ticker, process
from trepid.topics import COMMAND, DRIVER_INPUT, STOP_REQUEST, VEHICLE_STATE
from vehicle.actuators.actuator import INVALID, Actuator, Car
from vehicle.actuators.table import build as build_actuator
from vehicle.driver.arbitration import arbitrate, report_override
from vehicle.driver.settings import load_driver
from vehicle.driver.stop_button import STOPPED, StopButton
from vehicle.measurement.check import MeasurementCheck, absent
from vehicle.measurement.check import build as build_check

RATE_HZ = 100.0  # of UN R79
T = TypeVar("T")


class AppliedStep(NamedTuple):
    """Result of one step."""

    command: Command | None  # for the wire; None: where the wheels stand is not known yet
    state: VehicleState  # for the bus
    doubts: tuple[str, ...] = ()  # quantities that the car reports and physics contradicts, and why


class ActuatorStep:
    """The step between bus and wire: the check of the measurements, the limiter, and the state that travels."""

    def __init__(self, limiter: Limiter, measurements: MeasurementCheck) -> None:
        self._limiter, self._measurements = limiter, measurements
        self.standstill_mps = limiter.standstill_mps
        """Below this speed the car stands [m/s]."""

    def step(
        self,
        command: Command | None,
        received_s: float | None,
        state: VehicleState | None,
        *,
        stop: bool = False,
        now_s: float,
    ) -> AppliedStep:
        """The command for the wire, and the state for the bus.

        ``received_s``: arrival of ``command``. ``state``: as the car reports it; None when it reports nothing.
        ``stop``: the process is to end, or the wire has failed since the last step, so that the car may have missed
        a command: the limiter stops the car, latched until standstill.

        Quantities that do not hold are absent for limiter and bus.

        There is no command for the wire before the first wheel angle: a process that starts while the car turns
        would straighten the wheels. An old state travels with its own time. An absent state travels as such, with
        all quantities None.
        """
        if stop:
            self._limiter.stopping = True
        state, doubts = self._measurements.step(state, driver=self._limiter.handed_over, now_s=now_s)
        limited = self._limiter.step(command, received_s, state, now_s=now_s)
        reported = self._limiter.report(absent(now_s) if state is None else state)
        applied = limited if self._limiter.has_seen_wheel else None
        self._measurements.add_command(applied)
        return AppliedStep(applied, reported, doubts)

    @property
    def stop_reason(self) -> str:
        """Why the limiter stops the car of its own accord; "" while it does not."""
        return self._limiter.stop_reason

    def moves(self, state: VehicleState) -> bool:
        """True while the car of ``state`` moves and no driver has it."""
        speed_mps = state.speed_mps or 0.0
        return abs(speed_mps) > self.standstill_mps and not state.driver_override


class Wire:
    """An actuator whose failures are counted; each is reported, none ends the loop."""

    def __init__(self, actuator: Actuator, name: str) -> None:
        self._actuator = actuator
        self._name = name
        self.failures = 0
        self.last = ""
        """The last failure, as text."""

    def read(self, now_s: float) -> VehicleState | None:
        """State of the car; None also when the wire fails, which includes anything that is no state."""
        return self._attempt(lambda: self._state(now_s))

    def _state(self, now_s: float) -> VehicleState | None:
        state = self._actuator.read(now_s=now_s)
        if state is not None and not isinstance(state, VehicleState):
            raise OSError(errno.EBADMSG, f"read returned a {type(state).__name__}, not a VehicleState")
        return state

    def write(self, command: Command, now_s: float) -> None:
        """Send ``command``; a failure counts, and the next call sends the next command."""
        self._attempt(lambda: self._actuator.write(command, now_s=now_s))

    def values(self) -> tuple[tuple[str, str], ...]:
        """Values for the heartbeat."""
        counted = (("wire_failures", str(self.failures)),) if self.failures else ()
        return (("actuator", self._name), *counted, *self._actuator.values())

    def invalid(self) -> str:
        """The quantities that their sender calls invalid, and why, as one text."""
        reasons = [f"{name} {why}" for name, why in self._actuator.values() if name.startswith(INVALID)]
        return "; ".join(reasons)

    def _attempt(self, act: Callable[[], T]) -> T | None:
        try:
            return act()
        except OSError as error:
            self.failures += 1
            self.last = " ".join(str(error).split()) or type(error).__name__
            return None


@contextmanager
def safe_at_end(actuator: Actuator) -> Iterator[None]:
    """Bring ``actuator`` to its safe state at the end of the body, whatever ends it.

    When the wire refuses that, a line on standard error says so; the car then has to stop by itself.
    """
    try:
        yield
    finally:
        try:
            actuator.close()
        except OSError as error:
            warn(f"actuator: the safe state was not sent: {error}")


def run(me: Process) -> None:
    """Read, step, write and publish until the process is to stop, and then until the car stands."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    name, actuator = build_actuator(Car(vehicle, me.bus, me.now_s))
    with safe_at_end(actuator):
        computed = frozenset(getattr(actuator, "computed", ()))
        node = ActuatorStep(build_limiter(vehicle), build_check(vehicle, computed=computed))
        loop = Loop(me, actuator, name, node)
        ticker = Ticker(RATE_HZ)
        while me.running():
            ticker.sleep()
            ticker.due()
            loop.turn()
        until_s = me.now_s() + STOP_S
        while loop.moving and me.now_s() < until_s:
            ticker.sleep()
            ticker.due()
            loop.turn(ending=True)


class Loop:
    """Bus and wire around the step."""

    def __init__(self, me: Process, actuator: Actuator, name: str, node: ActuatorStep) -> None:
        self._me, self._name, self._node = me, name, node
        self._newest, self._send_state = me.bus.latest(COMMAND), me.bus.publisher(VEHICLE_STATE)
        self._driver, settings = me.bus.latest(DRIVER_INPUT), load_driver()
        self._driver_required = settings.required or me.has_publisher(DRIVER_INPUT)
        self._driver_timeout_s = settings.timeout_s
        self._stop_request = me.bus.latest(STOP_REQUEST)
        self._button = StopButton(node.standstill_mps)
        self._wire = Wire(actuator, name)
        self._times = Timekeeper(me.bus, me.name, me.now_s)
        self._known = 0  # failures of the wire up to the last turn
        self.moving = False
        """The car moves and no driver has it, by its newest state with a speed."""
        me.ready(values=self._wire.values)

    def turn(self, *, ending: bool = False) -> None:
        """Read, step, write and publish once. ``ending``: the limiter stops the car; new commands steer it."""
        newest, driver, wire = self._newest, self._driver, self._wire
        fresh = newest.take()
        driver.take()
        now_s = self._me.now_s()
        demand = arbitrate(
            newest.message,
            newest.received_s,
            driver.message,
            driver.received_s,
            required=self._driver_required,
            timeout_s=self._driver_timeout_s,
            now_s=now_s,
        )
        state = wire.read(now_s)
        failed, self._known = wire.failures > self._known, wire.failures
        button = self._button
        button.hear(self._stop_request.take(), state, now_s=now_s)
        applied = self._node.step(
            button.permit(demand.command),
            demand.received_s,
            state,
            stop=failed or ending or button.stops,
            now_s=now_s,
        )
        if applied.command is not None:
            wire.write(applied.command, now_s)
        if fresh is not None:
            self._times.note(fresh.t_s, newest, began_s=now_s)
        if applied.state.speed_mps is not None:
            self.moving = self._node.moves(applied.state)
        self._send_state(replace(report_override(applied.state, demand), stop_pressed=button.held))
        lacking = not failed and (state is None or bool(state.doubted))
        invalid = self._wire.invalid() if lacking else ""
        doubted = "; ".join(filter(None, (invalid, *applied.doubts)))
        self._me.count_step(*self._condition(failed, state, demand.reason, doubted, ending=ending))

    def _condition(
        self, failed: bool, state: VehicleState | None, reason: str, doubted: str, *, ending: bool
    ) -> tuple[Health, str]:
        """Health and message of the heartbeat.

        A message begins with STOPPED while the button holds the car, else with why the limiter stops it.
        """
        stopped = STOPPED if self._button.held else self._node.stop_reason
        if failed or self._wire.failures > self._known:
            health, text = Health.ERROR, f"actuator {self._name}: {self._wire.last}"
        elif state is None:
            why = doubted or "the car reports no state"
            health, text = Health.WARN, f"actuator {self._name}: {why}"
        elif ending:
            health, text = Health.WARN, "stops the car before it ends"
        else:
            text = "; ".join(filter(None, (reason, doubted)))
            health = Health.WARN if text or stopped else Health.OK
        return health, "; ".join(filter(None, (stopped, text)))


if __name__ == "__main__":
    with process() as me:
        run(me)
