"""The last minutes of a drive are bounded on disk, readable after a crash, and kept as one recording."""

import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from disk_rig import files_limited_to

from trepid.cli import main
from trepid.config import InputError
from trepid.messages import Diagnostic, Health, Stop, VehicleState
from trepid.processes.drive_settings import RingSettings
from trepid.processes.register import Running, folder, ticks
from trepid.recording import keeper
from trepid.recording.keeper import EMERGENCY, INTERVENTION, Events
from trepid.recording.notes import RULES, RULES_FROM_S
from trepid.recording.reader import read_recording
from trepid.recording.ring import Ring, keep_parts, newest, prune, ring_of, ring_settings, secure_parts
from trepid.topics import DECISION, DIAGNOSTICS, VEHICLE_STATE
from trepid.wire import to_cdr

STATE = VehicleState(
    t_s=100.0, speed_mps=3.0, road_wheel_angle_rad=None, yaw_rate_radps=0.1, driver_override=False
)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


def write_ring(
    seconds: int, *, name: str = "a drive", max_mb: float = 1.0, beats: Mapping[int, bytes] | None = None
) -> Ring:
    """A ring with ten states a second in parts of 2 s, not closed; ``beats``: heartbeats by number of a state."""
    waiting: list[Any] = []
    tap: Any = SimpleNamespace(drain=lambda: [waiting.pop(0) for _ in list(waiting)])
    settings = RingSettings(max_mb=max_mb, part_s=2.0, after_s=1.0, max_kept_mb=1.0)
    ring = Ring(tap, name, settings, {"fear.yaml": b"rules"}, {"what": "test"})
    for number in range(10 * seconds):
        t_s = 100.0 + number / 10
        waiting.append((VEHICLE_STATE.key, to_cdr(replace(STATE, t_s=t_s)), t_s))
        waiting += [(DIAGNOSTICS.key, beats[number], t_s)] if beats and number in beats else []
        ring.write()
    return ring


def test_the_parts_of_a_drive_become_one_recording(tmp_path: Path) -> None:
    ring = write_ring(9)
    ring.began_ns(101_000_000_000)
    ring.close()
    assert newest() == ring.folder
    keep_parts(secure_parts(ring.folder), tmp_path / "kept.mcap")
    read = read_recording(tmp_path / "kept.mcap", VEHICLE_STATE.key)
    assert [round(state.t_s, 1) for _, state in read.of(VEHICLE_STATE)] == [100 + n / 10 for n in range(90)]
    assert (read.files, read.began_s, read.complete) == ({"fear.yaml": b"rules"}, 101.0, True)


def test_a_ring_that_was_killed_is_kept_up_to_its_last_second(tmp_path: Path) -> None:
    ring = write_ring(9)
    keep_parts(secure_parts(ring.folder), tmp_path / "kept.mcap")
    assert read_recording(tmp_path / "kept.mcap", VEHICLE_STATE.key).last_s > 107.5


def test_a_recorder_that_is_started_again_goes_on_in_the_ring_of_its_drive(tmp_path: Path) -> None:
    first = write_ring(3)
    again = write_ring(3)
    again.close()
    assert again.folder == first.folder
    assert [part.stem for part in sorted(again.folder.glob("*.mcap"))] == [
        "000001",
        "000002",
        "000003",
        "000004",
    ]
    keep_parts(secure_parts(again.folder), tmp_path / "kept.mcap")
    assert len(read_recording(tmp_path / "kept.mcap", VEHICLE_STATE.key).of(VEHICLE_STATE)) == 60


def changed_rules(text: str) -> bytes:
    """The heartbeat of a supervisor that has adopted the rules ``text``."""
    values = ((RULES_FROM_S, "103.0"), (RULES, text))
    return to_cdr(Diagnostic(t_s=103.0, process="supervisor", health=Health.OK, message="", values=values))


@pytest.mark.parametrize(
    ("deleted", "rules"), [(0, b"rules"), (1, b"rules"), (2, b"changed"), (3, b"changed"), (4, b"again")]
)
def test_what_is_kept_begins_with_the_rules_of_its_oldest_part(
    tmp_path: Path, deleted: int, rules: bytes
) -> None:
    """They changed in the parts 2 and 4."""
    malformed = changed_rules("malformed")[:-12]
    ring = write_ring(9, beats={30: changed_rules("changed"), 70: changed_rules("again"), 72: malformed})
    ring.close()
    for part in sorted(ring.folder.glob("*.mcap"))[:deleted]:
        part.unlink()
    keep_parts(secure_parts(ring.folder), tmp_path / "kept.mcap")
    assert read_recording(tmp_path / "kept.mcap").files == {"fear.yaml": rules}


@pytest.fixture
def drives(home: Path, own_register: Path) -> Callable[..., None]:
    """A function that makes drives run, each with an endpoint and the name of its ring."""

    def run(**rings: str | None) -> None:
        for endpoint, ring in rings.items():
            drive = Running(
                pid=os.getpid(),
                started_ticks=ticks(os.getpid()) or 0,
                vehicle_name="car",
                endpoint=endpoint,
                clock_offset_ns=0,
                car=None,
                what=f"scenario {endpoint}",
                ring=ring,
            )
            (folder() / f"{endpoint}.json").write_text(drive.model_dump_json())

    return run


def test_the_ring_of_the_running_drive_is_kept_and_not_the_newest_of_the_machine(
    drives: Callable[..., None],
) -> None:
    mine, newer = write_ring(3, name="mine"), write_ring(3, name="newer")
    for age_s, ring in ((100.0, mine), (0.0, newer)):
        for part in ring.folder.glob("*.mcap"):
            os.utime(part, (1000.0 - age_s, 1000.0 - age_s))
    assert ring_of() == newer.folder, "no drive runs: that of the last one"
    drives(one="mine", replay=None)
    assert ring_of() == mine.folder


def test_of_two_running_drives_the_endpoint_decides_and_without_it_both_are_named_in_one_line(
    drives: Callable[..., None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    rings = [write_ring(3, name=name) for name in ("first", "second")]
    drives(one="first", two="second")
    assert [ring_of("one"), ring_of("two")] == [ring.folder for ring in rings]
    monkeypatch.setattr(sys, "argv", ["trepid", "record", "keep"])
    assert main() == 2
    out, err = capsys.readouterr()
    assert (out, err.count("\n")) == ("", 1)
    assert all(word in err for word in ("--endpoint one (scenario one", "--endpoint two (scenario two"))
    monkeypatch.setattr(sys, "argv", ["trepid", "record", "keep", "--endpoint", "three"])
    assert main() == 2


def test_a_running_drive_without_a_ring_is_refused_although_an_older_one_left_its_ring(
    drives: Callable[..., None],
) -> None:
    write_ring(3)
    drives(one=None)
    with pytest.raises(InputError, match=r"scenario one .* writes no last minutes"):
        ring_of()


def test_the_oldest_parts_are_deleted_beyond_the_size_and_secured_ones_stay(tmp_path: Path) -> None:
    ring = write_ring(9)
    ring.close()
    parts = sorted(ring.folder.glob("*.mcap"))
    for age, part in enumerate(reversed(parts)):
        os.utime(part, (1000 - age, 1000 - age))
    safe = secure_parts(ring.folder)
    prune(ring.folder.parent, sum(part.stat().st_size for part in parts[-2:]), own=ring.folder)
    assert sorted(ring.folder.glob("*.mcap")) == parts[-2:]
    assert len(list(safe.glob("*.mcap"))) == len(parts)


@pytest.mark.parametrize("back_to", [0, 5])
def test_a_wall_clock_set_back_in_a_drive_costs_neither_its_newest_parts_nor_those_of_another_that_runs(
    drives: Callable[..., None], back_to: int
) -> None:
    """The parts from ``back_to`` on were written by a clock an hour behind, and behind that of an ended drive."""
    ended, mine, beside = (write_ring(9, name=name) for name in ("ended", "mine", "beside"))
    for ring in (ended, mine, beside):
        ring.close()
    of = {ring.folder: sorted(ring.folder.glob("*.mcap")) for ring in (ended, mine, beside)}
    for ring in (ended, mine, beside):
        for place, part in enumerate(of[ring.folder]):
            at_s = 10_000 + place - (3600 if ring is not ended and place >= back_to else 0)
            os.utime(part, (at_s, at_s))
    drives(one="beside")
    left = [*of[mine.folder][-2:], *of[beside.folder][-2:]]
    prune(mine.folder.parent, sum(part.stat().st_size for part in left), own=mine.folder)
    assert sorted(mine.folder.parent.glob("*/*.mcap")) == sorted(left)


def test_another_drive_that_deletes_the_empty_folder_of_a_drive_does_not_end_its_ring() -> None:
    message = (VEHICLE_STATE.key, to_cdr(STATE), STATE.t_s)
    tap: Any = SimpleNamespace(drain=lambda: [message])
    settings = RingSettings(max_mb=1.0, part_s=2.0, after_s=1.0, max_kept_mb=1.0)
    ring = Ring(tap, "a drive", settings, {}, {})
    write_ring(3, name="another drive").close()
    assert not ring.folder.exists()
    ring.write()
    ring.close()
    assert [part.name for part in ring.folder.iterdir()] == ["000001.mcap"]


@pytest.mark.parametrize("size", [0, 3000])
def test_a_disk_that_refuses_a_kept_recording_keeps_no_part_of_it(
    size: int,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    own_register: Path,
) -> None:
    write_ring(9).close()
    out = home / "mine.mcap"
    monkeypatch.setattr(sys, "argv", ["trepid", "record", "keep", "--out", str(out)])
    with files_limited_to(size):
        assert main() == 2
    assert "mine.mcap: cannot be written: File too large" in capsys.readouterr().err
    assert (list((home / "trepid" / "kept").iterdir()), out.exists()) == ([], False)
    assert main() == 0
    assert out.stat().st_size > 3000


def test_a_process_that_joins_parts_deletes_them_also_where_it_fails(home: Path) -> None:
    safe, out = secure_parts(write_ring(3).folder), home / "mine.mcap"
    out.touch()
    joining = [sys.executable, "-m", "trepid.recording.ring", str(safe), str(out)]
    assert subprocess.run(joining, check=False, capture_output=True).returncode == 2
    assert (safe.exists(), out.exists()) == (False, True)


def test_nothing_kept_is_overwritten_and_no_ring_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no drive to keep"):
        newest()
    ring = write_ring(3)
    (tmp_path / "there.mcap").write_text("precious")
    with pytest.raises(InputError, match="exists already and is kept"):
        keep_parts(secure_parts(ring.folder), tmp_path / "there.mcap")
    assert (tmp_path / "there.mcap").read_text() == "precious"


def test_an_event_is_the_beginning_of_a_stop_or_intervention() -> None:
    events = Events()
    stop: Any = SimpleNamespace(stop="emergency")
    calm: Any = SimpleNamespace(stop="none")
    assert events.step(stop, None, None) is None, "what is so at the beginning is no event"
    assert events.step(calm, None, None) is None
    stop.stop = Stop.EMERGENCY
    assert [events.step(stop, None, None), events.step(stop, None, None)] == [EMERGENCY, None]
    assert events.step(None, STATE, None) is None
    assert events.step(None, replace(STATE, driver_override=True), None) == INTERVENTION


class Drive:
    """The process and bus of a keeper: its clock, and a decision that stops the car or not."""

    def __init__(self) -> None:
        self.clock_s, self.stop, self.bus = 100.0, Stop.NONE, self

    def now_s(self) -> float:
        return self.clock_s

    def tap(self, *_: str) -> Any:
        return SimpleNamespace(drain=lambda: [])

    def latest(self, topic: Any, *, wakes: bool) -> Any:
        decides = topic is DECISION
        return SimpleNamespace(refresh=lambda: SimpleNamespace(stop=self.stop) if decides else None)


@pytest.mark.parametrize(("before_end_s", "count"), [(0.5, 0), (3.0, 1)])
def test_an_emergency_stop_is_kept_unless_it_is_that_of_the_end_of_the_drive(
    monkeypatch: pytest.MonkeyPatch, before_end_s: float, count: int
) -> None:
    kept_as: list[str] = []
    monkeypatch.setattr(keeper, "keep_apart", lambda folder, out: kept_as.append(out.stem))
    drive: Any = Drive()
    settings = RingSettings(max_mb=1.0, part_s=2.0, after_s=5.0, max_kept_mb=1.0)
    keeping = keeper.Keeper(drive, "a drive", settings, {}, {})
    keeping.turn()
    drive.stop = Stop.EMERGENCY
    keeping.turn()
    drive.clock_s += before_end_s
    keeping.turn()
    keeping.close()
    assert [name.endswith("emergency-stop") for name in kept_as] == [True] * count


def test_the_shipped_ring_is_bounded() -> None:
    assert 0 < ring_settings().max_mb < 1000
