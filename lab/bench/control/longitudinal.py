"""Stops relative to their closed form, and gaps behind a braking vehicle.

Stops are driven by the speed control alone on plants with and without an unmodelled drive lag; the distance is
compared with `StopProfile.metres_and_seconds` plus the way during the lag. Following is driven by the whole chain.
"""

from typing import Any

import numpy as np

from controller.controller import ControllerSettings
from controller.speed_control import SpeedControl
from lab.bench.control.contestants import nominal, shipped_settings
from sim_harness.lockstep.closed_loop import run
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import PlantSettings
from trepid.car.vehicle import Vehicle
from trepid.messages import Command, Stop

SPEEDS_MPS = (2.0, 5.0, 8.94, 20.0, 30.0)
TICK_S, CONTROL_EVERY = 0.01, 2
PLANTS = {
    "as modelled": PlantSettings(),
    "drive lag 0.3 s for 0.15 s": PlantSettings(vehicle={"accel_lag_s": 0.3}),
}
FOLLOWING = ("leader_brakes", "stop_and_go", "lead_slow", "standing_car")


def bench_longitudinal(seed: int) -> dict[str, Any]:
    """Errors of stops [m] by speed, the last deceleration and largest jerk; gaps and comfort behind a leader."""
    settings, vehicle = shipped_settings(), nominal()
    rows: dict[str, Any] = {}
    for how, profile in ((Stop.COMFORT, settings.speed.comfort), (Stop.EMERGENCY, settings.speed.emergency)):
        for name, plant in PLANTS.items():
            row, lurches = {}, []
            for speed_mps in SPEEDS_MPS:
                metres, lurch_mps2 = brake(settings, vehicle, plant, how, speed_mps)
                meant = profile.metres_and_seconds(speed_mps)[0] + speed_mps * vehicle.accel_lag_s
                row[f"{speed_mps:g} m/s"] = f"{metres - meant:+.2f} of {meant:.1f} m"
                lurches.append(lurch_mps2)
            rows[f"{how.value} stop, {name}"] = row | {"last deceleration": f"{max(lurches):.2f} m/s²"}
    return rows | {f"behind {name}": _follow(name, seed) for name in FOLLOWING}


def brake(
    settings: ControllerSettings, vehicle: Vehicle, real: PlantSettings, how: Stop, speed_mps: float
) -> tuple[float, float]:
    """Distance [m], and the deceleration [m/s²] in the last moment before standstill."""
    plant = build_plant(real, vehicle)
    control = SpeedControl(settings.speed, vehicle)
    control.release()
    car, tick, demand_mps2, last_mps2 = plant.initial(speed_mps=speed_mps), 0, 0.0, 0.0
    while car.speed_mps > 0.0:
        if tick % CONTROL_EVERY == 0:
            demand_mps2 = control.stop(how, speed_mps=car.speed_mps, dt_s=CONTROL_EVERY * TICK_S)
        last_mps2 = -car.accel_mps2
        command = Command(t_s=None, road_wheel_angle_rad=0.0, speed_mps=0.0, accel_mps2=demand_mps2)
        car, tick = plant.step(car, command, TICK_S), tick + 1
    return car.x_m, last_mps2


def _follow(name: str, seed: int) -> dict[str, float]:
    """Smallest gap [m] and time gap [s], and the root mean squares of acceleration and jerk."""
    result = run(load_scenario(name, {"sight": "truth"}), seed=seed)
    accel_mps2, row = result.trace["longitudinal_accel_mps2"], result.row()
    jerk_mps3 = np.diff(accel_mps2) / TICK_S
    return {
        "smallest gap [m]": round(float(np.nanmin(result.trace["lead_gap_m"])), 2),
        "smallest time gap [s]": round(row["min_time_gap_s"], 2),
        "hardest braking [m/s²]": round(row["max_decel_mps2"], 2),
        "rms acceleration [m/s²]": round(float(np.sqrt(np.mean(accel_mps2**2))), 2),
        "rms jerk [m/s³]": round(float(np.sqrt(np.mean(jerk_mps3**2))), 2),
    }
