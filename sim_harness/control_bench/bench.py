"""``trepid bench control``: every section, or one of them as ``control-NAME``."""

from collections.abc import Callable
from typing import Any

from sim_harness.control_bench.lateral import bench_lateral

SECTIONS: dict[str, Callable[[int], dict[str, Any]]] = {
    "lateral": bench_lateral,
}
"""Each is given the seed and gives what it measured; one that draws lots draws them from the seed only."""


def bench_control(seed: int) -> dict[str, Any]:
    """All sections."""
    return {
        f"{section}: {name}": value
        for section, measure in SECTIONS.items()
        for name, value in measure(seed).items()
    }
