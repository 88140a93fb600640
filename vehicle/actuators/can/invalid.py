"""Values of a signal that are no measurement: named invalid, reserved by J1939, or outside the stated range.

A DBC says so in four ways:

- ``VAL_`` names a raw value, as in ``VAL_ 36 YAW_RATE 1023 "SNA"``. The names in use are those of opendbc's files
  and of SAE J1939-71: signal not available, not available, invalid, error, fault, unknown, undefined, reserved.
- The attribute ``GenSigSNA`` or ``GenSigInvalidValue`` of a signal is such a raw value, as a number or as
  hexadecimal text such as ``0xFFFF`` or ``FFFFh``.
- ``[min|max]`` ends below the largest raw value; ``[0|0]`` states no range.
- A message of the protocol J1939 reserves the largest raw values: of a byte 0xFB to 0xFF (0xFE error, 0xFF not
  available), of longer signals those whose highest byte is one of these, of four bits 0xE and 0xF, of two bits 2
  and 3 (SAE J1939-71, section 5.1.4).
"""

import math
import re
import unicodedata
from collections.abc import Collection, Mapping
from typing import Any

NEGATIONS = frozenset(
    {"no", "not", "without", "ohne", "kein", "keine", "nicht", "non", "pas", "niet", "geen", "ej", "ingen"}
)
INVALID_STEMS = (
    *(
        "sna",
        "snv",
        "invalid",
        "unvalid",
        "unavail",
        "undefin",
        "unknown",
        "unplausib",
        "implausib",
        "reserv",
    ),
    *("err", "fault", "fail", "defect", "notavail", "notavl", "notvalid", "notdefin", "nodat", "nosignal"),
    *("uninit", "notinit", "uncalib", "missing", "lost", "timeout", "overflow", "underflow"),
    *("fehler", "ungueltig", "unplaus", "defekt", "nichtverf", "unbekannt", "unbestimmt", "stoer", "gestoer"),
    *("ausfall", "ausgefallen", "indispon", "erron", "inconnu", "ongeldig", "onbekend", "ogiltig"),
)
NEGATED_STEMS = (
    *(
        "avail",
        "avl",
        "valid",
        "defin",
        "data",
        "dat",
        "signal",
        "init",
        "known",
        "present",
        "plausib",
        "used",
    ),
    *("value", "measur", "info", "calib", "verfueg", "gueltig", "bekannt", "wert", "messwert", "messung"),
    *("dispon", "beschikbaar", "geldig", "tillgaeng", "giltig"),
)
INVALID_PHRASES = ("out of range", "time out")
INVALID_SIGNS = (
    "无效",
    "無效",
    "無効",
    "不可用",
    "未定义",
    "未定義",
    "未知",
)  # invalid, not available, undefined, unknown
INVALID_ATTRIBUTES = ("GenSigSNA", "GenSigInvalidValue")
INITIAL = frozenset(
    f"initial{ending}" for ending in ("", "izing", "ising", "ization", "isation", "isierung")
) | {"init"}
NOT_AVAILABLE = frozenset({"na", "n a", "nv", "n v", "na n"})  # the whole name; NaN is two words
_UMLAUTS = str.maketrans({"ä": "ae", "ö": "oe", "ü": "ue", "Ä": "Ae", "Ö": "Oe", "Ü": "Ue", "ß": "ss"})
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+|\d+")
_J1939_BITS = {2: 2, 4: 0xE}
_BYTE = 8
_FIRST_RESERVED = 0xFB


def is_invalid_name(name: str) -> bool:
    """Whether ``name``, the text of a value in ``VAL_``, says that the value is no measurement.

    Words are split at signs, digits and capitals. A negation turns the next word: ``no_error`` and ``not_faulty``
    are measurements, ``not available`` and ``no data`` are none.
    """
    if any(sign in name for sign in INVALID_SIGNS):
        return True
    plain = unicodedata.normalize("NFKD", unicodedata.normalize("NFC", name).translate(_UMLAUTS))
    words = [word.lower() for word in _WORD.findall(plain.encode("ascii", "ignore").decode())]
    text = " ".join(words)
    if text in NOT_AVAILABLE or any(phrase in text for phrase in INVALID_PHRASES):
        return True
    negated = False
    for word in words:
        if word in NEGATIONS:
            negated = True
            continue
        if negated:
            if word.startswith(NEGATED_STEMS):
                return True
        elif word in INITIAL or word.startswith(INVALID_STEMS):
            return True
        negated = False
    return False


class InvalidValues:
    """The values of one signal of cantools that are no measurement."""

    def __init__(self, signal: Any, protocol: str | None, also: Collection[int] = ()) -> None:
        """``protocol`` of the message in the DBC, such as ``j1939``; ``also``: further invalid raw values."""
        self._scale, self._offset = float(signal.scale), float(signal.offset)
        named: Mapping[int, Any] = signal.choices or {}
        choices = {_raw_of(signal, int(raw)): str(text) for raw, text in named.items()}
        self._named = {raw: text for raw, text in choices.items() if is_invalid_name(text)}
        self._named |= {raw: name for raw, name in _attributes_of(signal).items() if raw not in self._named}
        self._also = frozenset(_raw_of(signal, raw) for raw in also)
        self._stated = set(choices) - set(self._named)
        low, high = signal.minimum, signal.maximum
        ranged = low is not None and high is not None and low < high
        rounding = abs(self._scale) / 2.0
        self._low = low - rounding if ranged else -math.inf
        self._high = high + rounding if ranged else math.inf
        self._unit = f" {signal.unit}" if signal.unit else ""
        self._range = f"[{low:g}|{high:g}]" if ranged else ""
        plain = protocol == "j1939" and not signal.is_signed and not signal.is_float
        self._reserved_from = _first_reserved(signal.length) if plain else math.inf

    @property
    def value_to_send(self) -> int | None:
        """The least raw value that the DBC names invalid; None: it names none."""
        return min(self._named, default=None)

    def value(self, raw: float) -> float:
        """``raw`` in the units of the signal."""
        return raw * self._scale + self._offset

    def reason(self, raw: float) -> str:
        """Why ``raw`` is no measurement, such as ``1023 is "SNA"``; "" for a measurement."""
        value = self.value(raw)
        if not math.isfinite(raw):
            why = "is no number"
        elif raw in self._named:
            why = f'is "{self._named[int(raw)]}"'
        elif raw in self._also:
            why = "is invalid by the map"
        elif raw not in self._stated and raw >= self._reserved_from:
            why = "is reserved by J1939"
        elif raw not in self._stated and not self._low <= value <= self._high:
            return f"{value:g}{self._unit} is outside {self._range}"
        else:
            return ""
        return f"{raw:g} {why}"


def _raw_of(signal: Any, raw: int) -> int:
    """The raw value that files mean by ``raw``: of a signal with a sign some write the bits without it."""
    beyond = (
        signal.is_signed
        and not signal.is_float
        and 0 <= raw - 2 ** (signal.length - 1) < 2 ** (signal.length - 1)
    )
    return raw - 2**signal.length if beyond else raw


def _attributes_of(signal: Any) -> dict[int, str]:
    """The invalid raw values that attributes of a signal state, and the names of these attributes."""
    stated = getattr(signal.dbc, "attributes", {})
    found = {name: _raw_in(str(stated[name].value)) for name in INVALID_ATTRIBUTES if name in stated}
    return {_raw_of(signal, raw): name for name, raw in found.items() if raw is not None}


def _raw_in(text: str) -> int | None:
    """The raw value of an attribute: decimal, or hexadecimal with 0x or h; None where it states none."""
    text = text.strip().lower()
    if re.fullmatch(r"(0x)?[0-9a-f]+h|0x[0-9a-f]+", text):
        return int(text.removesuffix("h"), 16)
    number = re.fullmatch(r"(-?\d+)(?:\.0*)?", text)
    return int(number[1]) if number else None


def _first_reserved(bits: int) -> float:
    """The least raw value that J1939 reserves in a signal of so many bits; inf: none."""
    if bits >= _BYTE:
        return _FIRST_RESERVED << (bits - _BYTE)
    return _J1939_BITS.get(bits, math.inf)
