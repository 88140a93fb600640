"""The last minutes of a drive are bounded on disk, readable after a crash, and kept as one recording."""

import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from trepid.config import InputError
from trepid.messages import Stop, VehicleState
from trepid.recording import keeper
from trepid.recording.keeper import EMERGENCY, INTERVENTION, Events
from trepid.recording.reader import read_recording
from trepid.recording.ring import Ring, RingSettings, kept, newest, prune, ring_settings, secured
from trepid.topics import DECISION, VEHICLE_STATE
from trepid.wire import to_cdr

STATE = VehicleState(
    t_s=100.0, speed_mps=3.0, road_wheel_angle_rad=None, yaw_rate_radps=0.1, driver_override=False
)


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path


def ring_of(seconds: int, *, max_mb: float = 1.0) -> Ring:
    """A ring with ten states a second in parts of 2 s, not closed."""
    waiting: list[Any] = []
    tap: Any = SimpleNamespace(drain=lambda: [waiting.pop(0) for _ in list(waiting)])
    settings = RingSettings(max_mb=max_mb, part_s=2.0, after_s=1.0, max_kept_mb=1.0)
    ring = Ring(tap, settings, {"fear.yaml": b"rules"}, {"what": "test"}, now_s=100.0)
    for number in range(10 * seconds):
        t_s = 100.0 + number / 10
        waiting.append((VEHICLE_STATE.key, to_cdr(replace(STATE, t_s=t_s)), t_s))
        ring.write()
    return ring


def test_the_parts_of_a_drive_become_one_recording(tmp_path: Path) -> None:
    ring = ring_of(9)
    ring.began_ns(101_000_000_000)
    ring.close()
    assert newest() == ring.folder
    kept(secured(ring.folder), tmp_path / "kept.mcap")
    read = read_recording(tmp_path / "kept.mcap", VEHICLE_STATE.key)
    assert [round(state.t_s, 1) for _, state in read.of(VEHICLE_STATE)] == [100 + n / 10 for n in range(90)]
    assert (read.files, read.began_s, read.complete) == ({"fear.yaml": b"rules"}, 101.0, True)


def test_a_ring_that_was_killed_is_kept_up_to_its_last_second(tmp_path: Path) -> None:
    ring = ring_of(9)
    kept(secured(ring.folder), tmp_path / "kept.mcap")
    assert read_recording(tmp_path / "kept.mcap", VEHICLE_STATE.key).last_s > 107.5


def test_the_oldest_parts_are_deleted_beyond_the_size_and_secured_ones_stay(tmp_path: Path) -> None:
    ring = ring_of(9)
    ring.close()
    parts = sorted(ring.folder.glob("*.mcap"))
    for age, part in enumerate(reversed(parts)):
        os.utime(part, (1000 - age, 1000 - age))
    safe = secured(ring.folder)
    prune(ring.folder.parent, sum(part.stat().st_size for part in parts[-2:]), own=ring.folder)
    assert sorted(ring.folder.glob("*.mcap")) == parts[-2:]
    assert len(list(safe.glob("*.mcap"))) == len(parts)


def test_nothing_kept_is_overwritten_and_no_ring_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no drive to keep"):
        newest()
    ring = ring_of(3)
    (tmp_path / "there.mcap").write_text("precious")
    with pytest.raises(InputError, match="exists already and is kept"):
        kept(secured(ring.folder), tmp_path / "there.mcap")
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
    keeping = keeper.Keeper(drive, settings, {}, {})
    keeping.turn()
    drive.stop = Stop.EMERGENCY
    keeping.turn()
    drive.clock_s += before_end_s
    keeping.turn()
    keeping.close()
    assert [name.endswith("emergency-stop") for name in kept_as] == [True] * count


def test_the_shipped_ring_is_bounded() -> None:
    assert 0 < ring_settings().max_mb < 1000
