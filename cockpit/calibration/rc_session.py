"""A calibration by keys: the pulses that the keys ask for, and what was recorded. No terminal, no board."""

from typing import Any, NamedTuple

from vehicle.actuators.rc.settings import RcSettings

FINE_US, COARSE_US = 5.0, 25.0
IDLE_S = 2.0  # a throttle without a key for this long returns to neutral
HELP = (
    "arrows ←/→ 5 µs, ↓/↑ 25 µs · c centre · l left end · r right end · t steering or throttle · "
    "n neutral · v speed at this throttle · x forget the speeds · w write · q quit"
)
LEFT, RIGHT, UP, DOWN = "\x1b[D", "\x1b[C", "\x1b[A", "\x1b[B"
STEPS = {LEFT: -FINE_US, RIGHT: FINE_US, UP: COARSE_US, DOWN: -COARSE_US}


class KeyResult(NamedTuple):
    """What a key did."""

    said: str
    writes: bool = False
    ends: bool = False
    asks_speed: bool = False


STEERING_KEYS = {"c": "steering.centre_us", "l": "steering.left_us", "r": "steering.right_us"}
KEYS = {False: STEERING_KEYS, True: {"n": "throttle.neutral_us"}}
"""Key -> value that it records, on the steering and on the throttle."""
QUIT = KeyResult("", ends=True)
ACTIONS = {
    "w": KeyResult("", writes=True),
    "v": KeyResult("speed [m/s]?", asks_speed=True),
    **dict.fromkeys(("q", "\x03", "\x04"), QUIT),
}


class Session:
    """Call ``press`` with every key and ``pulses`` before every write to the board."""

    def __init__(self, settings: RcSettings) -> None:
        self._settings = settings
        self._steering_us = settings.steering.centre_us
        self._throttle_us = settings.throttle.neutral_us
        self._on_throttle = False
        self._key_s = 0.0
        self.changes: dict[str, Any] = {}
        """Recorded values by their dotted names in the block of the board."""
        self._measured: dict[float, float] = {}

    def pulses(self, *, now_s: float) -> dict[int, float]:
        """The pulse [µs] of each channel; the throttle is neutral unless keys keep it elsewhere."""
        if now_s - self._key_s > IDLE_S:
            self._throttle_us = self._settings.throttle.neutral_us
        return {
            self._settings.steering.channel: self._steering_us,
            self._settings.throttle.channel: self._throttle_us,
        }

    def press(self, key: str, *, now_s: float) -> KeyResult:
        """Move a pulse, or record the present one."""
        throttle = self._settings.throttle
        idle, self._key_s = now_s - self._key_s > IDLE_S, now_s
        if idle:
            self._throttle_us = throttle.neutral_us
        if key in STEPS:
            self._move(STEPS[key])
            return KeyResult(self._where())
        if key == "t":
            self._on_throttle = not self._on_throttle
            self._throttle_us = throttle.neutral_us
            return KeyResult(self._where())
        if key == "x" and self._on_throttle:
            self._measured.clear()
            self.changes.pop("throttle.speeds", None)
            return KeyResult("no speeds recorded")
        if key in KEYS[self._on_throttle]:
            return KeyResult(self._record(KEYS[self._on_throttle][key]))
        if key in ACTIONS and (key != "v" or self._on_throttle):
            return ACTIONS[key]
        return KeyResult(HELP)

    def _move(self, by_us: float) -> None:
        steering, throttle = self._settings.steering, self._settings.throttle
        if self._on_throttle:
            self._throttle_us = throttle.within(self._throttle_us + by_us)
        else:
            self._steering_us = steering.within(self._steering_us + by_us)

    def _record(self, name: str) -> str:
        pulse_us = self._throttle_us if self._on_throttle else self._steering_us
        self.changes[name] = pulse_us
        return f"{name} = {pulse_us:g}"

    def speed(self, speed_mps: float, *, pulse_us: float | None = None) -> KeyResult:
        """Record the measured speed of the present throttle pulse, or of ``pulse_us``."""
        pulse_us = self._throttle_us if pulse_us is None else pulse_us
        self._measured[speed_mps] = pulse_us
        self.changes["throttle.speeds"] = [list(pair) for pair in sorted(self._measured.items())]
        return KeyResult(f"{speed_mps:g} m/s at {pulse_us:g} µs")

    @property
    def throttle_us(self) -> float:
        """The present throttle pulse."""
        return self._throttle_us

    def _where(self) -> str:
        if self._on_throttle:
            return f"throttle {self._throttle_us:g} µs"
        return f"steering {self._steering_us:g} µs"
