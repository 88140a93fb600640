"""The car and the road of the drives with faults: a folder of the car for each wire."""

import json
import os
import socket
from pathlib import Path
from typing import Any

from lab.bench.live.faults.catalogue import CAN
from lab.bench.live.faults.inside import MODULE
from trepid.config import CONFIG_DIR

SPEED_MPS = 3.0
FIRST = -10 if os.geteuid() == 0 else 0
"""Niceness of the processes of a drive that has begun, where the system permits it: neither other programs of the
machine nor the start of another drive are the fault."""
REALTIME = {"supervisor": 10, "controller": 20, "vehicle": 20}
"""Real-time priorities on a real car, as in the template ``shuttle``."""
GROUP = "239.74.163.2"
PERCEPTION: dict[str, tuple[str, dict[str, Any]]] = {
    "cv": ("perception.node", {"estimator": "cv", "statistics": True}),
    "cnn": ("perception.node", {"estimator": "cnn", "statistics": False}),
    "lead": ("perception.lead.node", {}),
    "supervisor": ("supervisor.node", {}),
    "controller": ("controller.node", {}),
}
PUBLISHED = {
    "lead": ["perception/lead"],
    "supervisor": ["supervisor/decision"],
    "controller": ["controller/command"],
    "camera": ["camera/image", "camera/image/compressed"],
}
ROAD = """\
name: faults
closed: true
lane_width_m: 3.3
segments:
  - {length_m: 40}
  - {length_m: 15, curvature_1pm: [0.0, 0.04]}
  - {length_m: 63.539816339744831, curvature_1pm: 0.04}  # half a turn with the clothoids
  - {length_m: 15, curvature_1pm: [0.04, 0.0]}
  - {length_m: 40}
  - {length_m: 15, curvature_1pm: [0.0, 0.04]}
  - {length_m: 63.539816339744831, curvature_1pm: 0.04}
  - {length_m: 15, curvature_1pm: [0.04, 0.0]}
sections:
  - name: marked
    start_m: 0
    left: {stroke: dashed}
    right: {stroke: solid}
    far_left: {stroke: solid}
    paved_left_m: 3.7
"""
SCENARIO = f"""\
description: laps on two straights and two bends of R = 25 m
tags: [fault]
road: faults
speed_mps: {SPEED_MPS}
duration_s: 3600
distance_m: 100000
"""


def write_car(folder: Path, wire: str) -> Path:
    """Write the car of ``wire`` below ``folder``; its folder.

    It starts again half a second after a stop instead of two, and lets a frozen process be for longer than a stop
    lasts, so that a drive has room for several faults.
    """
    car, control = folder / "car", folder / "control"
    for made in (car / "roads", car / "scenarios", control):
        made.mkdir(parents=True)
    (car / "roads" / "faults.yaml").write_text(ROAD)
    (car / "scenarios" / "faults.yaml").write_text(SCENARIO)
    (car / "drive.yaml").write_text("scenario: faults\nsilence_s: 12.0\nready_timeout_s: 60.0\n")
    (car / "supervisor.yaml").write_text("modes: {reengage_after_s: 0.5}\n")
    (car / "processes.yaml").write_text(json.dumps({"processes": processes(wire, control)}))
    if wire == CAN:
        settings = {
            "interface": "udp_multicast",
            "channel": GROUP,
            "options": {"port": free_port(), "hop_limit": 0},
            "map": str(CONFIG_DIR / "cars" / "shuttle" / "can" / "map.yaml"),
        }
        (car / "actuator.yaml").write_text(json.dumps({"actuator": "can", "can": settings}))
    return car


def processes(wire: str, control: Path) -> dict[str, Any]:
    """The processes of the drive; each runs its real module within :mod:`lab.bench.live.faults.inside`."""
    once = {"restart": "never"}  # a simulated car does not begin anew

    def host(module: str, publishes: list[str], **options: Any) -> dict[str, Any]:
        options |= {"hosted": module, "control": str(control)}
        return {"module": MODULE, "options": options} | ({"publishes": publishes} if publishes else {})

    found = {
        name: host(module, PUBLISHED.get(name, []), **options)
        for name, (module, options) in PERCEPTION.items()
    }
    found["camera"] = host("sim_harness.live.camera_node", PUBLISHED["camera"])
    if wire == CAN:
        found["vehicle"] = host("vehicle.actuators.node", ["vehicle/state"])
        found["ecu"] = host("sim_harness.counterparts.ecu", ["sim/truth"], applied="ecu") | once
        for name, priority in REALTIME.items():
            found[name]["options"]["realtime"] = priority
    else:
        found["vehicle"] = (
            host("sim_harness.live.vehicle_node", ["vehicle/state", "sim/truth"], applied="limiter") | once
        )
    return found


def free_port() -> int:
    """A free UDP port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        return int(probe.getsockname()[1])
