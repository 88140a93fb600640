"""A flood of messages at a running drive: the car keeps driving or stops safely, and memory stays bounded.

The attacker sends malformed commands as fast as one process can, from a session without rights: on the loopback
interface of a drive without keys, where anybody may publish, and with the certificate of an observer, whose
messages every process drops before they reach Python.
"""

import json
import multiprocessing
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from trepid.bus import free_endpoint, open_graph
from trepid.config import CONFIG_DIR, load
from trepid.processes.drive_settings import DriveSettings
from trepid.processes.settings import load_processes
from trepid.security import LAUNCHER, OBSERVER, load_security, session_settings
from trepid.topics import COMMAND

DRIVE_S = 20.0
CALM_S = 4.0  # of driving before the flood
FLOOD_S = 8.0
RATE_HZ = 100_000
BATCH = 100
SENDER = {"mode": "peer", "scouting/gossip/enabled": True, "listen/endpoints": ["tcp/127.0.0.1:0"]}


def bench_security_flood(seed: int) -> dict[str, Any]:
    """For a drive without keys and one with keys: rate of the flood, departures, greatest growth of a process."""
    return {
        "flood": {
            "without keys": drive_in_flood(seed, keys=False),
            "with keys": drive_in_flood(seed, keys=True),
        }
    }


def drive_in_flood(seed: int, *, keys: bool) -> dict[str, Any]:
    """One drive on the circuit under the flood."""
    endpoint = free_endpoint()
    with tempfile.TemporaryDirectory() as folder:
        car = Path(folder)
        (car / "security.yaml").write_text(
            f"listen: {endpoint.partition('/')[2]}\n{'keys: keys' if keys else ''}\n"
        )
        attacker: dict[str, Any] = {"connect/endpoints": [endpoint]}
        if keys:
            from vehicle.certificates import create

            create(car / "keys", [LAUNCHER, OBSERVER, *(spec.name for spec in load_processes())])
            security = load_security().model_copy(update={"keys": car / "keys"})
            attacker = session_settings(OBSERVER, connect=endpoint, security=security)
        command = [sys.executable, "-m", "trepid", "drive", "--car", str(car), "--seed", str(seed)]
        command += ["--duration", str(DRIVE_S), "--no-dashboard", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as drive:
            return _attack(drive, attacker)


def _attack(drive: "subprocess.Popen[str]", attacker: Mapping[str, Any]) -> dict[str, Any]:
    sent = multiprocessing.get_context("spawn").Value("q", 0)
    flooder = multiprocessing.get_context("spawn").Process(target=flood, args=(dict(attacker), sent))
    driving = next((line for line in drive.stderr or () if "KEEP" in line), None)
    threading.Thread(target=lambda: list(drive.stderr or ()), daemon=True).start()  # keeps the pipe empty
    if driving is None:
        raise RuntimeError("the drive ended before it drove")
    time.sleep(CALM_S)
    before = memory_mb(drive.pid)
    flooder.start()
    greatest = dict(before)
    while flooder.is_alive() and drive.poll() is None:
        for pid, mb in memory_mb(drive.pid).items():
            greatest[pid] = max(mb, greatest.get(pid, mb))
        time.sleep(0.25)
    flooder.join()
    row = json.loads(drive.communicate()[0])
    growth = [mb - before[pid] for pid, mb in greatest.items() if pid in before]
    return {
        "sent_per_s": round(sent.value / FLOOD_S),
        "departures": row["departures"],
        "collisions": row.get("collisions"),
        "distance_m": round(row["distance_m"], 1),
        "modes": row.get("modes"),
        "reasons": row["reasons"],
        "most_growth_mb": round(max(growth), 1) if growth else None,
    }


def memory_mb(pid: int) -> dict[int, float]:
    """Resident memory [MB] of the children of ``pid`` by their ids."""
    found = {}
    for child in (
        Path(f"/proc/{pid}/task/{pid}/children").read_text().split() if Path(f"/proc/{pid}").exists() else ()
    ):
        try:
            status = Path(f"/proc/{child}/status").read_text()
        except OSError:  # it ended meanwhile
            continue
        line = next((line for line in status.splitlines() if line.startswith("VmRSS")), None)
        if line is not None:
            found[int(child)] = float(line.split()[1]) / 1024
    return found


def flood(settings: dict[str, Any], sent: Any) -> None:
    """Send malformed commands for FLOOD_S, at most RATE_HZ; ``sent`` counts them."""
    name = load(CONFIG_DIR / "drive.yaml", DriveSettings).vehicle_name
    with open_graph({**SENDER, **settings}) as graph:
        send = graph.publisher(f"trepid/{name}/{COMMAND.key}")
        time.sleep(1.0)  # for connections by gossip
        began_s = time.monotonic()
        junk = bytes(64)
        while (elapsed_s := time.monotonic() - began_s) < FLOOD_S:
            if sent.value >= RATE_HZ * elapsed_s:
                time.sleep(0.001)
                continue
            for _ in range(BATCH):
                send(junk, None)
            sent.value += BATCH
