"""A driver for tests: an input, and real events of the kernel."""

from pathlib import Path

from trepid.config import CONFIG_DIR, load
from trepid.messages import DriverInput
from vehicle.driver.settings import DriverSettings
from vehicle.driver.sticks import INPUT_EVENT, JS_AXIS, JS_BUTTON, JS_EVENT

TIMEOUT_S = 0.2
INPUT = DriverInput(
    t_s=10.0,
    connected=True,
    allowed=True,
    override=False,
    road_wheel_angle_rad=None,
    accel_mps2=None,
    speed_mps=None,
    record=False,
)
SETTINGS = load(CONFIG_DIR / "driver.yaml", DriverSettings)


def axis(number: int, share: float) -> bytes:
    """The event of a game pad whose axis moves to ``share`` of its range."""
    return JS_EVENT.pack(1234, round(32767 * share), JS_AXIS, number)


def button(number: int, pressed: bool) -> bytes:
    """The event of a game pad whose button is pressed or released."""
    return JS_EVENT.pack(1234, int(pressed), JS_BUTTON, number)


def key(code: int, value: int) -> bytes:
    """The event of a keyboard: value 1 pressed, 0 released, 2 repeated."""
    return INPUT_EVENT.pack(1, 2, 1, code, value)


def settings(device: Path, **changed: object) -> DriverSettings:
    """The default settings with another device."""
    return SETTINGS.model_copy(update={"device": device, **changed})
