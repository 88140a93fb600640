"""Modules of a car, commands and cores: started as the entry says, and gone with the launcher."""

import os
from dataclasses import replace
from pathlib import Path

import pytest
from process_rig import alive, ends_with_its_launcher, until

from trepid.config import CAR
from trepid.processes.launch import Fleet
from trepid.processes.settings import ProcessSpec

SLEEP = ProcessSpec("horn", command=("sleep", "1000"), nice=7)


def fleet(*specs: ProcessSpec) -> Fleet:
    return Fleet(specs, vehicle_name="car", endpoint="tcp/127.0.0.1:1", clock_offset_ns=0)


def test_a_command_ends_with_the_drive_and_all_that_it_has_started(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    command = ("sh", "-c", f"sleep 1000 & echo $! > {inner}; wait")
    with fleet(ProcessSpec("horn", command=command, heartbeat=False)) as running:
        outer = running.children["horn"].popen.pid
        assert until(lambda: inner.exists() and inner.read_text().strip(), patience_s=20)
    assert until(lambda: not alive(outer) and not alive(int(inner.read_text())), patience_s=5)


def test_a_command_ends_when_its_launcher_is_killed() -> None:
    program = (
        "import time\n"
        "from trepid.processes.launch import Fleet\n"
        "from trepid.processes.settings import ProcessSpec\n"
        "spec = ProcessSpec('horn', command=('sleep', '1000'))\n"
        "with Fleet((spec,), vehicle_name='car', endpoint='', clock_offset_ns=0) as fleet:\n"
        "    pid = fleet.children['horn'].popen.pid\n"
        "    while b'sleep' not in open(f'/proc/{pid}/cmdline', 'rb').read().split(b'\\0')[0]:\n"
        "        time.sleep(0.01)\n"
        "    print(pid, flush=True)\n"
        "    time.sleep(60)\n"
    )
    assert ends_with_its_launcher(program, patience_s=5)


def test_a_module_in_the_folder_of_the_car_runs_on_its_cores_with_its_niceness(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    said = tmp_path / "said"
    (tmp_path / "horn.py").write_text(
        "import os, time\n"
        "time.sleep(0.3)\n"
        f"open({str(said)!r}, 'w').write(f'{{os.sched_getaffinity(0)}} {{os.nice(0)}}.')\n"
    )
    monkeypatch.setenv(CAR, str(tmp_path))
    core = min(os.sched_getaffinity(0))
    with fleet(ProcessSpec("horn", "horn", cores=(core,), nice=7)):
        assert until(lambda: said.exists() and said.read_text().endswith("."), patience_s=20)
    assert said.read_text() == f"{{{core}}} 7."


def test_a_session_whose_niceness_linux_refuses_for_now_gets_it_later(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without CAP_SYS_ADMIN Linux accepts one change in 0.1 s."""
    refusals: list[OSError] = [BlockingIOError(), BlockingIOError()]
    written: list[tuple[str, str]] = []

    def write(path: Path, text: str) -> None:
        if refusals:
            raise refusals.pop()
        written.append((str(path), text))

    monkeypatch.setattr(Path, "write_text", write)
    with fleet(SLEEP) as running:
        pid = running.children["horn"].popen.pid
        assert os.getpriority(os.PRIO_PROCESS, pid) == 7
        for _ in range(4):
            running.weigh(())
        assert written == [], "until it has begun, it starts as fast as the others"
        for _ in range(4):
            running.weigh({"horn"})
        assert written == [(f"/proc/{pid}/autogroup", "7")]
    assert written[1:] == [(f"/proc/{pid}/autogroup", "0")], "it ends as fast as the others"


@pytest.mark.parametrize("refusal", [FileNotFoundError, PermissionError, ProcessLookupError])
def test_a_process_runs_where_linux_does_not_weigh_its_session(
    monkeypatch: pytest.MonkeyPatch, refusal: type[OSError]
) -> None:
    def refuse(path: Path, text: str) -> None:
        raise refusal

    monkeypatch.setattr(Path, "write_text", refuse)
    with fleet(SLEEP) as running:
        assert running.children["horn"].alive


def test_a_process_whose_start_fails_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[int] = []

    def refuse(pid: int, cores: object) -> None:
        started.append(pid)
        raise OSError("no such core")

    monkeypatch.setattr(os, "sched_setaffinity", refuse)
    with pytest.raises(OSError, match="no such core"), fleet(replace(SLEEP, cores=(0,))):
        pass
    assert not alive(started[0])
