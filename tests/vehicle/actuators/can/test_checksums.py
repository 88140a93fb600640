"""Checksums of CAN messages against opendbc and against published check values."""

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from opendbc.car.chrysler.chryslercan import chrysler_checksum
from opendbc.car.honda.hondacan import honda_checksum
from opendbc.car.subaru.subarucan import subaru_checksum
from opendbc.car.toyota.toyotacan import toyota_checksum

from vehicle.actuators.can.checksums import checksum

ADDRESS = st.integers(0, 0x7FF)
EXTENDED = st.integers(0x800, 0x1FFFFFFF)
DATA = st.binary(min_size=2, max_size=8)


@given(address=ADDRESS | EXTENDED, data=DATA)
def test_toyota_is_that_of_opendbc(address, data):
    zeroed = data[:-1] + b"\0"
    assert checksum("toyota", address, zeroed, bits=8, byte=len(data) - 1) == toyota_checksum(
        address, None, bytearray(data)
    )


@given(address=ADDRESS | EXTENDED, data=DATA)
def test_honda_is_that_of_opendbc(address, data):
    zeroed = data[:-1] + bytes([data[-1] & 0xF0])
    assert checksum("honda", address, zeroed, bits=4, byte=len(data) - 1) == honda_checksum(
        address, None, bytearray(data)
    )


@given(address=ADDRESS, data=DATA)
def test_crc8_j1850_is_that_of_opendbcs_chrysler(address, data):
    last = len(data) - 1
    assert checksum("crc8_j1850", address, data, bits=8, byte=last) == chrysler_checksum(
        address, None, bytearray(data)
    )


@given(address=ADDRESS, data=DATA)
def test_sum_is_that_of_opendbcs_subaru_without_the_address(address, data):
    zeroed = b"\0" + data[1:]
    own = sum(address.to_bytes(2, "big"))
    assert (
        checksum("sum", address, zeroed, bits=8, byte=0)
        == (subaru_checksum(address, SimpleNamespace(), bytearray(data)) - own) % 256
    )


@pytest.mark.parametrize(("algorithm", "check"), [("crc8_j1850", 0x4B), ("crc8_autosar", 0xDF)])
def test_a_crc_has_the_published_check_value(algorithm, check):
    """Of the text 123456789: AUTOSAR SWS CRCLibrary, section 7.2."""
    assert checksum(algorithm, 0, b"123456789\0", bits=8, byte=9) == check


def test_a_data_id_precedes_the_data_of_a_crc():
    assert checksum("crc8_j1850", 0, b"3456789\0", bits=8, byte=7, data_id=tuple(b"12")) == 0x4B


@given(data=DATA)
def test_every_changed_bit_changes_the_exclusive_or(data):
    first = checksum("xor", 0, data, bits=8, byte=0)
    for bit in range(8 * len(data)):
        changed = (int.from_bytes(data, "big") ^ (1 << bit)).to_bytes(len(data), "big")
        assert checksum("xor", 0, changed, bits=8, byte=0) != first
