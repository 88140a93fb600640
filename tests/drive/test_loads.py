"""The load of processes over a drive."""

import time
from types import SimpleNamespace

import pytest

from drive.log import DriveLog, Loads, number
from drive.overview import Overview
from trepid.bus import free_endpoint, open_bus
from trepid.messages import Diagnostic, Health
from trepid.processes.process import READY
from trepid.processes.register import WAITS
from trepid.processes.settings import ProcessSpec
from trepid.topics import DIAGNOSTICS


def beat(t_s: float, cpu_percent: float, message: str = "", rate_hz: float = 2.0) -> Diagnostic:
    values = (("rate_hz", str(rate_hz)), ("cpu_percent", str(cpu_percent)))
    return Diagnostic(t_s=t_s, process="page", health=Health.OK, message=message, values=values)


def test_each_heartbeat_counts_by_the_time_since_the_one_before():
    loads = Loads()
    for one in (beat(1.0, 90.0, READY), beat(1.01, 100.0), beat(2.01, 1.0), beat(4.01, 4.0, rate_hz=5.0)):
        loads.add(one)
    assert loads.of("page") == {
        "cpu_percent": pytest.approx((0.01 * 100 + 1.0 * 1 + 2.0 * 4) / 3.01, abs=0.05),
        "rate_hz": pytest.approx((1.01 * 2 + 2.0 * 5) / 3.01, abs=0.05),
    }


def test_the_time_before_a_process_reports_its_start_does_not_count():
    loads = Loads()
    for one in (beat(0.0, 50.0), beat(1.0, 1.0), beat(9.0, 80.0, READY), beat(10.0, 3.0)):
        loads.add(one)
    assert loads.of("page")["cpu_percent"] == 2.0


def test_without_an_interval_the_load_is_unknown():
    loads = Loads()
    loads.add(beat(1.0, 10.0))
    assert loads.of("page") == loads.of("cv") == {"rate_hz": None, "cpu_percent": None}


@pytest.mark.parametrize("text", ["n/a", "", "nan", "inf", "-", "1e999", "4,0"])
def test_a_value_that_is_no_finite_number_is_absent(text):
    assert number((("rate_hz", text),), "rate_hz") is None


def test_the_load_counts_only_the_heartbeats_that_give_it():
    loads = Loads()
    loads.add(beat(1.0, 10.0))
    for t_s, values in (
        (2.0, (("rate_hz", "4"),)),
        (3.0, (("temperature", "40"),)),
        (4.0, (("rate_hz", "n/a"),)),
    ):
        loads.add(Diagnostic(t_s=t_s, process="page", health=Health.OK, message="", values=values))
    loads.add(beat(5.0, 30.0, rate_hz=6.0))
    assert loads.of("page") == {"rate_hz": 5.0, "cpu_percent": 30.0}


def test_the_launcher_goes_on_after_a_heartbeat_without_the_usual_values():
    values = (("rate_hz", "n/a"), ("malformed a", "?"), ("malformed b", "2"), ("temperature", "40"))
    child = SimpleNamespace(
        spec=ProcessSpec("horn", "horn"), popen=SimpleNamespace(pid=7), alive=True, restarts=0
    )
    with open_bus("car", time.monotonic, listen=free_endpoint()) as bus:
        log = DriveLog(bus, time.monotonic, ())
        overview = Overview(bus, log, SimpleNamespace(children={"horn": child}))
        send = bus.publisher(DIAGNOSTICS)
        for process in ("horn", "horn", "foreign", "foreign"):
            send(Diagnostic(t_s=1.0, process=process, health=Health.OK, message="fine", values=values))
        log.receive(timeout_s=0.0)
        overview.publish(Health.OK, "driving")
    assert log.malformed_count("horn") == 2
    assert log.loads.of("horn") == {"rate_hz": None, "cpu_percent": None}


def test_the_report_of_the_launcher_says_what_the_drive_waits_for_until_it_begins():
    sent: list[Diagnostic] = []
    log = SimpleNamespace(now_s=time.monotonic, diagnostics={}, waiting="")
    overview = Overview(SimpleNamespace(publisher=lambda _: sent.append), log, SimpleNamespace(children={}))
    for log.waiting in ("waiting for cnn", ""):
        overview.publish(Health.OK, log.waiting)
    assert [dict(report.values).get(WAITS) for report in sent] == ["waiting for cnn", None]
