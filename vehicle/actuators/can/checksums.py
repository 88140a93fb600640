"""Checksums of CAN messages, by name.

Each is computed from the address and the bytes of a message whose checksum field is zero.

==================  =======================================================================================
name                value
==================  =======================================================================================
``xor``             exclusive or of all bytes
``sum``             sum of all bytes
``toyota``          sum of all bytes, of the bytes of the address, and of the number of bytes
``honda``           8 minus the sum of all half bytes of data and address, + 3 for an extended address; 4 bits
``crc8_j1850``      CRC-8 SAE J1850 (polynomial 0x1D) of the data id and the bytes other than the checksum
``crc8_autosar``    CRC-8 of AUTOSAR (polynomial 0x2F), likewise
==================  =======================================================================================

Source of the two makes: opendbc, ``toyotacan.py`` and ``hondacan.py``; of the CRCs: AUTOSAR SWS CRCLibrary.
"""

from collections.abc import Callable
from functools import reduce
from operator import xor
from typing import Literal

from crccheck.crc import Crc8Autosar, Crc8SaeJ1850

Algorithm = Literal["xor", "sum", "toyota", "honda", "crc8_j1850", "crc8_autosar"]
WHOLE_BYTE = frozenset({"crc8_j1850", "crc8_autosar"})
"""Algorithms whose checksum fills one byte, which they leave out."""
EXTENDED = 0x7FF  # addresses above it have 29 bits


def _xor(address: int, data: bytes) -> int:
    return reduce(xor, data, 0)


def _sum(address: int, data: bytes) -> int:
    return sum(data)


def _toyota(address: int, data: bytes) -> int:
    return sum(data) + len(data) + sum(address.to_bytes(4, "big"))


def _honda(address: int, data: bytes) -> int:
    halves = sum((byte >> 4) + (byte & 0xF) for byte in (*data, *address.to_bytes(4, "big")))
    return 8 - halves + (3 if address > EXTENDED else 0)


def _crc(kind: type[Crc8SaeJ1850] | type[Crc8Autosar]) -> Callable[[int, bytes], int]:
    return lambda address, data: kind.calc(data)


FUNCTIONS: dict[str, Callable[[int, bytes], int]] = {
    "xor": _xor,
    "sum": _sum,
    "toyota": _toyota,
    "honda": _honda,
    "crc8_j1850": _crc(Crc8SaeJ1850),
    "crc8_autosar": _crc(Crc8Autosar),
}


def checksum(
    algorithm: str, address: int, data: bytes, *, bits: int, byte: int, data_id: tuple[int, ...] = ()
) -> int:
    """Checksum of ``data``, whose checksum field of ``bits`` bits is zero.

    ``byte``: the place of the field, for the algorithms of ``WHOLE_BYTE``.
    """
    if algorithm in WHOLE_BYTE:
        data = bytes(data_id) + data[:byte] + data[byte + 1 :]
    return FUNCTIONS[algorithm](address, data) & ((1 << bits) - 1)
