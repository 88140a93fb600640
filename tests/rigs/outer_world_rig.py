"""A real car for tests: ECU, car and road outside of the drive, so that they outlive it.

The drive reaches the ECU over CAN, as it would reach a car; the ECU is a process of the test on a bus of its own.
The camera process of the drive is a module in the folder of the car, which renders what a camera on it would take.
"""

import json
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import can_rig
from can_bus_rig import GROUP

from sim_harness.scenarios.scenario import load_scenario
from trepid.bus import Stream, free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import ROOT
from trepid.messages import SimTruth
from trepid.processes.launch import Fleet
from trepid.processes.settings import ProcessSpec
from trepid.topics import SIM_TRUTH

BEND = "[{length_m: 30}, {length_m: 20, curvature_1pm: [0, 0.02]}, {length_m: 150, curvature_1pm: 0.02}]"
EYE = '''"""A camera of the car: the view of the road outside of the drive."""

from types import SimpleNamespace

import cv2
from sim_harness.live.camera_node import run
from trepid.bus import open_bus
from trepid.processes.process import process
from trepid.topics import SIM_TRUTH

cv2.setNumThreads(1)
with process() as me, open_bus("world", me.now_s, connect=me.options["world"]) as world:
    inside = me.bus
    me.options = {**me.options, "scenario": me.options["seen"], "seed": 0}
    me.bus = SimpleNamespace(
        latest=world.latest,
        wait=world.wait,
        publisher=inside.publisher,
        malformed_counts=inside.malformed_counts,
    )
    run(me)
'''


class OuterWorld:
    """The car with its ECU on the road of a scenario, seen by the test alone."""

    def __init__(self, truths: Stream[SimTruth], folder: Path) -> None:
        self._truths = truths
        self.folder = folder
        self.seen: list[SimTruth] = []

    def now(self) -> SimTruth | None:
        """The newest truth; None before the first."""
        self.seen += [truth for truth, _ in self._truths.drain()]
        return self.seen[-1] if self.seen else None

    def moves_at(self, speed_mps: float) -> bool:
        """True when the car has at least this speed."""
        truth = self.now()
        return truth is not None and truth.speed_mps >= speed_mps

    def stands(self) -> bool:
        """True when the car stands."""
        truth = self.now()
        return truth is not None and abs(truth.speed_mps) < 0.05


@contextmanager
def outer_world(folder: Path, bus: dict[str, Any]) -> Iterator[OuterWorld]:
    """A car at rest before a bend, and in ``folder`` the settings with which a drive reaches it.

    ``bus``: options of the CAN bus. The environment variable TREPID_CAR must name ``folder``.
    """
    folder.mkdir()
    shutil.copytree(can_rig.FOLDER, folder / "can")
    wire = dict(interface="udp_multicast", channel=GROUP, options=bus, map="can/map.yaml")
    (folder / "actuator.yaml").write_text(f"actuator: can\ncan: {json.dumps(wire)}\n")
    (folder / "eye.py").write_text(EYE)
    scenario = load_scenario("straight", {"segments": BEND})
    context = {"scenario": scenario.model_dump(mode="json"), "seed": 0}
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    camera = {
        "module": "eye",
        "publishes": ["camera/image", "camera/image/compressed"],
        "options": {"world": endpoint, "seen": context["scenario"]},
    }
    (folder / "processes.yaml").write_text(
        "processes:\n"
        "  vehicle: {module: vehicle.actuators.node, publishes: [vehicle/state]}\n"
        f"  camera: {json.dumps(camera)}\n"
        "  lead: null\n"
    )
    ecu = ProcessSpec("ecu", "sim_harness.counterparts.ecu", publishes=("sim/truth",))
    with (
        open_bus("world", epoch_clock(offset_ns), listen=endpoint) as world,
        Fleet((ecu,), vehicle_name="world", endpoint=endpoint, clock_offset_ns=offset_ns, context=context),
    ):
        yield OuterWorld(world.stream(SIM_TRUTH), folder)


class RealDrive:
    """`trepid drive --car` of the car in an outer world: a drive without a scenario."""

    def __init__(self, folder: Path, *words: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, "-m", "trepid", "drive", "--car", str(folder), "--json", *words],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def children(self) -> list[int]:
        """Process ids of the processes of the drive."""
        found = []
        for path in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
            except (FileNotFoundError, ProcessLookupError):
                continue
            if parent == self.popen.pid:
                found.append(int(path.name))
        return found

    def row(self) -> dict[str, Any]:
        """The row of the drive after its end."""
        out, err = self.popen.communicate(timeout=60)
        assert "Traceback" not in err, err
        return dict(json.loads(out), returncode=self.popen.returncode)

    def close(self) -> None:
        if self.popen.poll() is None:
            self.popen.send_signal(signal.SIGTERM)
            self.popen.communicate(timeout=60)
