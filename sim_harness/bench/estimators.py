"""Time of the estimators and of the image statistics for one frame, relative to a plain Canny and Hough chain."""

from typing import Any

import cv2
import numpy as np

from perception.camera.image_statistics import ImageStatistician
from perception.estimators import ESTIMATORS, build
from sim_harness.bench.perception.watch import bare_canny_chain
from sim_harness.bench.renderer import lap
from sim_harness.bench.timing import summary_ms, timed

UNMARKED = "unmarked"  # name of the section of the circuit without paint


def bench_estimators() -> dict[str, Any]:
    """Time per 320×240 frame of every estimator and the image statistics, one thread, and of the plain chain.

    The frames of the unmarked section of the lap have a row of their own, too.
    """
    cv2.setNumThreads(1)
    estimators = {name: build(name) for name in ESTIMATORS}
    statistician = ImageStatistician()
    times_s: dict[str, list[float]] = {}
    for frame, state, part, _ in lap():
        for name, estimator in estimators.items():
            time_s = timed(estimator.step, frame, state, now_s=frame.t_s)
            for row in (name, f"{name}, {part}") if part == UNMARKED else (name,):
                times_s.setdefault(row, []).append(time_s)
        times_s.setdefault("image_statistics", []).append(timed(statistician.step, frame, now_s=frame.t_s))
        times_s.setdefault("bare_canny_chain", []).append(timed(bare_canny_chain, frame.image))
    peer_s = float(np.median(times_s["bare_canny_chain"]))
    return {
        name: {**summary_ms(times), "ratio_to_bare_chain": round(float(np.median(times)) / peer_s, 2)}
        for name, times in times_s.items()
    }
