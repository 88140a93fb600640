"""The verb `trepid calibrate`: pulses of an RC car, live or from values."""

import json
import math
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import TypeAdapter, ValidationError

from cockpit.calibration import rc_file
from cockpit.calibration.rc_session import HELP, KeyResult, Session
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, car_folder, load
from trepid.loudness import warn
from trepid.options import Car
from vehicle.actuators.rc.actuator import Board, open_board, require_reach
from vehicle.actuators.rc.pulses import Speed
from vehicle.actuators.rc.settings import RcSettings

app = typer.Typer()
PERIOD_S = 0.02
STEP_US = 10.0  # in a period: the servo turns slowly
LOCAL = 3  # index of the local modes in the attributes of a terminal
LONGEST_LINE = 256


@app.callback()
def calibrate() -> None:
    """Calibrate the pulses of an RC car."""


@app.command()
def steering(
    car: Car = None,
    board: Annotated[str | None, typer.Option(help="pca9685 or serial; default: that of the car.")] = None,
    centre: Annotated[float | None, typer.Option(metavar="US", help="Pulse of straight wheels [µs].")] = None,
    left: Annotated[float | None, typer.Option(metavar="US", help="Pulse of the left end [µs].")] = None,
    right: Annotated[float | None, typer.Option(metavar="US", help="Pulse of the right end [µs].")] = None,
    left_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help="Road-wheel angle at the left end [deg].")
    ] = None,
    right_deg: Annotated[
        float | None, typer.Option(metavar="DEG", help="Road-wheel angle at the right end [deg].")
    ] = None,
    neutral: Annotated[float | None, typer.Option(metavar="US", help="Pulse without drive [µs].")] = None,
    speed: Annotated[
        list[str] | None,
        typer.Option(metavar="MPS=US", help="Measured speed [m/s] at a throttle pulse [µs]; repeat it."),
    ] = None,
    file_only: Annotated[
        bool, typer.Option("--file-only", help="Write the values without moving anything.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print what was written as JSON.")] = False,
) -> None:
    """Find centre and ends of the steering and the speed per throttle, and write them to the car's actuator.yaml.

    Without values it reads keys from the terminal and moves the servo live, in small steps within the hard ends.
    With values it moves the steering to each, back to the centre, and writes. A running drive takes the new
    calibration over within a second; it owns the board, so use --file-only then.
    """
    folder = car_folder()
    if folder is None:
        raise InputError("give the folder of the car: --car DIR; `trepid init` makes one")
    name = board or rc_file.chosen_board()
    if name not in rc_file.BOARDS:
        raise InputError(f"--board {name}: expected pca9685 or serial")
    changes = _given_values(
        {
            "steering.centre_us": centre,
            "steering.left_us": left,
            "steering.right_us": right,
            "steering.left_rad": None if left_deg is None else round(math.radians(left_deg), 4),
            "steering.right_rad": None if right_deg is None else round(math.radians(right_deg), 4),
            "throttle.neutral_us": neutral,
            "throttle.speeds": _speeds(speed or []) or None,
        }
    )
    settings = rc_file.settings_of(name, changes)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    if not changes and file_only:
        raise InputError("--file-only needs values, such as --centre 1490")
    if not changes:
        changes = _by_keys(folder, name, settings)
    elif not file_only:
        _show(settings, [changes[key] for key in changes if key.startswith("steering.") and "_us" in key])
    if changes:
        path = rc_file.write(folder, name, changes)
        try:
            require_reach(name, rc_file.settings_of(name).steering, vehicle)
        except InputError as error:
            warn(f"trepid: warning: {error}")
        print(json.dumps({"file": str(path), "board": name, **changes}) if as_json else f"{path}: written")
    elif as_json:
        print(json.dumps({"file": None, "board": name}))


def _given_values(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if value is not None}


def _speeds(texts: list[str]) -> list[list[float]]:
    """The pairs of ``--speed``. Raises InputError."""
    pairs = []
    for text in texts:
        speed, _, pulse = text.partition("=")
        try:
            pairs.append([float(speed), float(pulse)])
        except ValueError as error:
            raise InputError(f"--speed {text}: expected MPS=US, such as 1.0=1570") from error
    return sorted(pairs)


@contextmanager
def _open_board(settings: RcSettings) -> Iterator[Board]:
    """The board; at the end the throttle is neutral and the wheels are straight."""
    board = open_board(settings)
    try:
        yield board
    finally:
        with suppress(OSError):  # a board that is gone: the fault was reported, or is about to be
            board.write(settings.rest_us, now_s=time.monotonic())
        board.close()


def _show(settings: RcSettings, pulses_us: list[float]) -> None:
    """Move the steering in small steps to each pulse and back to the centre."""
    try:
        with _open_board(settings) as board:
            at_us = settings.steering.centre_us
            for goal_us in [*pulses_us, settings.steering.centre_us]:
                while at_us != goal_us:
                    at_us += max(-STEP_US, min(STEP_US, goal_us - at_us))
                    board.write(settings.rest_us | {settings.steering.channel: at_us}, now_s=time.monotonic())
                    time.sleep(PERIOD_S)
    except OSError as error:
        raise InputError(f"the board refused a pulse, nothing was written: {error}") from error


def _by_keys(folder: Path, name: str, settings: RcSettings) -> dict[str, Any]:
    """Read keys until the end; the values that are not written yet, none after `q`."""
    if not sys.stdin.isatty():
        raise InputError("no terminal to read keys from: give values, such as --centre 1490")
    session = Session(settings)
    print(HELP, file=sys.stderr)
    try:
        with _keys() as keys, _open_board(settings) as board:
            while True:
                now_s = time.monotonic()
                key = keys()
                if key:
                    pressed = session.press(key, now_s=now_s)
                    if pressed.ends:
                        return {}
                    if pressed.asks_speed:
                        throttle = settings.throttle
                        board.write({throttle.channel: throttle.neutral_us}, now_s=now_s)  # typing takes time
                        pressed = _with_speed(session, pressed.said)
                    if pressed.writes:
                        fault = _fault(name, session.changes)
                        if not fault:
                            return session.changes
                        pressed = KeyResult(f"not written: {fault}")
                    print(f"\r\x1b[K{pressed.said}", end="", file=sys.stderr, flush=True)
                board.write(session.pulses(now_s=time.monotonic()), now_s=now_s)
                time.sleep(PERIOD_S)
    except OSError as error:
        raise InputError(f"the board refused a pulse, nothing was written: {error}") from error
    finally:
        print(file=sys.stderr)


def _fault(name: str, changes: dict[str, Any]) -> str:
    """What is wrong with the recorded values; ""."""
    try:
        rc_file.settings_of(name, changes)
    except InputError as error:
        return str(error)
    return ""


def _with_speed(session: Session, question: str) -> KeyResult:
    """Record the speed that is typed for the present throttle pulse."""
    pulse_us, speed_mps = session.throttle_us, _typed_speed(question)
    if speed_mps is None:
        return KeyResult("no speed recorded")
    return session.speed(speed_mps, pulse_us=pulse_us)


def _typed_speed(question: str) -> float | None:
    """The speed [m/s] that is typed, with echo and editing, asked for until it is one; None for an empty line."""
    with _lines() as line:
        while True:
            print(f"\r\x1b[K{question} ", end="", file=sys.stderr, flush=True)
            text = line()
            if not text:
                return None
            try:
                return TypeAdapter(Speed).validate_python(text)
            except ValidationError as error:
                question = f"{text}: {error.errors()[0]['msg']}; speed [m/s]?"


@contextmanager
def _lines() -> Iterator[Callable[[], str]]:
    """A function that returns a typed line; keys that were pressed before the terminal takes lines do not count."""
    terminal = sys.stdin.fileno()
    before, taking = termios.tcgetattr(terminal), termios.tcgetattr(terminal)
    taking[LOCAL] |= termios.ECHO | termios.ICANON
    termios.tcsetattr(terminal, termios.TCSAFLUSH, taking)
    try:
        yield lambda: os.read(terminal, LONGEST_LINE).decode(errors="replace").strip()
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)


@contextmanager
def _keys() -> Iterator[Callable[[], str]]:
    """A function that returns the pressed key, or "" without one."""
    terminal = sys.stdin.fileno()
    before = termios.tcgetattr(terminal)
    tty.setcbreak(terminal)
    try:

        def read_key() -> str:
            ready, _, _ = select.select([terminal], [], [], 0.0)
            if not ready:
                return ""
            first = os.read(terminal, 1)
            if first == b"\x1b" and select.select([terminal], [], [], PERIOD_S)[0]:
                first += os.read(terminal, 2)
            return first.decode(errors="replace")

        yield read_key
    finally:
        termios.tcsetattr(terminal, termios.TCSADRAIN, before)
