"""One tuning from 5 mph to 30 m/s: the S at 2 m/s², or at R = 15 m if the acceleration is lower there."""

from collections.abc import Iterator
from typing import Any

from sim_harness.bench.control.deep_steer import MPH
from sim_harness.bench.control.episode import Episode, drive, s_clothoid
from sim_harness.bench.control.lateral import contestants
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.settings import Model, PlantSettings
from trepid.config import CONFIG_DIR, load
from trepid.vehicle import Vehicle

SPEEDS_MPS = (5 * MPH, 10 * MPH, 15 * MPH, 20 * MPH, 15.0, 20.0, 25.0, 30.0)
LATERAL_MPS2, JERK_MPS3 = 2.0, 1.0
TIGHTEST_M, SHORTEST_ENTRY_M = 15.0, 10.0
ARCS_S = 2 * 2.0 + 2.0  # both arcs, and the straights before and after


def bench_speeds(seed: int) -> dict[str, Any]:
    """Largest distance from the centre of the lane [m] by law and plant, over the speeds [m/s]."""
    rows: dict[str, dict[str, float]] = {}
    for model, episode in episodes(seed):
        for law, settings in contestants().items():
            row = rows.setdefault(f"{law}, {model.value}", {})
            row[f"{episode.speed_mps:.1f}"] = round(drive(episode, settings).worst_m, 4)
    return rows


def episodes(seed: int) -> Iterator[tuple[Model, Episode]]:
    """Cars that equal their vehicle file, with known tyre stiffness."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    rear_slip = 1.0 / (PlantSettings().chassis.rear_stiffness_per_rad * GRAVITY_MPS2)
    tyred = vehicle.model_copy(update=dict(rear_slip_gradient_rad_per_mps2=rear_slip))
    for model, nominal in ((Model.KINEMATIC, vehicle), (Model.SINGLE_TRACK, tyred)):
        for speed_mps in SPEEDS_MPS:
            lateral_mps2 = min(LATERAL_MPS2, speed_mps**2 / TIGHTEST_M)
            jerk_mps3 = min(JERK_MPS3, speed_mps * lateral_mps2 / SHORTEST_ENTRY_M)
            yield (
                model,
                Episode(
                    road=s_clothoid(speed_mps, lateral_mps2=lateral_mps2, jerk_mps3=jerk_mps3),
                    speed_mps=speed_mps,
                    duration_s=ARCS_S - 1.0 + 4.0 * lateral_mps2 / jerk_mps3,
                    nominal=nominal,
                    plant=PlantSettings(model=model),
                    seed=seed,
                ),
            )
