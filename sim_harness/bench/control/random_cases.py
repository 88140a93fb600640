"""A thousand cars that differ from their vehicle file in all parameters, driven by the configured law."""

import sys
import time
from typing import Any

import numpy as np

from controller.controller import ControllerSettings
from sim_harness.bench.control.episode import drive
from sim_harness.bench.control.lateral import RANDOM_TARGET_M, random_cases
from trepid.config import CONFIG_DIR, load

CASES = 1000
PROGRESS_S = 10.0


def bench_random(seed: int, cases: int = CASES) -> dict[str, Any]:
    """Largest distances from the centre of the lane [m] over the cases, and the number beyond the target."""
    settings = load(CONFIG_DIR / "controller.yaml", ControllerSettings)
    worst_m, began_s = [], time.monotonic()
    reported_s = began_s
    for episode in random_cases(seed, cases):
        worst_m.append(drive(episode, settings).worst_m)
        if time.monotonic() - reported_s > PROGRESS_S:
            reported_s = time.monotonic()
            left_s = (reported_s - began_s) / len(worst_m) * (cases - len(worst_m))
            print(f"random: {len(worst_m)} of {cases} cases, about {left_s:.0f} s left", file=sys.stderr)
    return {
        "law": settings.lateral.law.value,
        "cases": cases,
        "target [m]": RANDOM_TARGET_M,
        "largest [m]": round(max(worst_m), 4),
        "99th percentile [m]": round(float(np.percentile(worst_m, 99)), 4),
        "median [m]": round(float(np.median(worst_m)), 4),
        "beyond the target": sum(error_m > RANDOM_TARGET_M for error_m in worst_m),
    }
