"""Messages of a DBC as frames: quantities to bytes with counter and checksum, and back with their checks."""

import math
from collections import Counter as Counts
from collections.abc import Mapping, Sequence
from typing import Any

from vehicle.actuators.can.checksums import checksum
from vehicle.actuators.can.dbc import Selector
from vehicle.actuators.can.invalid import InvalidValues
from vehicle.actuators.can.quantities import largest
from vehicle.actuators.can.settings import Conversion, MessageMapping

MOST_LOST = 2  # consecutive messages that may be lost without a wrong counter
RIGHT_AGAIN = 3  # consecutive right counters after a wrong one before a message counts again
WORD = 8


def raw_range(signal: Any) -> tuple[float, float]:
    """Smallest and largest value that a signal of cantools holds, in its units: by bits and stated range."""
    bits = signal.length
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signal.is_signed else (0, (1 << bits) - 1)
    ends = sorted(raw * signal.scale + signal.offset for raw in (low, high))
    stated_low = -math.inf if signal.minimum is None else signal.minimum
    stated_high = math.inf if signal.maximum is None else signal.maximum
    if stated_low >= stated_high:  # [0|0] stands for no range
        return ends[0], ends[1]
    return max(ends[0], stated_low), min(ends[1], stated_high)


def to_signal(conversion: Conversion, quantity: float) -> float:
    """The quantity [SI] in units of the signal."""
    return conversion.sign * conversion.scale * quantity + conversion.offset


def to_quantity(conversion: Conversion, value: float) -> float:
    """The value of a signal as its quantity [SI]."""
    return conversion.sign * (value - conversion.offset) / conversion.scale


class Protection:
    """Counter and checksum of one message; ``message`` is that of cantools."""

    def __init__(self, mapped: MessageMapping, message: Any) -> None:
        self._message = message
        self._checksum = mapped.checksum
        self.counter = mapped.counter.signal if mapped.counter else None
        self.modulo = 1
        if mapped.counter is not None:
            bits = message.get_signal_by_name(mapped.counter.signal).length
            self.modulo = mapped.counter.modulo or 1 << bits
        if self._checksum is not None:
            self._field = message.get_signal_by_name(self._checksum.signal)
            self._cover = self._bits_of_field()

    def seal(self, values: dict[str, float]) -> bytes:
        """Bytes of ``values`` with their checksum."""
        if self._checksum is None:
            return bytes(self._message.encode(values, strict=False))
        name = self._checksum.signal
        data = bytes(self._message.encode({**values, name: 0}, strict=False))
        return bytes(self._message.encode({**values, name: self._compute_checksum(data)}, strict=False))

    def intact(self, data: bytes, values: Mapping[str, Any]) -> bool:
        """Whether the checksum in ``data``, of which ``values`` were decoded, is right."""
        if self._checksum is None:
            return True
        zeroed = bytes(byte & ~cover for byte, cover in zip(data, self._cover, strict=True))
        return int(values[self._checksum.signal]) == self._compute_checksum(zeroed)

    def _bits_of_field(self) -> bytes:
        """The bits of the checksum, as ones."""
        ones = (1 << self._field.length) - 1
        zero = {signal.name: 0 for signal in self._message.signals}
        return bytes(self._message.encode({**zero, self._field.name: ones}, scaling=False, strict=False))

    def _compute_checksum(self, data: bytes) -> int:
        assert self._checksum is not None
        return checksum(
            self._checksum.algorithm,
            self._message.frame_id,
            data,
            bits=self._field.length,
            byte=self._field.start // WORD,
            data_id=self._checksum.data_id,
        )


class Sender:
    """A message that is sent: quantities to bytes."""

    def __init__(
        self,
        mapped: MessageMapping,
        conversions: Sequence[Any],
        constants: Mapping[str, float],
        message: Any,
        selector: Selector | None = None,
    ) -> None:
        self.address: int = message.frame_id
        self.extended: bool = message.is_extended_frame
        self.fd: bool = message.is_fd
        self._protection = Protection(mapped, message)
        self._conversions = [
            (each, raw_range(message.get_signal_by_name(each.signal))) for each in conversions
        ]
        self._invalid = {each.signal: _invalid_value(message, each.signal) for each in conversions}
        self._rest = {signal.name: float(signal.offset) for signal in message.signals} | dict(constants)
        if selector is not None:
            chosen = message.get_signal_by_name(selector.signal)
            self._rest[selector.signal] = selector.value * chosen.scale + chosen.offset
        self._count = 0

    def frame(self, quantities: Mapping[str, float]) -> bytes:
        """Bytes of ``quantities``, each at most as large as its signal holds; the counter moves on.

        A quantity that is missing is sent as the value that the DBC names invalid, else as zero.
        """
        values = dict(self._rest)
        for each, (low, high) in self._conversions:
            if each.quantity not in quantities:
                values[each.signal] = self._invalid[each.signal]
                continue
            values[each.signal] = min(max(to_signal(each, quantities[each.quantity]), low), high)
        if self._protection.counter is not None:
            values[self._protection.counter] = self._count
            self._count = (self._count + 1) % self._protection.modulo
        return self._protection.seal(values)


def _invalid_value(message: Any, name: str) -> float:
    """The value that the DBC names invalid of the signal ``name``, in its units; that of zero without one."""
    signal = message.get_signal_by_name(name)
    check = InvalidValues(signal, message.protocol)
    return check.value(check.value_to_send) if check.value_to_send is not None else 0.0


class Receiver:
    """A message that arrives: bytes to quantities, refused with a wrong length, checksum or counter."""

    def __init__(
        self,
        mapped: MessageMapping,
        conversions: Sequence[Any],
        message: Any,
        selector: Selector | None = None,
    ) -> None:
        """``selector``: what tells the frames with the mapped signals; None: all frames have them."""
        self.name: str = message.name
        self._selector = selector
        only = selector.multiplexed if selector else frozenset[str]()
        self._sealed_everywhere = mapped.checksum is None or mapped.checksum.signal not in only
        self._counted_everywhere = mapped.counter is None or mapped.counter.signal not in only
        self.address: int = message.frame_id
        self.extended: bool = message.is_extended_frame
        self._length: int = message.length
        self._message = message
        self._conversions = list(conversions)
        signals = [message.get_signal_by_name(each.signal) for each in conversions]
        self._checks = [
            InvalidValues(signal, message.protocol, each.invalid)
            for each, signal in zip(conversions, signals, strict=True)
        ]
        self._protection = Protection(mapped, message)
        self._count: int | None = None
        self._distrusted = 0  # right counters that are still missing after a wrong one
        self.refused: Counts[str] = Counts()
        """Number of refused frames by reason."""
        self.invalid: dict[str, str] = {}
        """Quantity that the sender of the newest intact frame calls invalid -> message, signal and value."""

    def quantities(self, data: bytes) -> dict[str, float] | None:
        """The quantities in ``data`` [SI] but those that are ``invalid``; None for a frame that is refused.

        None, too, for a frame with other signals of a multiplexed message, which is not refused.

        The counter must be 1 to 3 ahead of that of the last intact frame: a repeated one is refused, a lost one is
        not an error. After a wrong counter three right ones in a row must come first, so that of two senders with
        one address neither counts.
        """
        if len(data) != self._length:
            self.refused["length"] += 1
            return None
        raws = self._message.decode(data, decode_choices=False, scaling=False)
        chosen = self._selector is None or raws[self._selector.signal] == self._selector.value
        if (chosen or self._sealed_everywhere) and not self._protection.intact(data, raws):
            self.refused["checksum"] += 1
            return None
        if self._protection.counter is not None and (chosen or self._counted_everywhere):
            before, self._count = self._count, int(raws[self._protection.counter])
            ahead = 1 if before is None else (self._count - before) % self._protection.modulo
            self._distrusted = max(self._distrusted - 1, 0) if 1 <= ahead <= 1 + MOST_LOST else RIGHT_AGAIN
            if self._distrusted:
                self.refused["counter"] += 1
                return None
        if not chosen:
            return None
        found: list[tuple[str, float]] = []
        self.invalid = {}
        for each, check in zip(self._conversions, self._checks, strict=True):
            raw = float(raws[each.signal])
            reason = check.reason(raw)
            if reason:
                self.invalid[each.quantity] = f"{self.name}.{each.signal}: {reason}"
            else:
                found.append((each.quantity, to_quantity(each, check.value(raw))))
        return largest(found)
