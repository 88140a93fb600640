"""What a long drive uses, and the messages that its recording lacks."""

import os
from pathlib import Path

import pytest

from lab.bench.live.soak import Usage, count_recorded, sample_usage, usage
from trepid.clock import Stamp
from trepid.messages import VehicleState
from trepid.recording.writer import Recording
from trepid.topics import VEHICLE_STATE
from trepid.wire import to_cdr


def stamp(number: int) -> Stamp:
    return Stamp(number, 100.0 + 0.01 * number, b"vehicle")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Messages 1 to 50 of one topic without 20 and 21, and two of another."""
    path = tmp_path / "drive.mcap"
    with Recording(path) as file:
        for number in range(1, 51):
            state = VehicleState(
                t_s=float(number),
                speed_mps=1.0,
                road_wheel_angle_rad=0.0,
                yaw_rate_radps=0.0,
                driver_override=False,
            )
            if number not in (20, 21):
                file.add(VEHICLE_STATE.key, to_cdr(state), at_s=stamp(number).published_s)
            if number in (10, 20):
                file.add("supervisor/decision", b"", at_s=stamp(number).published_s)
    return path


def test_a_message_that_the_recording_lacks_is_lost(recording: Path) -> None:
    key = VEHICLE_STATE.key
    found = count_recorded(recording, {key: stamp(5)}, {key: stamp(45)})
    assert found == {key: {"messages": 41, "lost": 2}}


def test_messages_outside_the_window_do_not_count(recording: Path) -> None:
    key = VEHICLE_STATE.key
    found = count_recorded(recording, {key: stamp(22)}, {key: stamp(30)})
    assert found == {key: {"messages": 9, "lost": 0}}


def test_numbers_of_a_publisher_that_was_started_anew_count_nothing(recording: Path) -> None:
    key = VEHICLE_STATE.key
    found = count_recorded(recording, {key: stamp(22)}, {key: stamp(30)._replace(publisher=b"another")})
    assert found == {key: {"messages": None, "lost": None}}


def test_growth_is_that_of_the_last_quarter_over_the_second() -> None:
    start = [Usage(10.0 * n, n, 1) for n in range(10)]  # still loading
    steady = [Usage(100.0, 20, 5)] * 10
    assert usage(start + steady * 3)["growth [MB]"] == 0.0
    leaking = usage([Usage(100.0 + n, 20 + n, 5 + n) for n in range(40)])
    assert leaking["growth [MB]"] == pytest.approx(20.0)
    assert (leaking["growth of files"], leaking["growth of threads"]) == (20, 20)


def test_a_process_is_sampled_by_its_id() -> None:
    found = sample_usage(os.getpid())
    assert found is not None
    assert found.memory_mb > 10
    assert found.files > 2
    assert found.threads >= 1


def test_a_process_that_has_ended_gives_no_sample() -> None:
    assert sample_usage(2**22 + 1) is None
