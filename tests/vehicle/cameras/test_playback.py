"""The pace and the stamps of recordings."""

from collections.abc import Iterator

import numpy as np
import pytest
from camera_source_rig import ManualClock, number_of, picture

from trepid.config import InputError
from trepid.types import Image
from vehicle.cameras.playback import Playback, UndecodedFrame

STAMPS_S = [50.0, 50.1, 50.2, 50.5, 50.6]


def play(
    clock: ManualClock, *, pace: float = 1.0, loop: bool = False, stamps_s: list[float] = STAMPS_S
) -> Playback:
    def shots() -> Iterator[UndecodedFrame]:
        for number, stamp_s in enumerate(stamps_s):
            yield UndecodedFrame(stamp_s, lambda number=number: picture(number))

    return Playback(shots, now_s=clock, pace=pace, loop=loop, sleep=clock.sleep)


def all_frames(source: Playback, *, timeout_s: float = 1.0) -> list[tuple[float, int]]:
    frames = []
    while not source.ended and len(frames) < 12:
        frame = source.read(timeout_s=timeout_s)
        if frame is not None:
            frames.append((frame.t_s, number_of(frame.image)))
    return frames


def test_frames_keep_the_gaps_of_their_stamps_shifted_to_the_first_reading() -> None:
    clock = ManualClock(1000.0)
    frames = all_frames(play(clock))
    assert [number for _, number in frames] == [0, 1, 2, 3, 4]
    assert [t_s for t_s, _ in frames] == pytest.approx([1000.0, 1000.1, 1000.2, 1000.5, 1000.6])
    assert clock.t_s == pytest.approx(1000.6)  # and no frame came before its time


def test_no_frame_comes_before_it_is_due() -> None:
    clock = ManualClock()
    source = play(clock)
    source.read(timeout_s=0.0)
    assert source.read(timeout_s=0.05) is None
    assert clock.t_s == pytest.approx(1000.05)


def test_a_late_reader_gets_the_newest_frame_that_is_due_with_its_own_time() -> None:
    clock = ManualClock()
    source = play(clock)
    source.read(timeout_s=0.0)
    clock.sleep(0.3)
    frame = source.read(timeout_s=0.0)
    assert frame is not None and (frame.t_s, number_of(frame.image)) == (pytest.approx(1000.2), 2)
    assert ("dropped_frames", "1") in source.values()


def test_twice_the_pace_halves_the_gaps() -> None:
    assert [t_s for t_s, _ in all_frames(play(ManualClock(), pace=2.0))] == pytest.approx(
        [1000.0, 1000.05, 1000.1, 1000.25, 1000.3]
    )


def test_without_a_pace_every_frame_comes_at_once_stamped_with_the_time_of_reading() -> None:
    clock = ManualClock()
    assert all_frames(play(clock, pace=0.0)) == [(1000.0, number) for number in range(5)]


def test_a_loop_begins_again_with_increasing_times() -> None:
    frames = all_frames(play(ManualClock(), loop=True))
    times_s = [t_s for t_s, _ in frames]
    assert [number for _, number in frames[:7]] == [0, 1, 2, 3, 4, 0, 1]
    assert times_s == sorted(set(times_s))


def test_frames_with_stamps_out_of_order_are_left_out() -> None:
    source = play(ManualClock(), stamps_s=[50.0, 50.2, 50.1, 50.3])
    assert [number for _, number in all_frames(source)] == [0, 1, 3]


def test_a_recording_ends_and_says_so() -> None:
    source = play(ManualClock())
    all_frames(source)
    assert source.ended and source.read(timeout_s=0.0) is None and "ended" in source.trouble


def test_a_frame_that_cannot_be_decoded_is_reported_and_the_next_one_comes() -> None:
    def refuse_frame() -> Image:
        raise InputError("frame 0 is broken")

    shots = [UndecodedFrame(0.0, refuse_frame), UndecodedFrame(0.1, lambda: np.zeros((16, 16, 3), np.uint8))]
    clock = ManualClock()
    source = Playback(lambda: iter(shots), now_s=clock, pace=1.0, loop=False, sleep=clock.sleep)
    assert source.read(timeout_s=1.0) is None and source.trouble == "frame 0 is broken"
    assert source.read(timeout_s=1.0) is not None
    assert ("malformed_images", "1") in source.values()


def test_a_recording_without_frames_is_refused() -> None:
    with pytest.raises(InputError, match="no frame"):
        play(ManualClock(), stamps_s=[])
