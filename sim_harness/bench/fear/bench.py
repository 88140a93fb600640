"""``trepid bench fear``: what the fear engine costs and what it finds."""

from collections.abc import Callable
from typing import Any

from sim_harness.bench.fear.causes import bench_causes
from sim_harness.bench.fear.fuzz import bench_fuzz
from sim_harness.bench.fear.inference import bench_inference
from sim_harness.bench.fear.supervision import bench_supervision

SECTIONS: dict[str, Callable[[int], dict[str, Any]]] = {
    "inference": bench_inference,
    "causes": bench_causes,
    "fuzz": bench_fuzz,
    "supervision": bench_supervision,
}
"""Each is given the seed and gives what it measured; one that draws lots draws them from the seed only."""


def bench_fear(seed: int) -> dict[str, Any]:
    """All sections."""
    return {
        f"{section}: {name}": value
        for section, measure in SECTIONS.items()
        for name, value in measure(seed).items()
    }
