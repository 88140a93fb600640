"""A short drive of a network that always steers straight, alone, into a bend."""

from pathlib import Path

from driving_network_rig import write_network

from learning.correcting.alone import drive_alone, scenario_for
from sim_harness.lockstep.closed_loop import Result

SCENARIO = """\
description: {description}
tags: [curve]
road: straight
segments:
  - {{length_m: 6}}
  - {{length_m: 3, curvature_1pm: [0, {curvature_1pm}]}}
  - {{length_m: 60, curvature_1pm: {curvature_1pm}}}
distance_m: {distance_m}
duration_s: 1
"""


def scenario_file(
    folder: Path, *, curvature_1pm: float, distance_m: float = 18.0, name: str = "short"
) -> Path:
    """A short road that bends after 6 m."""
    path = folder / f"{name}.yaml"
    path.write_text(SCENARIO.format(description=name, curvature_1pm=curvature_1pm, distance_m=distance_m))
    return path


def drive_straight(folder: Path, *, curvature_1pm: float, unlike: float = 0.5) -> tuple[Path, Result]:
    """The recording and the result of a drive of a network that always steers straight."""
    network = write_network(folder / "ahead.onnx", gain_rad=0.0, unlike=unlike)
    scenario = scenario_for(
        str(scenario_file(folder, curvature_1pm=curvature_1pm)), network, {"speed_mps": "3"}
    )
    path = folder / "drive.mcap"
    return path, drive_alone(scenario, seed=0, record=path)
