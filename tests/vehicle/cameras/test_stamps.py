"""Times of capture of live frames."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vehicle.cameras.device import CaptureStamps

EPOCH_S = 1.7e9  # of the clock of the drive at the monotonic time 0


def stamp_of(stamps: CaptureStamps, kernel_s: float, grabbed_s: float) -> float | None:
    return stamps.stamp(kernel_s, grabbed_s=grabbed_s, now_s=EPOCH_S + grabbed_s)


def test_a_plausible_stamp_of_the_kernel_is_the_time_of_capture() -> None:
    stamps = CaptureStamps()
    assert stamp_of(stamps, 99.97, 100.0) == pytest.approx(EPOCH_S + 99.97)
    assert stamps.origin == "kernel"


@pytest.mark.parametrize("kernel_s", [0.0, -1.0, 100.001, 98.9, 1.7e9, math.nan, math.inf, -math.inf])
def test_a_stamp_of_another_clock_or_from_the_future_gives_way_to_the_return_of_the_grab(
    kernel_s: float,
) -> None:
    stamps = CaptureStamps()
    assert stamp_of(stamps, kernel_s, 100.0) == EPOCH_S + 100.0
    assert stamps.origin == "grab"


def test_a_frame_that_waited_while_the_process_stood_still_stays_old() -> None:
    stamps = CaptureStamps()
    stamp_of(stamps, 99.97, 100.0)
    assert stamp_of(stamps, 100.0, 108.0) == pytest.approx(EPOCH_S + 100.0)
    assert stamps.origin == "kernel"


def test_a_repeated_stamp_of_the_kernel_is_not_a_time_of_capture() -> None:
    stamps = CaptureStamps()
    stamp_of(stamps, 99.97, 100.0)
    stamp_of(stamps, 99.97, 100.1)
    assert stamps.origin == "grab"


@given(st.lists(st.tuples(st.floats(-5, 300, width=32), st.floats(0, 0.5)), max_size=20))
def test_times_increase_and_are_never_in_the_future(frames: list[tuple[float, float]]) -> None:
    stamps, grabbed_s, times = CaptureStamps(), 100.0, []
    for kernel_s, later_s in frames:
        grabbed_s += later_s
        t_s = stamp_of(stamps, kernel_s, grabbed_s)
        if t_s is not None:
            assert t_s <= EPOCH_S + grabbed_s
            times.append(t_s)
    assert times == sorted(set(times))
