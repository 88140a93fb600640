"""Settings of the driver input: ``config/driver.yaml``."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from trepid.config import CONFIG_DIR, Settings, load
from trepid.types import NonNegative, OpenShare, Positive

Number = Annotated[int, Field(ge=0, le=767)]  # of an axis, button or key: linux/input-event-codes.h, KEY_MAX
Sign = Literal[-1, 1]


class DeviceKind(StrEnum):
    """The interface of the kernel that the device speaks."""

    GAMEPAD = "gamepad"  # /dev/input/js*
    KEYBOARD = "keyboard"  # /dev/input/event*


class Gamepad(Settings):
    """Axes and buttons of a game pad by their numbers, as ``jstest`` shows them."""

    steering_axis: Number
    steering_sign: Sign  # -1: the axis grows to the right
    throttle_axis: Number
    throttle_sign: Sign  # -1: the axis grows towards the driver
    dead_zone: OpenShare  # share of the range around the centre that counts as centred
    dead_man_button: Number
    hand_button: Number
    stop_button: Number
    record_button: Number


class Keyboard(Settings):
    """Keys of a keyboard by their codes, as ``evtest`` shows them."""

    left_key: Number
    right_key: Number
    faster_key: Number
    brake_key: Number
    dead_man_key: Number
    hand_key: Number
    stop_key: Number
    record_key: Number
    per_s: Positive  # a held key moves the demand by this share of its range in a second


class DriverSettings(Settings):
    """``config/driver.yaml``."""

    required: bool
    timeout_s: Positive
    rate_hz: Positive
    kind: DeviceKind
    device: Path
    override_above: OpenShare
    release_s: NonNegative
    max_speed_mps: Positive
    accel_mps2: Positive
    brake_mps2: Positive
    gamepad: Gamepad
    keyboard: Keyboard


def load_driver() -> DriverSettings:
    """The settings in ``config/`` and in the folder of the car. Raises InputError."""
    return load(CONFIG_DIR / "driver.yaml", DriverSettings)
