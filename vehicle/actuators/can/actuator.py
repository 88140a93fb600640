"""The CAN actuator: commands as the messages of a map of signals, and the reports of the car as its state."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import ClassVar, NamedTuple

from trepid.messages import Command, VehicleState
from vehicle.actuators.actuator import INVALID, Car
from vehicle.actuators.can.frames import Receiver, Sender
from vehicle.actuators.can.quantities import largest, of_command, to_state
from vehicle.actuators.can.settings import (
    OVERRIDE,
    ROAD_WHEEL,
    STEERING_WHEEL,
    CanMap,
    CanSettings,
    ReportMessage,
)
from vehicle.actuators.can.signal_map import load_map
from vehicle.actuators.can.wire import CanWire

PAUSE_S = 0.1  # after a longer time without reading, the frames that waited have no known age
LAST_FRAMES = 3  # of the safe state: a receiver that misses one gets another
EARLY = 0.5  # of the writing period: a message is sent in the step nearest to its time
STEP_S = 0.01


class Report(NamedTuple):
    """The newest intact frame of one message."""

    quantities: dict[str, float]  # [SI]
    invalid: dict[str, str]  # quantity that the sender calls invalid -> message, signal and value
    received_s: float


class CanActuator:
    """Sends every message of the map at its period from ``write``, without a thread.

    A process that hangs therefore sends nothing, and the car notices the silence.
    """

    Settings: ClassVar[type[CanSettings]] = CanSettings

    def __init__(self, settings: CanSettings, car: Car) -> None:
        """Raises InputError for a map that does not fit its DBC, and for a bus that cannot be opened."""
        signals = load_map(settings.map_file, car.vehicle)
        self._map: CanMap = signals.settings
        self._ratio = car.vehicle.steering_ratio
        receivers = signals.receivers()
        self._reports = Reports(self._map.reports, receivers, steering_ratio=self._ratio)
        self._senders = signals.senders()
        self._next_s = [0.0] * len(self._senders)
        self._read_s: float | None = None
        self._last: Command | None = None
        self._engaged = False
        self._wire = CanWire(settings, receivers)

    def read(self, *, now_s: float) -> VehicleState | None:
        """State of the newest reports; None while a message with speed, angle or driver is silent.

        Frames that waited through a pause of this process are dropped: their age is not known. Raises OSError.
        """
        paused = self._read_s is not None and now_s - self._read_s > PAUSE_S
        self._read_s = now_s
        for address, extended, data in self._wire.frames():
            if not paused:
                self._reports.take(address, extended, data, now_s=now_s)
        return self._reports.state(now_s=now_s)

    def write(self, command: Command, *, now_s: float) -> None:
        """Send the messages that are due. Raises OSError after all of them were tried.

        From the first command that is based on a frame on, the car is engaged until :meth:`close`: a later command
        without a frame is a stop of the limiter, and a car that is not engaged does not brake.
        """
        self._last = command
        self._engaged = self._engaged or command.t_s is not None
        due = [k for k, next_s in enumerate(self._next_s) if now_s >= next_s - EARLY * STEP_S]
        for k in due:
            period_s = self._map.commands[k].period_s
            late = now_s - self._next_s[k] > period_s
            self._next_s[k] = (now_s if late else self._next_s[k]) + period_s
        quantities = of_command(command, engaged=self._engaged, steering_ratio=self._ratio)
        self._send(quantities, [self._senders[k] for k in due])

    def _send(self, quantities: Mapping[str, float], senders: Sequence[Sender]) -> None:
        failure: OSError | None = None
        for sender in senders:
            try:
                self._wire.send(sender, sender.frame(quantities))
            except OSError as error:
                failure = error
        if failure is not None:
            raise failure

    def values(self) -> tuple[tuple[str, str], ...]:
        """Invalid signals by quantity, and the number of refused frames by message and reason."""
        invalid = () if self._read_s is None else self._reports.invalid(now_s=self._read_s)
        return (*invalid, *self._reports.values())

    def close(self) -> None:
        """Send the safe state: not engaged, ``safe_accel_mps2``, the last angle; nothing before the first command.

        Raises OSError when it was never sent wholly.
        """
        try:
            if self._last is not None:
                end = replace(self._last, speed_mps=0.0, accel_mps2=self._map.safe_accel_mps2)
                quantities = of_command(end, engaged=False, steering_ratio=self._ratio)
                self._send_repeatedly(quantities)
        finally:
            self._wire.close()

    def _send_repeatedly(self, quantities: Mapping[str, float]) -> None:
        """Send all messages ``LAST_FRAMES`` times, about a period apart: a full queue empties meanwhile.

        Raises OSError when none of these rounds was sent wholly.
        """
        failures: list[OSError] = []
        for number in range(LAST_FRAMES):
            if number:
                time.sleep(min(message.period_s for message in self._map.commands))
            try:
                self._send(quantities, self._senders)
            except OSError as error:
                failures.append(error)
        if len(failures) == LAST_FRAMES:
            raise failures[-1]


class Reports:
    """The newest quantities of each report of the car, with the time of their arrival."""

    ESSENTIAL: ClassVar = frozenset(
        {
            "speed_mps",
            "road_wheel_angle_rad",
            "steering_wheel_angle_rad",
            "driver_override",
            "driver_torque_nm",
        }
    )

    def __init__(
        self, mapped: Sequence[ReportMessage], receivers: Sequence[Receiver], *, steering_ratio: float
    ) -> None:
        self._ratio = steering_ratio
        self._receivers = {(each.address, each.extended): k for k, each in enumerate(receivers)}
        self._all = list(receivers)
        self._timeouts_s = [each.timeout_s for each in mapped]
        self._needed = [any(signal.quantity in self.ESSENTIAL for signal in each.signals) for each in mapped]
        self._newest: list[Report | None] = [None] * len(receivers)

    def take(self, address: int, extended: bool, data: bytes, *, now_s: float) -> None:
        """Keep the quantities of a frame of the map that its checks accept."""
        k = self._receivers.get((address, extended))
        if k is None:
            return
        found = self._all[k].quantities(data)
        if found is not None:
            self._newest[k] = Report(found, self._all[k].invalid, now_s)

    def state(self, *, now_s: float) -> VehicleState | None:
        """The state, dated with its oldest part.

        A message that is silent beyond its timeout has no quantities; without one of speed, wheel angle, torque or
        override of the driver there is no state: an override that is not known is not "no override". A quantity
        that its sender calls invalid is absent at once, and doubted; an override likewise leaves no state.
        """
        quantities: list[tuple[str, float]] = []
        invalid: set[str] = set()
        oldest_s = now_s
        for newest, timeout_s, needed in zip(self._newest, self._timeouts_s, self._needed, strict=True):
            if newest is None or now_s - newest.received_s > timeout_s:
                if needed:
                    return None
                continue
            quantities += newest.quantities.items()
            invalid.update(newest.invalid)
            oldest_s = min(oldest_s, newest.received_s)
        known = largest(quantities)
        if OVERRIDE in invalid and not known.get(OVERRIDE):
            return None
        lacking = {ROAD_WHEEL if name == STEERING_WHEEL else name for name in invalid - set(known)}
        state = to_state(known, steering_ratio=self._ratio, t_s=oldest_s)
        return replace(state, doubted=tuple(sorted(lacking))) if lacking else state

    def invalid(self, *, now_s: float) -> tuple[tuple[str, str], ...]:
        """Every quantity that its sender calls invalid now, and its message, signal and value."""
        return tuple(
            (INVALID + quantity, text)
            for newest, timeout_s in zip(self._newest, self._timeouts_s, strict=True)
            if newest is not None and now_s - newest.received_s <= timeout_s
            for quantity, text in newest.invalid.items()
        )

    def values(self) -> tuple[tuple[str, str], ...]:
        """Number of refused frames by message and reason."""
        return tuple(
            (f"refused {receiver.name} {why}", str(count))
            for receiver in self._all
            for why, count in receiver.refused.items()
        )
