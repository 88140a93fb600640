"""The pulses and the camera of a donkeycar from its ``myconfig.py``, as files of a car of Trepid.

The file is a program. It is read as text: only assignments of plain values at its top level count, and nothing of
it runs. A pulse of P counts of 4095 at f Hz is P/(4095·f) long; donkeycar drives the PCA9685 at 60 Hz.
"""

import ast
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trepid.config import InputError, read_text

COUNTS, RATE_HZ = 4095, 60.0
PULSES_US = (500.0, 2500.0)  # what a servo may take; beyond it the file has another unit
PWM = "PWM_STEERING_THROTTLE"
FLAT_DRIVES = ("I2C_SERVO", "SERVO_ESC")  # pulses in names of their own, channels of the PCA9685
STEERING = ("STEERING_LEFT_PWM", "STEERING_RIGHT_PWM")
NEUTRAL = "THROTTLE_STOPPED_PWM"
FORWARD = "THROTTLE_FORWARD_PWM"
PIN = re.compile(r"PCA9685\.(\d+):([0-9a-fA-F]+)\.(\d+)")
SOURCES = {"PICAM": "picamera", "WEBCAM": "v4l2", "CVCAM": "v4l2"}
MOUNTS = {
    (True, True): "rotate_deg: 180",
    (False, True): "mirror: horizontal",
    (True, False): "mirror: vertical",
}


@dataclass(frozen=True, slots=True)
class Donkeycar:
    """What a ``myconfig.py`` says about a car."""

    files: Mapping[str, str]  # name of a file of the car -> its fields as YAML
    taken: tuple[str, ...]  # names of which they are made
    left: tuple[str, ...]  # names that Trepid has no use for, or that are no plain values, with their lines


@dataclass(slots=True)
class _Names:
    """The assignments of a file; those that are asked for are noted."""

    path: Path
    values: dict[str, Any] = field(default_factory=dict)
    places: dict[str, tuple[int, int]] = field(default_factory=dict)  # line and column
    computed: set[str] = field(default_factory=set)
    taken: list[str] = field(default_factory=list)

    def get(self, name: str, default: Any = None) -> Any:
        """The value of a name, or the default."""
        if name not in self.values:
            return default
        if name not in self.taken:
            self.taken.append(name)
        return self.values[name]

    def need(self, name: str, kind: type | tuple[type, ...]) -> Any:
        """The value of a name. Raises InputError without one of this type."""
        if name in self.computed:
            raise self.fault(name, "is computed; write the value itself, since the file is not run")
        if name not in self.values:
            raise InputError(
                f"{self.path}:1:1: no {name}: uncomment it, or calibrate the car with donkeycar first"
            )
        return self.check(name, self.get(name), kind)

    def check(self, name: str, value: Any, kind: type | tuple[type, ...], inner: str = "") -> Any:
        """``value``, which the name holds. Raises InputError where it is of another type."""
        if not isinstance(value, kind) or isinstance(value, bool):
            raise self.fault(name, f"{inner or name}: {value!r} is not what donkeycar has there")
        return value

    def fault(self, name: str, problem: str) -> InputError:
        """The error at the place of a name."""
        line, column = self.places.get(name, (1, 1))
        return InputError(f"{self.path}:{line}:{column}: {name}: {problem}")


def read_donkeycar(path: Path) -> Donkeycar:
    """The car of a ``myconfig.py``. Raises InputError with file:line:column.

    ``steering`` and ``throttle`` get pulses and channels. Speeds of the throttle and angles at the ends of the
    steering are unknown to donkeycar: ``speed`` is ``none``, and the car does not drive before they are measured.
    """
    names = _read(path)
    actuator = _actuator(names)
    files = {"actuator.yaml": actuator, "camera_source.yaml": _camera(names)}
    left = [f"{name} (line {line})" for name, (line, _) in names.places.items() if name not in names.taken]
    return Donkeycar({name: text for name, text in files.items() if text}, tuple(names.taken), tuple(left))


def _read(path: Path) -> _Names:
    names = _Names(path)
    try:
        tree = ast.parse(read_text(path), filename=str(path))
    except SyntaxError as error:
        raise InputError(f"{path}:{error.lineno or 1}:{error.offset or 1}: no Python: {error.msg}") from error
    except ValueError as error:  # a null byte
        raise InputError(f"{path}:1:1: no Python: {error}") from error
    for name, target, value in _assignments(tree):
        names.places[name] = (target.lineno, target.col_offset + 1)
        names.computed.discard(name)
        try:
            names.values[name] = ast.literal_eval(value)
        except ValueError:
            names.values.pop(name, None)
            names.computed.add(name)
    return names


def _assignments(tree: ast.Module) -> Iterator[tuple[str, ast.Name, ast.expr]]:
    for statement in tree.body:
        if isinstance(statement, ast.Assign):
            targets, value = statement.targets, statement.value
        elif isinstance(statement, ast.AnnAssign) and statement.value is not None:
            targets, value = [statement.target], statement.value
        else:
            continue
        for target in targets:
            if isinstance(target, ast.Name):
                yield target.id, target, value


def _actuator(names: _Names) -> str:
    """The fields of ``actuator.yaml``."""
    train = names.get("DRIVE_TRAIN_TYPE", PWM)
    if train == PWM:
        table = names.need(PWM, dict)

        def of(name: str) -> Any:
            if name not in table:
                raise names.fault(PWM, f"no {name!r}")
            return table[name]

        bus, address, steering = _pin(names, of("PWM_STEERING_PIN"))
        other_bus, other_address, throttle = _pin(names, of("PWM_THROTTLE_PIN"))
        if (bus, address) != (other_bus, other_address):
            raise names.fault(PWM, "steering and throttle are on two boards; Trepid drives one")
        for part in ("STEERING", "THROTTLE"):
            if table.get(f"PWM_{part}_INVERTED") or table.get(f"PWM_{part}_SCALE", 1.0) != 1.0:
                raise names.fault(
                    PWM, f"PWM_{part}_INVERTED and PWM_{part}_SCALE other than 1 are not taken over"
                )

        def pulse(name: str) -> float:
            return _pulse_us(names, PWM, names.check(PWM, of(name), (int, float), name))

    elif train in FLAT_DRIVES:
        bus, address = names.get("PCA9685_I2C_BUSNUM") or 1, names.get("PCA9685_I2C_ADDR", 0x40)
        steering, throttle = names.get("STEERING_CHANNEL", 1), names.get("THROTTLE_CHANNEL", 0)

        def pulse(name: str) -> float:
            return _pulse_us(names, name, names.need(name, (int, float)))

    else:
        raise names.fault(
            "DRIVE_TRAIN_TYPE", f"{train!r}: only servo and speed controller on a PCA9685 are taken over"
        )
    return _actuator_text(bus, address, steering, throttle, pulse)


def _actuator_text(
    bus: int, address: int, steering: int, throttle: int, pulse: Callable[[str], float]
) -> str:
    left, right = (pulse(name) for name in STEERING)
    neutral, forward = pulse(NEUTRAL), pulse(FORWARD)
    still = round(neutral) + (1 if forward > neutral else -1)
    return f"""\
# Pulses of donkeycar, which knows no speeds and no angles: measure both, then set speed: modelled.
actuator: pca9685
pca9685:
  bus: /dev/i2c-{bus}
  address: 0x{address:02x}
  frequency_hz: {RATE_HZ:g}
  speed: none            # does not drive; modelled after `trepid calibrate steering` has measured speeds
  yaw_rate: modelled
  steering:
    channel: {steering}
    least_us: {min(left, right):.0f}
    most_us: {max(left, right):.0f}
    centre_us: {(left + right) / 2:.0f}
    left_us: {left:.0f}
    right_us: {right:.0f}
  throttle:
    channel: {throttle}
    least_us: {min(neutral, forward):.0f}
    most_us: {max(neutral, forward):.0f}
    neutral_us: {neutral:.0f}
    speeds: [[1.0, {still:.0f}]]   # no speed is measured yet; this pulse moves no car
"""


def _pin(names: _Names, pin: Any) -> tuple[int, int, int]:
    """Bus, address and channel of a pin. Raises InputError for one that is not of a PCA9685."""
    found = PIN.fullmatch(pin) if isinstance(pin, str) else None
    if found is None:
        raise names.fault(PWM, f"pin {pin!r}: only a PCA9685 is taken over, such as 'PCA9685.1:40.1'")
    return int(found[1]), int(found[2], 16), int(found[3])


def _pulse_us(names: _Names, name: str, counts: float) -> float:
    """A pulse of so many counts [µs]. Raises InputError where no servo takes it."""
    pulse_us = 1e6 * counts / COUNTS / RATE_HZ
    if not PULSES_US[0] <= pulse_us <= PULSES_US[1]:
        raise names.fault(name, f"{counts:g} counts are a pulse of {pulse_us:.0f} µs, which no servo takes")
    return pulse_us


def _camera(names: _Names) -> str:
    """The fields of ``camera_source.yaml``; "" without a camera that Trepid has a source for."""
    source = SOURCES.get(names.values.get("CAMERA_TYPE", "PICAM"))
    if source is None:
        return ""
    names.get("CAMERA_TYPE")
    flips = bool(names.get("CAMERA_VFLIP", False)), bool(names.get("CAMERA_HFLIP", False))
    mount = f"mount:\n  {MOUNTS[flips]}\n" if any(flips) else ""
    number = {"picamera": "camera", "v4l2": "device"}[source]
    index = names.check("CAMERA_INDEX", names.get("CAMERA_INDEX", 0), int)
    return f"source: {source}\n{mount}{source}:\n  {number}: {index}\n"
