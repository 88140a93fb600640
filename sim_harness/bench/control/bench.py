"""``trepid bench control``: every section, or one of them as ``control-NAME``."""

from collections.abc import Callable
from typing import Any

from sim_harness.bench.control.deep_steer import bench_deep_steer
from sim_harness.bench.control.drift import bench_drift
from sim_harness.bench.control.lateral import bench_lateral
from sim_harness.bench.control.learning import bench_learning
from sim_harness.bench.control.longitudinal import bench_longitudinal
from sim_harness.bench.control.mpc import bench_mpc
from sim_harness.bench.control.ranking import bench_ranking
from sim_harness.bench.control.speeds import bench_speeds

SECTIONS: dict[str, Callable[[int], dict[str, Any]]] = {
    "lateral": bench_lateral,
    "mpc": bench_mpc,
    "speeds": bench_speeds,
    "deep-steer": bench_deep_steer,
    "drift": bench_drift,
    "learning": bench_learning,
    "longitudinal": bench_longitudinal,
    "ranking": bench_ranking,
}
"""Each is given the seed and gives what it measured; one that draws lots draws them from the seed only."""


def bench_control(seed: int) -> dict[str, Any]:
    """All sections."""
    return {
        f"{section}: {name}": value
        for section, measure in SECTIONS.items()
        for name, value in measure(seed).items()
    }
