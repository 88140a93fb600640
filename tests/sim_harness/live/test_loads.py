"""The load of processes over a drive."""

import pytest

from sim_harness.live.loads import Loads
from trepid.messages import Diagnostic, Health
from trepid.processes.process import READY


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
