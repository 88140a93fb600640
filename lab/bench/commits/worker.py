"""One tree under :mod:`lab.bench.commits.paired`: draws or drives at each line of its input, and prints the time.

Run by its path with the tree first in PYTHONPATH, so that it uses only what every commit to compare with has.
"""

import sys
import time
from collections.abc import Iterator
from itertools import count

import cv2

from sim_harness.lockstep.closed_loop import ClosedLoop, build_parts
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import Scenario, load_scenario
from sim_harness.world.render.renderer import Renderer
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

FRAMES, STEP_M, PERIOD_S = 20, 0.32, 0.04  # of a turn; the way between two frames at 8 m/s
DRIVE_S = 5.0


def frame(scenario: Scenario) -> Iterator[float]:
    """Computing times of a frame [s], each a mean over FRAMES further along the road, ground included."""
    road = scenario.build_road()
    renderer = Renderer(road, load(CONFIG_DIR / "camera.yaml", Camera), seed=0)
    for turn in count():
        began_s = time.process_time()
        for i in range(turn * FRAMES, (turn + 1) * FRAMES):
            station_m = i * STEP_M % (road.length_m - 1.0)
            x_m, y_m = road.position(station_m, 0.0)
            yaw_rad = road.heading_at(station_m)
            renderer.render(x_m, y_m, yaw_rad, station_m=station_m, t_s=i * PERIOD_S)
        yield (time.process_time() - began_s) / FRAMES


def drive(scenario: Scenario) -> Iterator[float]:
    """Computing times of a simulated second [s], of drives of DRIVE_S with pixels and all estimators."""
    scenario = scenario.model_copy(update={"duration_s": DRIVE_S})
    for _ in count():
        loop = ClosedLoop(scenario, build_parts(scenario, seed=0), load_simulator())
        began_s = time.process_time()
        trace = loop.drive()
        used_s = time.process_time() - began_s
        yield used_s / float(trace["t_s"][-1] - trace["t_s"][0])


if __name__ == "__main__":
    cv2.setNumThreads(1)
    times_s = {"frame": frame, "drive": drive}[sys.argv[1]](load_scenario(sys.argv[2]))
    for _ in sys.stdin:
        print(f"{next(times_s):.9f}", flush=True)
