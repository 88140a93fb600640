"""The simulated servo board."""

import pytest

from sim_harness.counterparts.servo_board import (
    SERIAL_PROTOCOL_ERROR,
    SILENCE_S,
    TIMEOUT_ERROR,
    ServoBoard,
)


@pytest.fixture(params=["ascii", "maestro"])
def board(request) -> ServoBoard:
    return ServoBoard(request.param, 0, 1500.0)


PULSE = {"ascii": b"S2 1600\n", "maestro": bytes([0x84, 2, 0x00, 0x32])}  # the example of the user's guide


def test_a_command_counts_once_it_is_whole(board) -> None:
    data = PULSE[board._protocol]
    board.feed(data[:3], now_s=0.0)
    assert board.pulses_us == {}
    board.feed(data[3:], now_s=0.0)
    assert board.pulses_us == {2: 1600.0}


def test_garbage_is_an_error_and_sets_no_pulse(board) -> None:
    board.feed(b"hello 1600\n", now_s=0.0)
    assert board.pulses_us == {}
    assert board.errors & SERIAL_PROTOCOL_ERROR


def test_garbage_does_not_feed_the_watchdog(board) -> None:
    board.pulses_us[0] = 1600.0
    board.feed(PULSE[board._protocol], now_s=0.0)
    board.feed(b"\n\n", now_s=SILENCE_S)
    board.watch(now_s=SILENCE_S + 0.01)
    assert board.pulses_us == {0: 1500.0, 2: 1600.0}
    assert board.errors & TIMEOUT_ERROR


def test_a_maestro_reports_its_errors_once() -> None:
    board = ServoBoard("maestro", 0, 1500.0)
    board.errors = TIMEOUT_ERROR
    assert board.feed(b"\xa1\xa1", now_s=0.0) == bytes([TIMEOUT_ERROR, 0, 0, 0])
