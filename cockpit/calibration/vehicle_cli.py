"""``trepid vehicle``: steering angles of the bicycle model, its parameters from a log, margins of the loop."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from controller.model.bicycle import GRAVITY_MPS2, understeer_angle
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.config import CONFIG_DIR, InputError, load, parse_overrides
from trepid.loudness import warn
from trepid.options import Car

if TYPE_CHECKING:
    from cockpit.calibration.identification import Parameter

VEHICLE = CONFIG_DIR / "vehicle.yaml"
VehicleFile = Annotated[Path, typer.Option(help="Vehicle file.")]
Settings = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Override a field of the vehicle file."),
]
AsJson = Annotated[bool, typer.Option("--json", help="Print JSON only.")]

app = typer.Typer(no_args_is_help=True)


@app.callback()
def vehicle() -> None:
    """Bicycle model with understeer: angles, identification, margins."""


@app.command()
def steer(
    curvature: Annotated[float, typer.Option(help="Path curvature [1/m], + = bends left.")],
    speed: Annotated[float, typer.Option(help="Speed [m/s]; negative: reverse.")],
    vehicle: VehicleFile = VEHICLE,
    roll: Annotated[float, typer.Option(help="Bank of the road [rad], + = left side up.")] = 0.0,
    settings: Settings = None,
    car: Car = None,
    as_json: AsJson = False,
) -> None:
    """Steering angles that hold a curvature at a speed: δ = atan(L·κ) + K_us·(κ·v² + g·roll)."""
    for name, value in (("--curvature", curvature), ("--speed", speed), ("--roll", roll)):
        if not math.isfinite(value):
            raise InputError(f"{name}: expected a finite number, got {value}")
    loaded = load(vehicle, Vehicle, overrides=parse_overrides(settings or []))
    kinematic_rad = road_wheel_angle(curvature, wheelbase_m=loaded.wheelbase_m)
    understeer_rad = understeer_angle(curvature, speed_mps=speed, vehicle=loaded, roll_rad=roll)
    angle_rad = kinematic_rad + understeer_rad
    if not math.isfinite(angle_rad):
        raise InputError(f"--curvature {curvature} --speed {speed}: too large to compute with")
    if abs(angle_rad) > (most_rad := loaded.max_road_wheel_angle_rad):
        typer.echo(f"{loaded.name}: larger than the largest road-wheel angle, {most_rad} rad", err=True)
    angles = {
        "road_wheel_angle_rad": angle_rad,
        "steering_wheel_angle_deg": math.degrees(angle_rad) * loaded.steering_ratio,
        "kinematic_road_wheel_angle_rad": kinematic_rad,
        "understeer_rad": understeer_rad,
    }
    if as_json:
        typer.echo(json.dumps(angles))
        return
    for name, number in angles.items():
        typer.echo(f"{name:32} {number:+z.6f}")


@app.command()
def identify(
    log: Annotated[Path, typer.Argument(help="Recording (.mcap), trace (.npz) or table (.csv).")],
    vehicle: Annotated[
        Path, typer.Option(help="Vehicle file: wheelbase, rate limit, initial steering ratio.")
    ] = VEHICLE,
    known_ratio: Annotated[
        bool,
        typer.Option(
            "--known-ratio", help="Use the steering ratio of the vehicle file instead of identifying it."
        ),
    ] = False,
    anyway: Annotated[
        bool, typer.Option("--anyway", help="Also print parameters that the log does not excite enough.")
    ] = False,
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=COLUMN", help="Column of a table (.csv) that holds NAME; -COLUMN reverses its sign."
        ),
    ] = None,
    settings: Settings = None,
    car: Car = None,
    as_json: AsJson = False,
) -> int:
    """Understeer, ratio, offset, dead time and lag of the steering from a log, with 95 % confidence intervals.

    Units are printed with each value. Exit code 1, with the reason, when the log does not excite the understeer.
    """
    from cockpit.calibration.drive_log import read_log  # scipy and MCAP take a second; `steer` needs neither
    from cockpit.calibration.identification import identify_understeer
    from cockpit.calibration.steering_response import identify_response

    loaded = load(vehicle, Vehicle, overrides=parse_overrides(settings or []))
    drive = read_log(log, dict(_renaming(text) for text in column or []))
    if not drive.complete:
        warn(f"trepid: {log}: cut short; read up to its last whole chunk")
    steady = identify_understeer(drive, loaded, known_ratio=known_ratio, anyway=anyway)
    response = identify_response(drive, loaded)
    found = {**steady.parameters, **response.parameters}
    excitation = {**steady.excitation, **response.excitation}
    parts = {"understeer": steady, "response": response}
    refused = {name: part.refused for name, part in parts.items() if part.refused}
    if as_json:
        values = {name: {"value": p.value, "ci95": list(p.ci95), "unit": p.unit} for name, p in found.items()}
        print(json.dumps({"parameters": values, "excitation": excitation, "refused": refused}))
    else:
        for name, p in found.items():
            print(
                f"{name:34} {p.value:+z.5f}   95 %: {p.ci95[0]:+z.5f} to {p.ci95[1]:+z.5f}   {_readable(p)}"
            )
        for name, amount in excitation.items():
            print(f"excited: {name:38} {amount:.4g}")
    for name, reason in refused.items():
        warn(f"trepid: {log}: {name} not identified: {reason}")
    return 1 if steady.refused else 0


@app.command()
def margins(
    vehicle: VehicleFile = VEHICLE,
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw Bode and step diagrams of the loop into this file (.png, .svg, .pdf)."),
    ] = None,
    settings: Settings = None,
    car: Car = None,
    as_json: AsJson = False,
) -> None:
    """Bandwidth [rad/s] and gain [dB], phase [deg], delay [s] and disk margins of the LQI loop over speed [m/s]."""
    from controller.controller import ControllerSettings
    from controller.laws.lqi import Lqi
    from controller.laws.lqi_design import disk_margin, draw

    loaded = load(vehicle, Vehicle, overrides=parse_overrides(settings or []))
    lateral = load(CONFIG_DIR / "controller.yaml", ControllerSettings).lateral
    law = Lqi(lateral.lqi, loaded, command_delay_s=lateral.command_delay_s)
    rows = [
        {
            "speed_mps": design.speed_mps,
            "bandwidth_radps": round(design.bandwidth_radps, 3),
            "gain_margin_db": round(design.margins.gain_db, 1) if design.margins.gain < math.inf else None,
            "phase_margin_deg": round(math.degrees(design.margins.phase_rad), 1),
            "delay_margin_s": round(design.margins.delay_s, 3),
            "disk_margin": round(disk_margin(design, lags), 3),
        }
        for design, lags in zip(law.designs, law.lags, strict=True)
    ]
    if picture is not None:
        draw(picture, law.designs, law.lags, title=f"LQI steering loop of {loaded.name}")
    if as_json:
        typer.echo(json.dumps(rows))
        return
    typer.echo(" ".join(f"{name:>16}" for name in rows[0]))
    for row in rows:
        typer.echo(" ".join(f"{'inf' if value is None else value:>16}" for value in row.values()))


def _renaming(text: str) -> tuple[str, str]:
    name, sign, theirs = text.partition("=")
    if not (name and sign and theirs):
        raise InputError(f"--column {text}: expected NAME=COLUMN")
    return name, theirs


def _readable(parameter: "Parameter") -> str:
    """The value in degrees where its unit is in radians; else the unit."""
    if parameter.unit == "rad/(m/s²)":
        return f"= {math.degrees(parameter.value * GRAVITY_MPS2):z.2f} deg/g"
    if parameter.unit in {"rad", "rad/s"}:
        return f"= {math.degrees(parameter.value):z.3f} {parameter.unit.replace('rad', 'deg')}"
    return parameter.unit
