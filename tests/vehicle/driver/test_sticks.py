"""Game pad and keyboard: bytes of the kernel through a FIFO."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from vehicle_driver_rig import SETTINGS, axis, button, key, settings

from trepid.config import InputError
from vehicle.driver.settings import DeviceKind
from vehicle.driver.sticks import INPUT_EVENT, JS_INIT, SYN_DROPPED, DriverInput, Sticks, open_input

PAD, KEYS = SETTINGS.gamepad, SETTINGS.keyboard


class PluggedDevice:
    """A device at a path, and the end of the kernel."""

    def __init__(self, path: Path, kind: DeviceKind) -> None:
        os.mkfifo(path)
        self._path = path
        self.input: DriverInput = open_input(settings(path, kind=kind))
        self.plug()

    def plug(self) -> None:
        self._fd = os.open(self._path, os.O_RDWR)

    def unplug(self) -> None:
        os.close(self._fd)

    def send(self, *events: bytes) -> None:
        os.write(self._fd, b"".join(events))

    def read(self, now_s: float = 0.0) -> Sticks | None:
        return self.input.read(now_s=now_s)


@pytest.fixture
def pad(tmp_path) -> Iterator[PluggedDevice]:
    made = PluggedDevice(tmp_path / "js0", DeviceKind.GAMEPAD)
    yield made
    made.input.close()


@pytest.fixture
def keys(tmp_path) -> Iterator[PluggedDevice]:
    made = PluggedDevice(tmp_path / "event0", DeviceKind.KEYBOARD)
    yield made
    made.input.close()


def test_a_pad_without_events_is_centred_and_released(pad) -> None:
    assert pad.read() == Sticks()


def test_axes_and_buttons_follow_the_map_of_the_settings(pad) -> None:
    pad.send(
        axis(PAD.steering_axis, -1.0),
        axis(PAD.throttle_axis, -1.0),
        button(PAD.dead_man_button, True),
        button(PAD.stop_button, True),
    )
    assert pad.read() == Sticks(steering=1.0, throttle=1.0, dead_man=True, stop=True)


def test_the_events_of_the_first_state_count(pad) -> None:
    event = bytearray(button(PAD.dead_man_button, True))
    event[6] |= JS_INIT
    pad.send(bytes(event))
    assert pad.read().dead_man


def test_the_dead_zone_is_centred_and_the_rest_begins_without_a_step(pad) -> None:
    pad.send(axis(PAD.steering_axis, PAD.dead_zone * 0.99))
    assert pad.read().steering == 0.0
    pad.send(axis(PAD.steering_axis, PAD.dead_zone * 1.02))
    assert -0.01 < pad.read().steering < 0.0


def test_an_event_in_two_parts_counts_once_it_is_whole(pad) -> None:
    event = button(PAD.dead_man_button, True)
    pad.send(event[:3])
    assert not pad.read().dead_man
    pad.send(event[3:])
    assert pad.read().dead_man


def test_an_unplugged_pad_is_gone_and_forgets_its_buttons_when_it_returns(pad) -> None:
    pad.send(button(PAD.dead_man_button, True))
    assert pad.read().dead_man
    pad.unplug()
    assert pad.read() is None
    assert pad.read() is None
    pad.plug()
    assert pad.read() == Sticks()


def test_a_key_counts_from_press_to_release(keys) -> None:
    keys.send(key(KEYS.dead_man_key, 1), key(KEYS.dead_man_key, 2))
    assert keys.read().dead_man
    keys.send(key(KEYS.dead_man_key, 0))
    assert not keys.read().dead_man


def test_a_held_key_moves_the_demand_and_a_released_one_returns_it(keys) -> None:
    keys.send(key(KEYS.left_key, 1))
    keys.read(0.0)
    assert keys.read(0.25).steering == pytest.approx(0.25 * KEYS.per_s)
    assert keys.read(9.0).steering == 1.0
    keys.send(key(KEYS.left_key, 0))
    assert keys.read(9.1).steering == pytest.approx(1.0 - 0.1 * KEYS.per_s)


def test_lost_events_release_every_key(keys) -> None:
    keys.send(key(KEYS.dead_man_key, 1), INPUT_EVENT.pack(0, 0, 0, SYN_DROPPED, 0))
    assert not keys.read().dead_man


@pytest.mark.parametrize("make", [lambda path: None, lambda path: path.write_text("no device")])
def test_a_path_without_a_device_is_refused_with_the_remedy(tmp_path, make) -> None:
    path = tmp_path / "js7"
    make(path)
    with pytest.raises(InputError, match=r"js7: .*input device.*driver\.yaml"):
        open_input(settings(path))


def test_the_repetitions_of_a_key_that_was_held_before_the_start_are_no_press(keys) -> None:
    keys.send(key(KEYS.dead_man_key, 2))
    assert not keys.read().dead_man
