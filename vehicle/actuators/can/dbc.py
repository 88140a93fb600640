"""Messages of a DBC, read one at a time: a fault in the rest of the file is no fault of what a map uses.

Real DBC files carry overlapping signals, values of messages that were deleted, identifiers without the bit of an
extended frame and comments without an address. cantools refuses the whole file for any of them. Here the file is
split into statements; the mapped signals of one message, with their values, types and the attributes of the frame,
are left in place, all else is blanked, and cantools reads this rest strictly.
"""

import re
from collections.abc import Iterator, Set
from pathlib import Path
from typing import Any, NamedTuple

import cantools

from trepid.config import InputError, read_text
from vehicle.actuators.can.invalid import INVALID_ATTRIBUTES

_KEYWORDS = (
    *("VERSION", "NS_", "BS_", "BU_", "BO_", "SG_", "EV_", "CM_", "VAL_", "VAL_TABLE_", "BO_TX_BU_"),
    *("BA_", "BA_DEF_", "BA_DEF_DEF_", "BA_DEF_SGTYPE_", "BA_SGTYPE_", "BA_REL_", "BA_DEF_REL_"),
    *("BA_DEF_DEF_REL_", "SIG_VALTYPE_", "SIG_TYPE_REF_", "SIG_GROUP_"),
    *("SG_MUL_VAL_", "SGTYPE_", "ENVVAR_DATA_"),
)
_MARK = re.compile(
    r"//[^\n]*"
    r'|(?P<comment>^[ \t]*CM_\s[^";]*"(?:\\"|[^"])*"\s*;)'  # it alone may reach over several lines
    r'|"(?:\\"|[^"\n])*"'
    r"|(?P<end>;)"
    rf"|(?P<keyword>^[ \t]*(?:{'|'.join(_KEYWORDS)})(?![^\s:]))",
    re.MULTILINE,
)
_MESSAGE = re.compile(r"\s*BO_\s+(?P<id>\d+)\s+(?P<name>\w+)\s*:")
_SIGNAL = re.compile(r"\s*SG_\s+(?P<name>\w+)\s*(?P<multiplex>m\d*M?|M)?\s*:\s*(?P<layout>[^\s(]*)")
_MULTIPLEX = re.compile(r"(\A\s*SG_\s+\w+\s+)(?:m\d*M?|M)(?=\s*:)")
# what stands before the nodes that send or get it
_NODES = re.compile(r'(\A\s*(?:BO_\s+\d+\s+\w+\s*:\s*\d+|SG_[^"]*"[^"]*"))([^"]*)\Z')
_NO_NODE = "Vector__XXX"
_LAYOUT = re.compile(r"(?P<start>\d+)\|(?P<length>\d+)@(?P<order>[01])[+-]")
_RANGES = re.compile(r"\s*SG_MUL_VAL_\s+(?P<id>\d+)\s+(?P<name>\w+)\s+\w+\s+(?P<ranges>[^;]*)")
_VALUES = re.compile(r"(?P<head>\s*VAL_\s+\d+\s+(?P<name>\w+))(?P<values>.*?);?\s*\Z", re.DOTALL)
_TABLE = re.compile(r"\s*VAL_TABLE_\s+(?P<name>\w+)\s(?P<values>.*?);?\s*\Z", re.DOTALL)
_OF_SIGNAL = re.compile(r"\s*(?:VAL_|SIG_VALTYPE_)\s+(?P<id>\d+)\s+(?P<name>\w+)")
_ATTRIBUTE = re.compile(
    r'\s*(?:BA_DEF_|BA_DEF_DEF_|BA_)\s+(?:BO_\s+|SG_\s+)?"(?P<attribute>\w+)"'
    r"(?:\s+(?:BO_|SG_)\s+(?P<id>\d+)(?:\s+(?P<name>\w+))?)?"
)
_ENUM_TEXT = re.compile(r'(\A\s*BA_\s+"(\w+)"\s+(?:BO_\s+\d+|SG_\s+\d+\s+\w+)?\s*)"([^"]*)"')
_TYPE = re.compile(r"(\A\s*SIG_VALTYPE_\s+\d+\s+\w+\s+)(?=\d)")  # without the colon of CANdb++
_WHOLE = re.compile(r'"[^"]*"|(-?\d+)\.0*(?=\s)|(0[xX][0-9a-fA-F]+)(?=\s)')  # raw values 255.0 and 0xFF
_LONG = re.compile(
    r'\s*BA_\s+"System(?:Message|Signal)LongSymbol"\s+(?:BO_|SG_)\s+(?P<id>\d+)\s+(?P<rest>.*)', re.DOTALL
)
_LONG_NAME = re.compile(r'(?:(?P<short>\w+)\s+)?"(?P<long>\w+)"')
_USED_ATTRIBUTES = {
    *("VFrameFormat", "BusType", "ProtocolType", "SystemMessageLongSymbol", "SystemSignalLongSymbol"),
    *INVALID_ATTRIBUTES,
}
_SYNTAX = re.compile(r'Invalid syntax at line (\d+), column (\d+): "(.*)"', re.DOTALL)
_NO_MESSAGE = "VECTOR__INDEPENDENT_SIG_MSG"  # holds the signals that are in no message
_BYTE = 8
_FLOAT_BITS = (16, 32, 64)
_EXTENDED, _MOST_STANDARD = 1 << 31, 0x7FF


class _Signal(NamedTuple):
    """One ``SG_`` of a message."""

    name: str
    statement: int  # number of its statement
    multiplex: str  # "M" selects, "m3" is in the frames whose selector is 3; "" and a bare "m" are in all
    bits: Set[int]  # byte · 8 + bit; empty where the layout cannot be read

    @property
    def value(self) -> str:
        """The value of the selector in the frames with this signal; "" where it is in all frames."""
        return self.multiplex.strip("mM")


class Selector(NamedTuple):
    """The signal whose value says which multiplexed signals a frame holds."""

    signal: str
    value: int  # raw, in the frames with the mapped signals
    multiplexed: Set[str]  # mapped signals that are only in these frames


class _Message(NamedTuple):
    """One ``BO_`` with its signals."""

    identifier: int  # as written: with bit 31 for an extended frame
    statement: int
    signals: list[_Signal]


class Dbc:
    """A DBC file: what messages and signals it names, and single messages of it."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when the text cannot be read. A file that is no DBC has no ``messages``."""
        self._path = path
        self._text = read_text(path, windows=True)
        self._statements = list(_statements(self._text))
        self._messages: dict[str, list[_Message]] = {}
        self._long_signals: dict[tuple[int, str], str] = {}  # message, short name -> long name
        self._ranges: dict[tuple[int, str], str] = {}  # message, short name -> values of its selector
        self._tables: dict[str, str] = {}  # of named values, which a signal may have by their name
        self._index()

    def _index(self) -> None:
        newest: _Message | None = None
        long_messages: dict[int, str] = {}
        found_messages: list[tuple[str, _Message]] = []
        for number, (start, end) in enumerate(self._statements):
            text = self._text[start:end]
            if found := _MESSAGE.match(text):
                newest = _Message(int(found["id"]), number, [])
                found_messages.append((found["name"], newest))
            elif (found := _SIGNAL.match(text)) and newest is not None:
                signal = _Signal(found["name"], number, found["multiplex"] or "", _bits(found["layout"]))
                newest.signals.append(signal)
            elif text.lstrip().startswith("BO_ "):
                newest = None  # one that cannot be read: its signals belong to no message
            elif found := _RANGES.match(text):
                self._ranges[int(found["id"]), found["name"]] = found["ranges"].strip()
            elif found := _TABLE.match(text):
                self._tables[found["name"]] = _plain_values(found["values"])
            elif (found := _LONG.match(text)) and (named := _LONG_NAME.match(found["rest"])):
                if named["short"]:
                    self._long_signals[int(found["id"]), named["short"]] = named["long"]
                else:
                    long_messages[int(found["id"])] = named["long"]
        for short, message in found_messages:
            if short != _NO_MESSAGE:
                name = long_messages.get(message.identifier, short)
                self._messages.setdefault(name, []).append(message)

    @property
    def messages(self) -> Set[str]:
        """The names of all messages."""
        return self._messages.keys()

    def signals(self, message: str) -> list[str]:
        """The names of the signals of ``message``, in the order of the file."""
        first = self._messages[message][0]
        return [self._name(first, signal) for signal in first.signals]

    def selector(self, name: str, signals: Set[str]) -> Selector | None:
        """What tells the frames of the message ``name`` that hold its ``signals``; None where all of them do.

        Raises InputError, with the place in the file, where no frame holds all of them, and for extended
        multiplexing: a selector that is multiplexed itself, or a signal that several of its values select.
        """
        message = self._messages[name][0]
        some = [each for each in message.signals if self._name(message, each) in signals and each.value]
        if not some:
            return None
        first = some[0]
        for other in some:
            names = f"{first.name} and {other.name}"
            ranges = self._ranges.get((message.identifier, other.name), f"{other.value}-{other.value}")
            if ranges != f"{other.value}-{other.value}":
                what = f"signal {other.name} of message {name} is there for the selectors {ranges}"
                raise self._wrong(other.statement, f"{what} (SG_MUL_VAL_): expected one value")
            if other.multiplex.endswith("M"):
                what = f"signal {other.name} of message {name} is a selector that is multiplexed itself"
                raise self._wrong(other.statement, f"{what}: not supported")
            if other.value != first.value:
                what = f"no frame of message {name} holds both {names}: their selector is {first.value} or"
                raise self._wrong(other.statement, f"{what} {other.value}")
        selecting = [each for each in message.signals if each.multiplex.endswith("M")]
        if len(selecting) != 1 or selecting[0].multiplex != "M":
            what = f"signal {first.name} of message {name} is multiplexed by {len(selecting)} selectors"
            raise self._wrong(first.statement, f"{what}: expected one")
        multiplexed = {self._name(message, each) for each in some}
        return Selector(self._name(message, selecting[0]), int(first.value), multiplexed)

    def message(self, name: str, signals: Set[str]) -> Any:
        """The message ``name`` of cantools with those of its ``signals`` that the file has, and no others.

        A frame holds all of them, as one does whose selector has the value of :meth:`selector`. Bits of
        other signals are zero in a frame that is sent. Raises InputError, with the place in the file, for a
        message that is there twice, a signal of ``signals`` that shares a bit with another one of its
        message or is there twice, and for what cantools refuses in these parts: wrong syntax, an identifier
        of more than 11 bits without bit 31, a signal that is longer than its message.
        """
        message, *others = self._messages[name]
        if others:
            raise self._wrong(
                others[0].statement,
                f"message {name} is there already in line {self._line(message.statement)}",
            )
        if _MOST_STANDARD < message.identifier < _EXTENDED:
            extended = f"without bit 31; as an extended frame it is {message.identifier | _EXTENDED}"
            what = f"the identifier {message.identifier} of message {name} has more than 11 bits {extended}"
            raise self._wrong(message.statement, what)
        used = [signal for signal in message.signals if self._name(message, signal) in signals]
        for signal in used:
            self._is_alone(name, message, signal)
        text = self._reduce(message, {signal.name for signal in used})
        try:
            database: Any = cantools.database.load_string(text, database_format="dbc", strict=True)
        except (cantools.Error, ValueError, KeyError) as error:
            if found := _SYNTAX.search(str(error)):
                line, column, near = found.groups()
                what = f"message {name}: wrong syntax of a DBC: {' '.join(near.split())}"
                raise InputError(f"{self._path}:{line}:{column}: {what}") from error
            what = str(error).removeprefix('DBC: "').removesuffix('"')
            raise self._wrong(message.statement, " ".join(what.split())) from error
        found = database.messages[0]
        if _is_j1939(database, found):
            found.protocol = "j1939"
        for signal in used:
            self._check_number(signal, found.get_signal_by_name(self._name(message, signal)))
        return found

    def _name(self, message: _Message, signal: _Signal) -> str:
        return self._long_signals.get((message.identifier, signal.name), signal.name)

    def _check_number(self, signal: _Signal, read: Any) -> None:
        """Raise InputError where no number can be had of a signal."""
        if read.is_float and read.length not in _FLOAT_BITS:
            what = f"signal {signal.name} is a float (SIG_VALTYPE_) of {read.length} bits: expected 32 or 64"
            raise self._wrong(signal.statement, what)
        if not read.scale:
            what = f"signal {signal.name} has the factor 0, and so the same value for all bits"
            raise self._wrong(signal.statement, f"{what}: expected another factor")

    def _is_alone(self, name: str, message: _Message, signal: _Signal) -> None:
        for other in message.signals:
            if other.statement == signal.statement:
                continue
            if other.name == signal.name:
                raise self._wrong(
                    max(signal, other, key=lambda each: each.statement).statement,
                    f"message {name} has signal {signal.name} twice",
                )
            if signal.value and other.value and signal.value != other.value:
                continue  # in different frames
            if shared := signal.bits & other.bits:
                place = "bit {1} of byte {0}".format(*divmod(min(shared), _BYTE))
                what = f"signals {signal.name} and {other.name} of message {name} overlap, first in {place}"
                raise self._wrong(signal.statement, what)

    def _reduce(self, message: _Message, names: Set[str]) -> str:
        """The text with all but ``message``, its signals ``names`` and what says more of them blanked."""
        own = {message.statement, *(each.statement for each in message.signals if each.name in names)}
        parts, position = [], 0
        values: dict[str, int] = {}  # of a signal: the part with its named values
        for number, (start, end) in enumerate(self._statements):
            text = self._text[start:end]
            parts.append(_blank(self._text[position:start]))
            position = end
            if number in own:
                parts.append(_plain(text))
            elif not _is_about(text, message.identifier, names):
                parts.append(_blank(text))
            elif found := _VALUES.match(_plain_values(text)):
                table = self._tables.get(found["values"].strip())
                named = found["values"] if table is None else f" {table}"
                if (first := values.setdefault(found["name"], len(parts))) == len(parts):
                    parts.append(f"{found['head']}{named};")
                else:  # cantools would forget the values before these
                    parts[first] = f"{parts[first].removesuffix(';')} {' '.join(named.split())};"
                    parts.append(_blank(text))
            else:
                parts.append(_TYPE.sub(r"\1: ", _ENUM_TEXT.sub(self._number_of_enum, text)))
        return "".join(parts)

    def _number_of_enum(self, found: re.Match[str]) -> str:
        """The statement of an attribute whose value is a name of its enumeration, with the number of that name."""
        definition = re.compile(rf'^[ \t]*BA_DEF_\s+(?:BO_\s+|SG_\s+)?"{found[2]}"\s+ENUM\s([^;]*);', re.M)
        stated = definition.search(self._text)
        names = re.findall(r'"([^"]*)"', stated[1]) if stated else []
        return f"{found[1]}{names.index(found[3])}" if found[3] in names else found[0]

    def _line(self, statement: int) -> int:
        start, end = self._statements[statement]
        text = self._text[start:end]
        return self._text.count("\n", 0, start + len(text) - len(text.lstrip())) + 1

    def _wrong(self, statement: int, what: str) -> InputError:
        return InputError(f"{self._path}:{self._line(statement)}:1: {what}")


def _is_j1939(database: Any, message: Any) -> bool:
    """Whether a message is one of J1939 by the protocol of its network, where no frame has a format."""
    attributes, definitions = database.dbc.attributes, database.dbc.attribute_definitions
    stated = attributes.get("ProtocolType")
    protocol = stated.value if stated else getattr(definitions.get("ProtocolType"), "default_value", "")
    return (
        message.is_extended_frame and "VFrameFormat" not in definitions and str(protocol).lower() == "j1939"
    )


def _statements(text: str) -> Iterator[tuple[int, int]]:
    """Start and end of each statement: from a keyword at the start of a line, or a ``;``, to the next."""
    start = 0
    for mark in _MARK.finditer(text):
        if mark["keyword"] is not None or mark["comment"] is not None:
            yield start, mark.start()
            start = mark.start()
        if mark["end"] is not None or mark["comment"] is not None:
            yield start, mark.end()
            start = mark.end()
    yield start, len(text)


def _is_about(statement: str, identifier: int, names: Set[str]) -> bool:
    """Whether a statement other than ``BO_`` and ``SG_`` says something of these signals or of their frame."""
    if found := _OF_SIGNAL.match(statement):
        return int(found["id"]) == identifier and found["name"] in names
    found = _ATTRIBUTE.match(statement)
    if found is None or found["attribute"] not in _USED_ATTRIBUTES:
        return False
    of_this = found["id"] is None or int(found["id"]) == identifier
    return of_this and (found["name"] is None or found["name"] in names)


def _plain(text: str) -> str:
    """A ``BO_`` or ``SG_`` that is in every frame, without the nodes, which some files leave out or misspell."""
    found = _NODES.match(_MULTIPLEX.sub(r"\1", text))
    return f"{found[1]} {_NO_NODE}{_blank(found[2])}" if found else text


def _plain_values(text: str) -> str:
    """Named values with their raw values as cantools reads them: whole, and decimal."""
    return _WHOLE.sub(lambda part: part[1] or (str(int(part[2], 16)) if part[2] else part[0]), text)


def _blank(text: str) -> str:
    return "\n" * text.count("\n")


def _bits(layout: str) -> Set[int]:
    """The bits of a signal as byte · 8 + bit; empty for a layout that cannot be read."""
    found = _LAYOUT.fullmatch(layout)
    if found is None:
        return frozenset()
    start, length = int(found["start"]), int(found["length"])
    if found["order"] == "1":
        return frozenset(range(start, start + length))
    first = start - start % _BYTE + _BYTE - 1 - start % _BYTE  # counted from the highest bit of each byte
    return frozenset(k - k % _BYTE + _BYTE - 1 - k % _BYTE for k in range(first, first + length))
