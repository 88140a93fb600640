"""Helpers of benchmarks: a description of the machine, and times of calls."""

import importlib.metadata
import os
import platform
import time
from collections.abc import Callable
from typing import Any

import numpy as np

LIBRARIES = ("numpy", "opencv-python-headless", "onnxruntime", "eclipse-zenoh")


def machine() -> dict[str, Any]:
    """The machine, its load, and the versions of Python and of the libraries that calculate."""
    return {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, {platform.system()} {platform.release()}",
        "python": platform.python_version(),
        "load_average": [round(load, 2) for load in os.getloadavg()],
        "versions": {name: importlib.metadata.version(name) for name in LIBRARIES},
    }


def summary_ms(times_s: list[float]) -> dict[str, float]:
    """Median and 99th percentile [ms] of times [s]."""
    p50, p99 = np.percentile(times_s, [50, 99]) * 1e3
    return {"median_ms": round(float(p50), 3), "p99_ms": round(float(p99), 3)}


def timed(call: Callable[..., object], *args: object, **kwargs: object) -> float:
    """Wall-clock time of one call [s]."""
    started_s = time.perf_counter()
    call(*args, **kwargs)
    return time.perf_counter() - started_s
