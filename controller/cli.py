"""``trepid vehicle``: the bicycle model on the command line."""

import json
import math
from pathlib import Path
from typing import Annotated

import typer

from controller.bicycle import kinematic_angle, understeer_angle
from trepid.config import CONFIG_DIR, InputError, load, parse_overrides
from trepid.vehicle import Vehicle

app = typer.Typer(no_args_is_help=True)


@app.callback()
def vehicle() -> None:
    """The bicycle model with understeer."""


@app.command()
def steer(
    curvature: Annotated[float, typer.Option(help="Path curvature [1/m], + = bends left.")],
    speed: Annotated[float, typer.Option(help="Speed [m/s]; negative: reverse.")],
    vehicle: Annotated[Path, typer.Option(help="Vehicle file.")] = CONFIG_DIR / "vehicle.yaml",
    roll: Annotated[float, typer.Option(help="Bank of the road [rad], + = left side up.")] = 0.0,
    settings: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Override a field of the vehicle file."),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON only.")] = False,
) -> None:
    """Steering angles that hold a curvature at a speed: δ = atan(L·κ) + K_us·(κ·v² + g·roll)."""
    for name, value in (("--curvature", curvature), ("--speed", speed), ("--roll", roll)):
        if not math.isfinite(value):
            raise InputError(f"{name}: expected a finite number, got {value}")
    car = load(vehicle, Vehicle, overrides=parse_overrides(settings or []))
    angles = steering(car, curvature_1pm=curvature, speed_mps=speed, roll_rad=roll)
    if not math.isfinite(angles["road_wheel_angle_rad"]):
        raise InputError(f"--curvature {curvature} --speed {speed}: too large to compute with")
    if abs(angles["road_wheel_angle_rad"]) > car.max_road_wheel_angle_rad:
        typer.echo(
            f"{car.name} cannot turn its wheels that far: {car.max_road_wheel_angle_rad} rad", err=True
        )
    if as_json:
        typer.echo(json.dumps(angles))
        return
    for name, number in angles.items():
        typer.echo(f"{name:32} {number:+.6f}")


def steering(
    vehicle: Vehicle, *, curvature_1pm: float, speed_mps: float, roll_rad: float
) -> dict[str, float]:
    """Road-wheel and steering-wheel angle of a steady turn, and the two parts of the former."""
    kinematic_rad = kinematic_angle(curvature_1pm, vehicle=vehicle)
    understeer_rad = understeer_angle(curvature_1pm, speed_mps=speed_mps, vehicle=vehicle, roll_rad=roll_rad)
    angle_rad = kinematic_rad + understeer_rad
    return {
        "road_wheel_angle_rad": angle_rad,
        "steering_wheel_angle_deg": math.degrees(angle_rad) * vehicle.steering_ratio,
        "kinematic_road_wheel_angle_rad": kinematic_rad,
        "understeer_rad": understeer_rad,
    }
