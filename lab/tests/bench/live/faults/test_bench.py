"""The plan of the drives with faults, and the table of their episodes."""

import sys
import threading
import time
from collections.abc import Mapping
from concurrent.futures import wait
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lab.bench.live.faults import bench
from lab.bench.live.faults.bench import (
    FAILURES,
    SURVIVED,
    Task,
    bench_faults,
    case,
    next_drive,
    table,
)
from lab.bench.live.faults.catalogue import CAN, FAULTS, SIM, WIRES, Act, Fault
from lab.bench.live.faults.course import REALTIME, processes
from trepid.cli import main
from trepid.config import InputError, using_car
from trepid.processes.settings import load_processes

TASKS = [
    (wire, fault, number)
    for number in range(2)
    for wire in WIRES
    for fault in FAULTS.values()
    if wire in fault.wires
]


def row(fault: str = "kill-cv", **changes: Any) -> dict[str, Any]:
    calm = dict(
        wire=SIM, fault=fault, number=0, load=1.0, observable_ms=0.0, reaction_ms=50.0, braked_ms=50.0, jobs=1
    )
    end = dict(stood_s=3.0, departures=0, resumed=None, hung=False, orphans=[], recording="complete")
    return calm | end | changes


def test_every_episode_is_driven_once_and_at_most_one_fault_ends_a_drive() -> None:
    left, drives = list(TASKS), []
    while left:
        drives.append(next_drive(left))
        for task in drives[-1]:
            left.remove(task)
    assert sum(map(len, drives)) == len(TASKS)
    for drive in drives:
        assert len({(wire, number) for wire, _, number in drive}) == 1
        assert not any(fault.ends_drive for _, fault, _ in drive[:-1])
        assert len(drive) <= SURVIVED + 1


@pytest.mark.parametrize("jobs", [1, 3])
def test_several_drives_at_a_time_give_every_episode_one_row_and_repeat_what_a_drive_left_out(
    monkeypatch: pytest.MonkeyPatch, jobs: int
) -> None:
    at_once, most, drives = 0, 0, dict.fromkeys(WIRES, 0)
    lock = threading.Lock()

    def drive_faults(
        wire: str, faults: list[tuple[Fault, int]], interrupted: threading.Event
    ) -> list[dict[str, Any]]:
        nonlocal at_once, most
        with lock:
            at_once, drives[wire] = at_once + 1, drives[wire] + 1
            most, broken, short = max(most, at_once), drives[wire] % 3 == 0, drives[wire] % 3 == 1
        time.sleep(0.02)
        with lock:
            at_once -= 1
        if broken:
            raise InputError("the drive did not begin")
        return [row(fault.name, wire=wire, number=number) for fault, number in faults[: 1 if short else None]]

    monkeypatch.setattr(bench, "drive_faults", drive_faults)
    rows: list[dict[str, Any]] = []
    bench.drive_all(list(TASKS), jobs, rows.append)
    assert sorted(map(case, map(bench.task_of, rows))) == sorted(map(case, TASKS))
    assert most == jobs


def test_drives_that_never_begin_end_the_benchmark(monkeypatch: pytest.MonkeyPatch) -> None:
    def drive_faults(*_: object) -> list[dict[str, Any]]:
        raise InputError("no bus")

    monkeypatch.setattr(bench, "drive_faults", drive_faults)
    with pytest.raises(InputError, match=r"4 drives in a row gave no episode; the last one: no bus"):
        bench.drive_all(list(TASKS), 2, lambda row: None)


def test_one_wire_that_never_begins_ends_the_benchmark_beside_one_that_does(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    begun = dict.fromkeys(WIRES, 0)

    def drive_faults(wire: str, faults: list[tuple[Fault, int]], _: object) -> list[dict[str, Any]]:
        begun[wire] += 1
        if wire == CAN:
            raise InputError("no bus")
        return [row(fault.name, wire=wire, number=number) for fault, number in faults]

    def in_turns(left: list[Task]) -> list[Task]:
        wire = WIRES[sum(begun.values()) % len(WIRES)]
        return [next(task for task in left if task[0] == wire)]

    monkeypatch.setattr(bench, "drive_faults", drive_faults)
    monkeypatch.setattr(bench, "next_drive", in_turns)
    with pytest.raises(InputError, match=f"{CAN}: {FAILURES} drives in a row gave no episode; .* no bus"):
        bench.drive_all(list(TASKS), 1, lambda row: None)
    assert begun == {SIM: FAILURES, CAN: FAILURES}


def test_the_rows_of_a_drive_are_kept_when_one_that_ended_with_it_fails(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    first, second = TASKS[:2]

    def drive_faults(wire: str, faults: list[tuple[Fault, int]], _: object) -> list[dict[str, Any]]:
        if faults[0] == first[1:]:
            raise ValueError("no room")
        return [row(fault.name, wire=wire, number=number) for fault, number in faults]

    def all_in_order(running: Any, return_when: str) -> Any:
        wait(running)
        return SimpleNamespace(done=list(running))  # the one that fails is the first

    monkeypatch.setattr(bench, "drive_faults", drive_faults)
    monkeypatch.setattr(bench, "next_drive", lambda left: left[:1])
    monkeypatch.setattr(bench, "wait", all_in_order)
    rows: list[dict[str, Any]] = []
    with pytest.raises(ValueError, match="no room"):
        bench.drive_all([first, second], 2, rows.append)
    assert [bench.task_of(kept) for kept in rows] == [second]


def test_counts_grow_evenly() -> None:
    numbers = [number for _, _, number in TASKS]
    assert numbers == sorted(numbers)


def test_the_simulated_car_itself_is_neither_killed_nor_frozen() -> None:
    harmed = {
        fault.process
        for fault in FAULTS.values()
        if SIM in fault.wires and fault.act in (Act.KILL, Act.FREEZE)
    }
    assert "vehicle" not in harmed
    assert FAULTS["kill-vehicle"].wires == (CAN,)


def test_an_unknown_fault_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(InputError, match="no fault 'kill-cw'; did you mean 'kill-cv'"):
        bench_faults(faults=("kill-cw",))


def test_an_unknown_wire_is_refused() -> None:
    with pytest.raises(InputError, match="no wire 'lin'"):
        bench_faults(wires=("lin",))


def test_a_car_that_did_not_brake_is_counted_and_has_no_reaction_time() -> None:
    rows = [row(), row(reaction_ms=150.0), row(reaction_ms=None, braked_ms=None, stood_s=None)]
    figures = table(rows)[SIM]["kill-cv"]
    assert (figures["count"], figures["braked"], figures["stood"]) == (3, 2, 2)
    assert (figures["p50 [ms]"], figures["worst [ms]"]) == (100.0, 150.0)


def test_faults_that_must_not_stop_the_car_stand_apart_from_those_that_must() -> None:
    rows = [row(), row("disk-full", reaction_ms=None, braked_ms=None, stood_s=None, resumed="never stopped")]
    every = table(rows)["all"]
    assert every["sim: have to stop"]["braked"] == 1
    assert every["sim: have to drive on"]["braked"] == 0
    assert every["sim: have to drive on"]["drove on"] == "never stopped 1"


def test_departures_hangs_orphans_and_recordings_are_counted() -> None:
    bad = row(departures=1, hung=True, orphans=["cv", "cnn"], recording="not a recording: no MCAP file")
    figures = table([row(recording="cut short"), bad])[SIM]["kill-cv"]
    assert figures["in lane [%]"] == 50.0
    assert (figures["hung"], figures["orphans"], figures["recordings not readable"]) == (1, 2, 1)


def test_the_table_of_no_episode_is_empty() -> None:
    assert table([])["all"] == {}


@pytest.mark.parametrize("wire", WIRES)
def test_commands_are_reported_where_they_act_on_the_car(wire: str, tmp_path: Any) -> None:
    applied = {
        name: entry["options"]["applied"]
        for name, entry in processes(wire, tmp_path).items()
        if "applied" in entry["options"]
    }
    assert applied == ({"ecu": "ecu"} if wire == CAN else {"vehicle": "limiter"})


@pytest.mark.parametrize("like", ["shuttle", "rc-car"])
def test_what_stops_the_car_has_a_real_time_class_on_a_real_car(
    like: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", ["trepid", "init", str(tmp_path / "car"), "--like", like])
    assert main() == 0
    text = (tmp_path / "car" / "processes.yaml").read_text()
    assert "# a real-time class for what stops the car" in text
    with using_car(tmp_path / "car"):
        specs = load_processes()
    assert priorities({spec.name: spec.options for spec in specs}) == REALTIME
    assert (
        priorities({name: entry["options"] for name, entry in processes(CAN, tmp_path).items()}) == REALTIME
    )
    assert priorities({name: entry["options"] for name, entry in processes(SIM, tmp_path).items()}) == {}


def priorities(options: Mapping[str, Mapping[str, Any]]) -> dict[str, int]:
    """Real-time priority by process."""
    return {name: given["realtime"] for name, given in options.items() if "realtime" in given}
