"""A slow network behind a queue falls behind, and one that takes the newest frame does not; angles by speed."""

from typing import Any

import numpy as np
import pytest
from message_rig import decision

from lab.bench.catalogue import BENCHMARKS
from lab.bench.cli import benchmarks
from lab.bench.study import loops
from lab.bench.study.loops import NETWORK_S, SlowNetwork
from trepid.messages import Command, Decision, VehicleState


class Follower:
    """Remembers the frame that each command goes back to."""

    def __init__(self) -> None:
        self.frames_s: list[float | None] = []

    def step(self, decision: Decision | None, state: VehicleState | None, *, now_s: float) -> Command:
        """A command without content."""
        self.frames_s.append(None if decision is None else decision.t_s)
        return Command(t_s=now_s, road_wheel_angle_rad=0.0, speed_mps=0.0, accel_mps2=0.0)


def follow_frames(rate_hz: float, *, queue: bool, duration_s: float = 4.0) -> tuple[Follower, SlowNetwork]:
    """The frames that are followed when frames come at ``rate_hz``, in steps of 20 ms."""
    follower = Follower()
    network = SlowNetwork(follower, queue=queue)
    for tick in range(round(duration_s / 0.02)):
        now_s = 0.02 * tick
        network.step(decision(round(now_s * rate_hz + 1e-9) // 1 / rate_hz), None, now_s=now_s)
    return follower, network


@pytest.mark.parametrize("queue", [True, False])
def test_every_frame_is_followed_after_the_time_of_the_network(queue: bool) -> None:
    follower, network = follow_frames(5.0, queue=queue)
    assert follower.frames_s[: round(NETWORK_S / 0.02)] == [None] * round(NETWORK_S / 0.02)
    assert {f for f in follower.frames_s if f is not None} == {n / 5 for n in range(20)}
    assert network.oldest_s == pytest.approx(NETWORK_S, abs=0.021)


def test_twice_as_many_frames_as_the_network_takes_age_in_a_queue_but_not_by_latest_wins() -> None:
    _, queued = follow_frames(20.0, queue=True)
    _, newest = follow_frames(20.0, queue=False)
    assert queued.oldest_s == pytest.approx(2.0, abs=0.2), "half of 4 s"
    assert newest.oldest_s < NETWORK_S + 0.05 + 0.021


def test_the_lane_is_lost_with_a_queue_of_20_hz_and_kept_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "PERIODS", (5,))
    (row,) = loops.bench_frame_rate(seed=0)["frame rate"].values()
    assert row["queue [m]"] > 1.0 and row["latest wins [m]"] < 0.2


def test_transposed_angles_keep_nearer_to_the_centre_at_20_mph(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "SPEEDS_MPH", (20,))
    (row,) = loops.bench_speed(seed=0)["speed"].values()
    assert row["transposed, 25 Hz [m]"] < 0.5 * row["as learned, 25 Hz [m]"]


def test_study_and_a_name_is_that_study_and_study_alone_are_all() -> None:
    assert benchmarks(["study", "speed", "data"]) == ["study-speed", "study-data"]
    assert benchmarks(["study"]) == [name for name in BENCHMARKS if name.startswith("study-")]


def test_a_network_behind_frames_of_100_hz_gets_each_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(loops, "PERIODS", (1, 2))
    seen: list[list[float]] = []

    class Counting(SlowNetwork):
        def __init__(self, *args: Any, **options: Any) -> None:
            super().__init__(*args, **options)
            seen.append([])

        def step(self, decision: Decision | None, state: VehicleState | None, *, now_s: float) -> Command:
            if decision is not None and decision.t_s is not None:
                seen[-1].append(decision.t_s)
            return super().step(decision, state, now_s=now_s)

    monkeypatch.setattr(loops, "SlowNetwork", Counting)
    loops.bench_frame_rate(1)
    of_100_hz, of_50_hz = (np.unique(seen[number]) for number in (1, 3))  # by latest wins
    assert np.diff(of_100_hz) == pytest.approx(0.01) and np.diff(of_50_hz) == pytest.approx(0.02)
