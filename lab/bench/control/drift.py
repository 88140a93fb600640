"""Overshoot after a lateral drift (speeds of Euro NCAP's lane support tests), relative to the least possible.

A driver lets go at the centre of a straight lane while the car drifts at u to one side. Nothing can act before the
dead time T of sight and steering is over; then, within ISO 11270's jerk j, lateral speed ends soonest by

    u - j·t²/2 = 0  at  t = √(2·u/j)        offset there:  u·T + (2/3)·u·√(2·u/j)

as long as the acceleration j·t = √(2·u·j) stays within ISO 11270's 3 m/s², that is up to u = 0.9 m/s. Tyres are
late by 0.1 to 0.15 s more (`controller.model.tyres`); a second figure counts that into T. The whole chain drives:
supervisor, controller, limiter, and a simulated vehicle whose driver takes the car there; only sight is the true
lane.
"""

import math
from collections.abc import Iterator
from itertools import product
from typing import Any

from controller.controller import Controller
from controller.model.tyres import Tyres
from lab.bench.control.contestants import contestants, drive_scenario, nominal, with_tyres
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.world.plants.settings import Model

DRIFTS_MPS = (0.2, 0.3, 0.4, 0.5, 0.6, 0.7)  # Euro NCAP LSS: 0.2 to 0.6 in steps of 0.1
SPEEDS_MPS = (8.94, 20.0)  # 20 mph; 72 km/h as Euro NCAP drives
DEAD_TIME_S, JERK_MPS3 = 0.2, 5.0
DURATION_S = 8.0
SETTLED_S = 4.0


def least_overshoot_m(drift_mps: float, *, dead_time_s: float = DEAD_TIME_S) -> float:
    """The least possible overshoot [m]."""
    return drift_mps * dead_time_s + 2.0 / 3.0 * drift_mps * math.sqrt(2.0 * drift_mps / JERK_MPS3)


def bench_drift(seed: int) -> dict[str, Any]:
    """Worst over speeds and sides: overshoot over the least possible, by drift; departures; remaining offset."""
    rows: dict[str, dict[str, Any]] = {}
    for model, (law, settings) in product((Model.KINEMATIC, Model.SINGLE_TRACK), contestants().items()):
        vehicle = with_tyres(nominal(), model)
        row = rows[f"{law}, {model.value}"] = {"departures": 0, "worst after 4 s [m]": 0.0}
        for drift_mps, scenario in grid(model):
            trace = drive_scenario(scenario, Controller(vehicle, settings), seed=seed)
            away_m = abs(trace["lateral_offset_m"])
            lag_s = Tyres(vehicle).lag_s(scenario.start.speed_mps)
            for counted, late_s in {"": 0.0, ", tyres counted": lag_s}.items():
                if late_s > 0.0 or not counted:
                    least_m = least_overshoot_m(abs(drift_mps), dead_time_s=DEAD_TIME_S + late_s)
                    name = f"{abs(drift_mps):.1f} m/s{counted}"
                    row[name] = max(row.get(name, 0.0), round(float(away_m.max()) / least_m, 3))
            row["departures"] += int(trace["departures"][-1])
            late_m = float(away_m[trace["t_s"] >= SETTLED_S].max())
            row["worst after 4 s [m]"] = max(row["worst after 4 s [m]"], round(late_m, 3))
    return rows


def grid(model: Model) -> Iterator[tuple[float, Scenario]]:
    """Every drift to either side at every speed."""
    for speed_mps, size_mps, sign in product(SPEEDS_MPS, DRIFTS_MPS, (1.0, -1.0)):
        changes = {
            "sight": "truth",
            "start.drift_mps": str(sign * size_mps),
            "start.speed_mps": str(speed_mps),
            "speed_mps": str(speed_mps),
            "distance_m": str(DURATION_S * speed_mps),
            "plant.model": model.value,
        }
        yield sign * size_mps, load_scenario("lss_72kmh", changes)
