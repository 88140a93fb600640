"""The silence of processes, without processes."""

from types import SimpleNamespace

from drive.losses import Silence
from trepid.messages import Diagnostic, Health
from trepid.processes.settings import ProcessSpec

LONGEST_S, LONGEST_START_S, TURN_S = 3.0, 20.0, 0.05


class Drive:
    """A launcher that listens every TURN_S, and one process, horn."""

    def __init__(self, *, heartbeat: bool = True) -> None:
        spec = ProcessSpec("horn", "horn", heartbeat=heartbeat)
        self.now_s = 100.0
        self.child = SimpleNamespace(spec=spec, alive=True, started_s=99.0, popen=SimpleNamespace(pid=7))
        self.fleet = SimpleNamespace(children={"horn": self.child})
        self.beats: dict[str, Diagnostic] = {}
        self.paused: set[str] = set()
        self.silence = Silence(
            lambda: self.now_s, self.fleet, longest_s=LONGEST_S, longest_start_s=LONGEST_START_S
        )

    def beat(self) -> None:
        self.beats["horn"] = Diagnostic(
            t_s=self.now_s, process="horn", health=Health.OK, message="", values=()
        )

    def turn(self, after_s: float = TURN_S) -> dict[str, float]:
        """The silent processes at a turn of the launcher that comes ``after_s`` after the last one."""
        self.now_s += after_s
        return dict(self.silence.silent(self.beats, paused=self.paused))

    def listen(self, over_s: float) -> dict[str, float]:
        """Turns over ``over_s``, until a process is silent."""
        for _ in range(round(over_s / TURN_S)):
            if silent := self.turn():
                return silent
        return {}

    def start_again(self) -> None:
        self.child.popen, self.child.started_s = SimpleNamespace(pid=8), self.now_s


def test_a_process_is_silent_after_the_longest_time_without_a_heartbeat() -> None:
    drive = Drive()
    drive.beat()
    assert drive.listen(2.8) == {}
    drive.beat()
    assert drive.listen(2.8) == {}
    assert 3.0 < drive.listen(0.5)["horn"] < 3.2


def test_a_pause_of_the_launcher_is_no_silence_of_a_process() -> None:
    drive = Drive()
    drive.beat()
    assert drive.listen(2.0) == {}
    assert drive.turn(after_s=60.0) == {}  # the heartbeats of the minute are still to be read
    drive.beat()
    assert drive.listen(2.8) == {}


def test_a_process_that_froze_is_silent_also_after_a_pause_of_the_launcher() -> None:
    drive = Drive()
    drive.beat()
    assert drive.listen(2.0) == {}
    assert drive.turn(after_s=60.0) == {}
    assert "horn" in drive.listen(1.2)


def test_a_process_without_heartbeats_is_never_silent() -> None:
    drive = Drive(heartbeat=False)
    drive.beat()  # of its start
    assert drive.listen(30.0) == {}


def test_a_process_that_was_started_again_has_the_time_of_a_start_for_its_first_heartbeat() -> None:
    drive = Drive()
    drive.beat()
    assert drive.listen(1.0) == {}
    drive.start_again()
    assert drive.listen(19.8) == {}
    assert "horn" in drive.listen(0.5)


def test_a_late_heartbeat_of_the_process_before_is_none_of_the_present_one() -> None:
    drive = Drive()
    drive.turn()
    drive.beat()
    drive.turn()
    drive.start_again()
    assert drive.listen(19.8) == {}


def test_a_process_that_a_scenario_pauses_is_not_silent_and_begins_anew_when_it_goes_on() -> None:
    drive = Drive()
    drive.beat()
    drive.paused = {"horn"}
    assert drive.listen(30.0) == {}
    drive.paused = set()
    assert drive.listen(2.8) == {}
    assert "horn" in drive.listen(0.5)


def test_an_ended_process_is_not_silent() -> None:
    drive = Drive()
    drive.beat()
    drive.child.alive = False
    assert drive.listen(30.0) == {}
