"""A wall clock that is set during a drive changes no time, age or order; only names and dates read it."""

import re
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

import trepid.clock
from trepid.clock import UNSTAMPED, epoch_clock, epoch_offset_ns, nanoseconds, stamp_of, stamper
from trepid.config import ROOT

DRIVEN = ("trepid", "perception", "supervisor", "controller", "vehicle", "drive", "cockpit")
WALL = re.compile(r"\btime\.(?:time|time_ns|localtime|gmtime|ctime)\(|\bdatetime\.(?:now|utcnow|today)\(")
NAMES_AND_DATES = {
    "trepid/clock.py",  # the offset, once a drive
    "drive/launcher.py",  # the name of the last minutes
    "trepid/recording/cli.py",  # of a kept recording
    "cockpit/page/server.py",  # of a kept recording
    "cockpit/car/machine.py",  # the check of the clock itself
    "vehicle/certificates.py",  # dates of keys
}


class Wall:
    """A machine whose wall clock is set, while its monotonic clock goes on."""

    def __init__(self) -> None:
        self.monotonic, self.wall = 5_000_000_000, 1_800_000_000_000_000_000
        self.time = SimpleNamespace(monotonic_ns=lambda: self.monotonic, time_ns=lambda: self.wall)

    def pass_time(self, waited_ns: int, *, set_by_ns: int) -> None:
        self.monotonic += waited_ns
        self.wall += waited_ns + set_by_ns


STEPS = st.lists(
    st.tuples(st.integers(1_000, 10**9), st.integers(-(10**14), 10**14)), min_size=1, max_size=20
)


@given(steps=STEPS)
def test_times_ages_and_the_order_of_messages_outlive_every_step_of_the_wall_clock(steps):
    machine = Wall()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(trepid.clock, "time", machine.time)
        offset_ns = epoch_offset_ns()
        launcher, restarted = epoch_clock(offset_ns), epoch_clock(offset_ns)
        began_s, began_ns = launcher(), machine.wall
        publish, newest, waited_ns = stamper(launcher), UNSTAMPED, 0
        assert nanoseconds(began_s) == pytest.approx(began_ns, abs=300)
        for pause_ns, set_by_ns in steps:
            machine.pass_time(pause_ns, set_by_ns=set_by_ns)
            waited_ns += pause_ns
            stamp = stamp_of(publish())
            assert not stamp.repeats(newest, now_s=restarted()) and not stamp.steps_back(newest)
            assert restarted() - began_s == pytest.approx(waited_ns * 1e-9, abs=1e-6)
            assert restarted() - stamp.published_s == pytest.approx(0.0, abs=1e-6)
            newest = stamp


def test_what_runs_during_a_drive_reads_the_wall_clock_for_names_and_dates_only():
    reading = {
        str(path.relative_to(ROOT))
        for package in DRIVEN
        for path in (ROOT / package).rglob("*.py")
        if WALL.search(path.read_text(encoding="utf-8"))
    }
    assert reading == NAMES_AND_DATES
