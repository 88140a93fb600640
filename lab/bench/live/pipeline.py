"""The way of a frame through all processes at 30 Hz, beside bare Zenoh in the same run.

Arms, in turns: every node in a process of its own; the nodes of the frame in one process; both also in the
real-time class where the system permits it. Each arm drives the straight with a bare ping beside it.
"""

import os
import statistics
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drive.log import DriveLog
from drive.plan import context_of, plan_processes
from lab.bench.live.overload import overload
from lab.bench.live.ping import pinging
from sim_harness.live.course import ScenarioCourse
from sim_harness.scenarios.scenario import Scenario, load_scenario
from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import InputError
from trepid.processes.fused import FUSED, gather_specs
from trepid.processes.launch import Fleet
from trepid.processes.settings import ProcessSpec, Restart, load_processes
from trepid.processes.timing import APPLIES, COMMANDS, DECIDES, Summary

RATE_HZ = 30.0
DRIVE_S = 20.0
ROUNDS = 2
READY_S = 30.0
PING_HZ = 5.0
RECEIVE_S = 0.1  # between two readings of the launcher, so that it takes little time from the others
SIMULATED = {"vehicle", "camera"}
Row = dict[str, Any]


def bench_pipeline(seed: int) -> Row:
    """Latency from stage to stage, transport against bare Zenoh, CPU, by arm; lag under overload."""
    scenario = load_scenario("straight", {"camera.rate_hz": str(RATE_HZ)})
    specs = plan_processes(load_processes(), ScenarioCourse(scenario))
    arms = {
        "a process each": specs,
        "one process": in_one_process(specs),
        "a process each, real-time": in_real_time(specs),
        "one process, real-time": in_real_time(in_one_process(specs)),
    }
    runs: dict[str, list[Row]] = {name: [] for name in arms}
    for _ in range(ROUNDS):
        for name, arm in arms.items():
            runs[name].append(drive_pipeline(scenario, arm, seed=seed))
    table = {name: _merge_rounds(rows) for name, rows in runs.items()}
    return {
        "from the published frame [ms]": {name: _flat(row["latency"]) for name, row in table.items()},
        "transport, relative to bare Zenoh": {name: row["transport"] for name, row in table.items()},
        "stages, a process each [ms]": _stages(runs["a process each"][-1]),
        "stages, one process [ms]": _stages(runs["one process"][-1]),
        "share of a core [%]": {name: row["cpu"] for name, row in table.items()},
        "frames twice as fast as the step": overload(),
    }


def in_one_process(specs: tuple[ProcessSpec, ...]) -> tuple[ProcessSpec, ...]:
    """``specs`` with the nodes of the frame in one process; the vehicle ahead comes after the command."""
    shared = tuple(s if s.name in SIMULATED else replace(s, together="frame") for s in specs)
    return gather_specs(tuple(sorted(shared, key=lambda spec: spec.name == "lead")))


def in_real_time(specs: tuple[ProcessSpec, ...]) -> tuple[ProcessSpec, ...]:
    """``specs`` with the processes of the frame in the real-time class, but for the lead detector."""
    return tuple(
        spec
        if spec.name in SIMULATED | {"lead"}
        else replace(spec, options={**spec.options, "realtime": 20 if spec.name == COMMANDS else 10})
        for spec in specs
    )


def drive_pipeline(scenario: Scenario, specs: tuple[ProcessSpec, ...], *, seed: int) -> Row:
    """One drive with ``specs`` beside a bare ping: latencies, stages, ping, CPU."""
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    clock = epoch_clock(offset_ns)
    receivers = sum(spec.module.startswith("perception") or spec.module == FUSED for spec in specs)
    with (
        open_bus("bench", clock, listen=endpoint) as bus,
        Fleet(
            tuple(replace(spec, restart=Restart.NEVER) for spec in specs),
            vehicle_name="bench",
            endpoint=endpoint,
            clock_offset_ns=offset_ns,
            context=context_of(ScenarioCourse(scenario), scenario.estimators, seed),
        ) as fleet,
        pinging(receivers, rate_hz=PING_HZ) as ping,
    ):
        log = DriveLog(bus, clock, scenario.estimators)
        started_s = clock()
        while log.state is None or (log.state.speed_mps or 0.0) < 1.0:
            log.receive(RECEIVE_S)
            for ended in fleet.collect_exits():
                raise InputError(str(ended))
            if clock() - started_s > READY_S:
                raise InputError(f"the car does not drive within {READY_S:.0f} s")
        log.restart()
        before, began_s = _cpu_s(fleet), time.monotonic()
        launcher_s = time.process_time()
        while time.monotonic() - began_s < DRIVE_S:
            log.receive(RECEIVE_S)
        wall_s = time.monotonic() - began_s
        cpu = {name: 100 * (s - before[name]) / wall_s for name, s in _cpu_s(fleet).items()}
        cpu["launcher"] = 100 * (time.process_time() - launcher_s) / wall_s
        return {
            "latency": log.times.latency_ms(),
            "stages": log.times.stages_ms(),
            "spread": log.times.spread_ms(),
            "ping": ping.results(),
            "cpu": cpu,
            "diagnostics": {name: beat.message for name, beat in log.diagnostics.items()},
        }


def _cpu_s(fleet: Fleet) -> dict[str, float]:
    """Time on the processor by process, user and system [s]."""
    tick_s = 1 / os.sysconf("SC_CLK_TCK")
    found = {}
    for name, child in fleet.children.items():
        fields = Path(f"/proc/{child.popen.pid}/stat").read_text().rsplit(")", 1)[1].split()
        found[name] = tick_s * (int(fields[11]) + int(fields[12]))
    return found


def _merge_rounds(rows: list[Row]) -> Row:
    """The median over the rounds of one arm."""
    latency: dict[str, Summary | None] = {}
    for stage in rows[0]["latency"]:
        found = [row["latency"][stage] for row in rows if row["latency"][stage]]
        latency[stage] = _median(found)
    return {
        "latency": {**latency, "first_to_last_estimate": _median([r["spread"] for r in rows if r["spread"]])},
        "transport": _transport(rows),
        "cpu": _load(rows),
    }


def _median(found: list[Summary]) -> Summary | None:
    if not found:
        return None
    return {key: round(statistics.median(one[key] for one in found), 2) for key in found[0]}


def _transport(rows: list[Row]) -> Row:
    """Transport of frames and messages, the bare ping beside it, and the ratio of the medians of each round."""
    kinds = {"image": ("cv", "cnn", "lead"), "message": (DECIDES, COMMANDS, APPLIES)}
    found: Row = {}
    for kind, receivers in kinds.items():
        ours, bare, ratios = [], [], []
        for row in rows:
            times = [row["stages"][name]["transport"] for name in receivers if name in row["stages"]]
            wired = [one for one in times if one and one["p50"] > 0.0]  # not handed over in one process
            ping = row["ping"][kind]
            one = _median(wired)
            if one and ping:
                ours.append(one)
                bare.append(ping)
                ratios.append(one["p50"] / ping["p50"])
        ours_ms, bare_ms = _median(ours), _median(bare)
        found[f"{kind}, p50 [ms]"] = ours_ms and ours_ms["p50"]
        found[f"{kind}, bare p50 [ms]"] = bare_ms and bare_ms["p50"]
        found[f"{kind}, p99 [ms]"] = ours_ms and ours_ms["p99"]
        found[f"{kind}, bare p99 [ms]"] = bare_ms and bare_ms["p99"]
        found[f"{kind}, ratio p50"] = round(statistics.median(ratios), 2) if ratios else None
    return found


def _load(rows: list[Row]) -> Row:
    """Share of a core by process, and of all without the simulated ones and the launcher [%]."""
    names = list(rows[0]["cpu"])
    load = {name: round(statistics.median(row["cpu"][name] for row in rows), 1) for name in names}
    own = sum(share for name, share in load.items() if name not in SIMULATED | {"launcher"})
    return {"without simulator and launcher": round(own, 1), **load}


def _flat(latency: Mapping[str, Summary | None]) -> Row:
    return {f"{stage} {key}": one[key] for stage, one in latency.items() if one for key in ("p50", "p99")}


def _stages(row: Row) -> Row:
    return {process: dict(_columns(stages)) for process, stages in row["stages"].items()}


def _columns(stages: Mapping[str, Summary | None]) -> Iterator[tuple[str, float]]:
    for stage, one in stages.items():
        if one:
            yield f"{stage} p50", one["p50"]
            yield f"{stage} p99", one["p99"]
