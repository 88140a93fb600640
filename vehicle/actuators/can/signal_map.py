"""The map of signals checked against its DBC, as frames to send and to receive."""

from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml.comments import CommentedMap

from controller.limiter import Limits
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, fault_line, load, parse, read
from trepid.spelling import did_you_mean
from vehicle.actuators.can.checksums import WHOLE_BYTE
from vehicle.actuators.can.dbc import Dbc, Selector
from vehicle.actuators.can.frames import WORD, Receiver, Sender, raw_range, to_signal
from vehicle.actuators.can.settings import (
    ROAD_WHEEL,
    STEERING_WHEEL,
    CanMap,
    CommandMessage,
    CommandSignal,
    ReportMessage,
    ReportSignal,
)

STEERING = {ROAD_WHEEL, STEERING_WHEEL}
LONGITUDINAL = {"speed_mps", "accel_mps2", "drive_mps2"}
HONDA_BITS = 4
Place = tuple[str | int, ...]
Either = CommandMessage | ReportMessage


class SignalMap(NamedTuple):
    """A checked map with its messages of the DBC."""

    settings: CanMap
    messages: dict[str, Any]  # of cantools, by name
    selectors: dict[str, Selector]  # of the messages whose mapped signals are not in every frame

    def senders(self) -> list[Sender]:
        """The commands as frames to send."""
        return [self.sender(each) for each in self.settings.commands]

    def receivers(self) -> list[Receiver]:
        """The reports as frames to receive."""
        return [self.receiver(each) for each in self.settings.reports]

    def sender(self, mapped: Either) -> Sender:
        """``mapped`` as a frame to send."""
        constants = mapped.constants if isinstance(mapped, CommandMessage) else {}
        message = self.messages[mapped.message]
        return Sender(mapped, mapped.signals, constants, message, self.selectors.get(mapped.message))

    def receiver(self, mapped: Either) -> Receiver:
        """``mapped`` as a frame to receive."""
        message = self.messages[mapped.message]
        return Receiver(mapped, mapped.signals, message, self.selectors.get(mapped.message))


def load_map(path: Path, vehicle: Vehicle) -> SignalMap:
    """The map in ``path`` with its DBC.

    Raises InputError with the place in the map: for a DBC that cannot be read, a message or signal that it does
    not have, a value that a signal cannot hold, a field that is used twice, and a missing command or report; with
    the place in the DBC for a fault in a mapped message. A fault in other parts of the DBC is none.
    """
    data = read(path)
    settings = parse(data, CanMap, source=path)
    check = _Check(path, data, _database(path, data, settings))
    ranges = _ranges(vehicle)
    for k, command in enumerate(settings.commands):
        check.message(("commands", k), command, ranges)
    for k, report in enumerate(settings.reports):
        check.message(("reports", k), report, _angles(ranges))
    check.completeness(settings)
    return SignalMap(settings, check.messages, check.selectors)


def _database(path: Path, data: CommentedMap, settings: CanMap) -> Dbc:
    file = path.parent / settings.dbc
    try:
        dbc = Dbc(file)
    except InputError as error:
        raise InputError(fault_line(("dbc",), str(error), data, path)) from error
    if not dbc.messages:
        raise InputError(
            fault_line(("dbc",), f"{file}: is no DBC: no line `BO_ <id> <name>: ...`", data, path)
        )
    return dbc


def _ranges(vehicle: Vehicle) -> dict[str, tuple[float, float]]:
    """Range of each quantity that the limiter may command [SI]."""
    limits = load(CONFIG_DIR / "limiter.yaml", Limits)
    wheel_rad = vehicle.max_road_wheel_angle_rad
    column_rad = wheel_rad * vehicle.steering_ratio
    return {
        ROAD_WHEEL: (-wheel_rad, wheel_rad),
        STEERING_WHEEL: (-column_rad, column_rad),
        "accel_mps2": (-limits.max_decel_mps2, limits.max_accel_mps2),
        "drive_mps2": (0.0, limits.max_accel_mps2),
        "brake_mps2": (0.0, limits.max_decel_mps2),
        "engaged": (0.0, 1.0),
    }


def _angles(ranges: dict[str, tuple[float, float]]) -> dict[str, tuple[float, float]]:
    return {name: ends for name, ends in ranges.items() if name in STEERING}


def _signal_names(mapped: Either) -> set[str]:
    names = {each.signal for each in mapped.signals}
    names |= {each.signal for each in (mapped.counter, mapped.checksum) if each is not None}
    return names | (set(mapped.constants) if isinstance(mapped, CommandMessage) else set())


class _Check:
    """Checks of one map against its DBC; each fault is an InputError with its place in the map."""

    def __init__(self, path: Path, data: CommentedMap, dbc: Dbc) -> None:
        self._path, self._data, self._dbc = path, data, dbc
        self.messages: dict[str, Any] = {}
        self.selectors: dict[str, Selector] = {}

    def _wrong(self, where: Place, what: str) -> InputError:
        return InputError(fault_line(where, what, self._data, self._path))

    def message(self, where: Place, mapped: Either, ranges: dict[str, tuple[float, float]]) -> None:
        """Check one message; ``ranges`` [SI] must fit into its signals."""
        name = mapped.message
        if name not in self._dbc.messages:
            hint = did_you_mean(name, self._dbc.messages)
            raise self._wrong((*where, "message"), f"the DBC has no message {name!r}; {hint}")
        if name in self.messages:
            raise self._wrong((*where, "message"), f"{name!r} has an entry already")
        names, used = _signal_names(mapped), set[str]()
        if selector := self._dbc.selector(name, names):
            self.selectors[name] = selector
            names.add(selector.signal)
        message = self.messages[name] = self._dbc.message(name, names)
        signals: tuple[CommandSignal | ReportSignal, ...] = mapped.signals
        for k, each in enumerate(signals):
            place = (*where, "signals", k)
            signal = self._signal((*place, "signal"), message, each.signal, used)
            if each.quantity in ranges:
                self._fits((*place, "signal"), each, signal, ranges[each.quantity])
        for constant, value in (mapped.constants if isinstance(mapped, CommandMessage) else {}).items():
            signal = self._signal((*where, "constants", constant), message, constant, used)
            self._holds((*where, "constants", constant), signal, value, value)
            if selector and constant == selector.signal:
                what = f"{constant!r} selects the signals of a frame, and is sent as {selector.value}"
                raise self._wrong((*where, "constants", constant), f"{what}: leave it out")
        self._protection(where, mapped, message, used)

    def _signal(self, where: Place, message: Any, name: str, used: set[str]) -> Any:
        known = self._dbc.signals(message.name)
        if name not in known:
            raise self._wrong(where, f"{message.name} has no signal {name!r}; {did_you_mean(name, known)}")
        if name in used:
            raise self._wrong(where, f"signal {name!r} is used twice")
        used.add(name)
        return message.get_signal_by_name(name)

    def _fits(
        self, where: Place, each: CommandSignal | ReportSignal, signal: Any, ends: tuple[float, float]
    ) -> None:
        low, high = sorted(to_signal(each, end) for end in ends)
        self._holds(where, signal, low, high)

    def _holds(self, where: Place, signal: Any, low: float, high: float) -> None:
        least, most = raw_range(signal)
        step = abs(signal.scale) / 2  # rounding
        if low < least - step or high > most + step:
            unit = f" {signal.unit}" if signal.unit else ""
            needed = f"{low:g}" if low == high else f"{low:g} to {high:g}"
            raise self._wrong(
                where, f"signal {signal.name!r} holds {least:g} to {most:g}{unit}, {needed} is needed"
            )

    def _protection(self, where: Place, mapped: Either, message: Any, used: set[str]) -> None:
        if mapped.counter is not None:
            place: Place = (*where, "counter", "signal")
            signal = self._signal(place, message, mapped.counter.signal, used)
            self._plain(place, signal)
            if mapped.counter.modulo is not None:
                self._holds((*where, "counter", "modulo"), signal, 0, mapped.counter.modulo - 1)
        if mapped.checksum is None:
            return
        place, algorithm = (*where, "checksum", "signal"), mapped.checksum.algorithm
        signal = self._signal(place, message, mapped.checksum.signal, used)
        self._plain(place, signal)
        corner = WORD - 1 if signal.byte_order == "big_endian" else 0
        if algorithm in WHOLE_BYTE and (signal.length != WORD or signal.start % WORD != corner):
            raise self._wrong(place, f"{algorithm} fills one whole byte, and {signal.name!r} does not")
        if algorithm == "honda" and signal.length != HONDA_BITS:
            raise self._wrong(place, f"honda has {HONDA_BITS} bits, {signal.name!r} has {signal.length}")

    def _plain(self, where: Place, signal: Any) -> None:
        if signal.is_signed or signal.scale != 1 or signal.offset != 0:
            raise self._wrong(where, f"signal {signal.name!r} must be an unsigned number without scale")

    def completeness(self, settings: CanMap) -> None:
        """Raise InputError when the map does not steer, does not drive, or does not report speed and angle."""
        sent = {each.quantity for mapped in settings.commands for each in mapped.signals}
        reported = {each.quantity for mapped in settings.reports for each in mapped.signals}
        for where, names, known in (
            ("commands", STEERING, sent),
            ("commands", LONGITUDINAL, sent),
            ("reports", {"speed_mps"}, reported),
            ("reports", STEERING, reported),
        ):
            if names.isdisjoint(known):
                raise self._wrong((where,), f"no signal has the quantity {' or '.join(sorted(names))}")
        if "drive_mps2" in sent and sent.isdisjoint({"brake_mps2", "accel_mps2"}):
            raise self._wrong(
                ("commands",), "no signal brakes: the quantity brake_mps2 or accel_mps2 is missing"
            )
