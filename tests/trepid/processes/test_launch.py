"""Start, loss and stop of real processes; no process is left after a drive."""

import os
import signal
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from process_rig import alive, ends_with_its_launcher, until

from trepid.bus import Bus, free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CAR
from trepid.messages import Diagnostic, Health
from trepid.processes.launch import Fleet, ProcessSpec
from trepid.topics import DECISION, DIAGNOSTICS, Topic

CONTROLLER = ProcessSpec("controller", "controller.node")  # the process with the shortest start


@pytest.fixture
def drive() -> Iterator[tuple[Bus, Callable[..., Fleet]]]:
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()

    def fleet(*specs: ProcessSpec) -> Fleet:
        return Fleet(specs, vehicle_name="car", endpoint=endpoint, clock_offset_ns=offset_ns)

    with open_bus("car", epoch_clock(offset_ns), listen=endpoint) as bus:
        yield bus, fleet


def beats_of(bus: Bus, *, patience_s: float = 20) -> Callable[[], bool]:
    diagnostics = bus.latest(DIAGNOSTICS)
    return lambda: until(lambda: diagnostics.take() is not None, patience_s=patience_s)


def test_a_process_reports_and_is_gone_after_the_drive(drive: tuple[Bus, Callable[..., Fleet]]) -> None:
    bus, fleet = drive
    beats = beats_of(bus)
    with fleet(CONTROLLER) as running:
        assert beats()
        pid = running.children["controller"].popen.pid
        assert running.collect_exits() == []
    assert not alive(pid)


def test_a_killed_process_is_reported_and_started_again_until_its_restarts_are_used_up(
    drive: tuple[Bus, Callable[..., Fleet]],
) -> None:
    bus, fleet = drive
    beats = beats_of(bus)
    with fleet(replace(CONTROLLER, max_restarts=1)) as running:
        assert beats()
        first = running.children["controller"].popen
        os.kill(first.pid, signal.SIGKILL)
        first.wait(5)
        (ended,) = running.collect_exits()
        assert str(ended).startswith(f"process controller (pid {first.pid}) was killed by SIGKILL")
        assert running.children["controller"].restarts == 0  # its end can be reported before it starts again
        assert running.collect_exits() == []
        assert running.children["controller"].restarts == 1
        assert beats()
        running.kill("controller")
        assert len(running.collect_exits()) == 1
        assert running.collect_exits() == []
        assert running.children["controller"].popen.poll() is not None


def test_a_module_that_fails_is_reported_with_the_end_of_its_stderr(
    drive: tuple[Bus, Callable[..., Fleet]],
) -> None:
    _, fleet = drive
    with fleet(ProcessSpec("ghost", "controller.no_such_module", max_restarts=0)) as running:
        assert until(lambda: running.children["ghost"].popen.poll() is not None, patience_s=20)
        (ended,) = running.collect_exits()
    assert "exited with code 1" in str(ended)
    assert "No module named controller.no_such_module" in str(ended)


def test_a_process_with_bad_input_ends_with_one_line_and_is_not_started_again(
    drive: tuple[Bus, Callable[..., Fleet]],
) -> None:
    _, fleet = drive
    options = {"rules": "no.yaml", "estimators": [], "cruise_speed_mps": None}
    with fleet(ProcessSpec("supervisor", "supervisor.node", options)) as running:
        assert until(lambda: running.children["supervisor"].popen.poll() is not None, patience_s=20)
        (ended,) = running.collect_exits()
        assert running.collect_exits() == []
        assert running.children["supervisor"].restarts == 0
    assert ended.returncode == 2
    assert str(ended) == "process supervisor: no.yaml: cannot be read: No such file or directory"


def test_the_group_of_a_command_is_ended_once(
    drive: tuple[Bus, Callable[..., Fleet]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At the end of the drive its number may be that of another program."""
    _, fleet = drive
    killed: list[int] = []
    with fleet(ProcessSpec("horn", command=("true",), max_restarts=0)) as running:
        assert until(lambda: running.collect_exits() != [], patience_s=20)
        monkeypatch.setattr(os, "killpg", lambda group, _: killed.append(group))
    assert killed == []


def test_even_a_frozen_process_is_stopped(drive: tuple[Bus, Callable[..., Fleet]]) -> None:
    bus, fleet = drive
    beats = beats_of(bus)
    with fleet(CONTROLLER) as running:
        assert beats()
        pid = running.children["controller"].popen.pid
        os.kill(pid, signal.SIGSTOP)
    assert not alive(pid)


def test_a_paused_process_sends_no_heartbeat_until_it_is_resumed(
    drive: tuple[Bus, Callable[..., Fleet]],
) -> None:
    bus, fleet = drive
    beats, soon = beats_of(bus), beats_of(bus, patience_s=1.5)
    with fleet(CONTROLLER) as running:
        assert beats()
        running.pause("controller")
        assert until(
            lambda: not soon(), patience_s=20
        )  # messages in transit may still arrive, late on a busy machine
        running.resume("controller")
        assert beats()
        assert running.collect_exits() == []


def test_a_process_that_reads_malformed_messages_reports_them_as_a_warning(
    drive: tuple[Bus, Callable[..., Fleet]],
) -> None:
    bus, fleet = drive
    diagnostics = bus.latest(DIAGNOSTICS)
    send_malformed = bus.publisher(Topic(DECISION.key, Diagnostic, 1))
    with fleet(CONTROLLER):
        assert until(lambda: diagnostics.take() is not None, patience_s=20)

        def has_warned() -> bool:
            send_malformed(Diagnostic(t_s=0.0, process="x", health=Health.OK, message="", values=()))
            beat = diagnostics.take()
            return beat is not None and beat.health is Health.WARN

        assert until(has_warned, patience_s=10)
    assert diagnostics.message is not None
    assert diagnostics.message.message == f"malformed messages on {DECISION.key}"
    assert int(dict(diagnostics.message.values)[f"malformed {DECISION.key}"]) > 0


@pytest.mark.parametrize("paused", [False, True])
def test_processes_end_themselves_when_their_launcher_is_killed(paused: bool) -> None:
    program = (
        "import time\n"
        "from trepid.bus import free_endpoint, open_bus\n"
        "from trepid.processes.launch import Fleet, ProcessSpec\n"
        "from trepid.topics import DIAGNOSTICS\n"
        "endpoint = free_endpoint()\n"
        "with open_bus('car', time.monotonic, listen=endpoint) as bus:\n"
        "    diagnostics = bus.latest(DIAGNOSTICS)\n"
        "    fleet = Fleet((ProcessSpec('controller', 'controller.node'),), vehicle_name='car',\n"
        "                  endpoint=endpoint, clock_offset_ns=0)\n"
        "    with fleet:\n"
        "        while diagnostics.take() is None:\n"
        "            time.sleep(0.02)\n"
        f"        {'fleet.pause(*fleet.children)' if paused else 'pass'}\n"
        "        print(fleet.children['controller'].popen.pid, flush=True)\n"
        "        time.sleep(60)\n"
    )
    assert ends_with_its_launcher(program, patience_s=5)


def test_the_error_of_a_process_is_reported_with_its_place_and_without_its_traceback(
    drive: tuple[Bus, Callable[..., Fleet]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(CAR, str(tmp_path))
    (tmp_path / "horn.py").write_text("print('before')\nraise ValueError('loud')\n")
    _, fleet = drive
    with fleet(ProcessSpec("horn", "horn", max_restarts=0)) as running:
        assert until(lambda: running.children["horn"].popen.poll() is not None, patience_s=20)
        (ended,) = running.collect_exits()
    assert ended.stderr_tail == f"before | ValueError: loud ({tmp_path / 'horn.py'}:2)"
