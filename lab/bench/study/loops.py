"""Angles of 5 mph at other speeds and frame rates, on the road of :mod:`lab.bench.control.deep_steer`.

Every driver gets the exact lane, so that no error is one of perception. The values are the largest distances from
the lane centre [m]; an episode ends where the lane is lost, at 5 m.
"""

import math
from dataclasses import replace
from typing import Any

from lab.bench.control.contestants import nominal
from lab.bench.control.deep_steer import AnglesOfFiveMph, winding_episode
from lab.bench.control.episode import FRAME_EVERY, LATENCY_S, TICK_S, Steering, Track, drive_by
from lab.bench.control.speeds import MPH
from trepid.messages import Command, Decision, VehicleState

Row = dict[str, Any]
SPEEDS_MPH = (5, 10, 15, 20, 25)
PERIODS = (100, 50, 20, 10, 5, 4, 2, 1)  # ticks between two frames: 1 to 100 Hz
NETWORK_S = 0.1  # the time of the network of the paper for an image
_SAME_INSTANT_S = 1e-9


def bench_speed(seed: int) -> Row:
    """Largest distance from the centre [m] by speed, with and without correction of the understeer."""
    vehicle = nominal()
    rows: dict[str, Row] = {}
    for mph in SPEEDS_MPH:
        paper = winding_episode(vehicle, mph * MPH, seed)
        ours = replace(paper, frame_every=FRAME_EVERY, latency_s=LATENCY_S)
        for name, transposed in (("as learned", False), ("transposed", True)):
            for rate, episode in (("5 Hz", paper), ("25 Hz", ours)):
                track = drive_by(AnglesOfFiveMph(vehicle, transposed=transposed), episode)
                rows.setdefault(f"{mph} mph", {})[f"{name}, {rate} [m]"] = round(track.worst_m, 3)
    return {"speed": rows}


def bench_frame_rate(seed: int) -> Row:
    """Largest distance from the centre [m] and age of a new angle [s] at 5 mph by frame rate.

    An angle stays until the next one, so that it is used up to one period longer.
    """
    vehicle = nominal()
    road = winding_episode(vehicle, 5 * MPH, seed)
    rows: dict[str, Row] = {}
    for ticks in PERIODS:
        row: Row = {}
        for name, queue in (("queue", True), ("latest wins", False)):
            network = SlowNetwork(AnglesOfFiveMph(vehicle, transposed=False), queue=queue)
            track: Track = drive_by(network, replace(road, frame_every=ticks, latency_s=0.0, control_every=1))
            row[f"{name} [m]"] = round(track.worst_m, 3)
            row[f"{name}, oldest new angle [s]"] = round(network.oldest_s, 2)
        rows[f"{1 / (ticks * TICK_S):g} Hz"] = row
    return {"frame rate": rows}


class SlowNetwork:
    """A driver behind a network that takes NETWORK_S a frame; frames wait in a queue, or the newest one does."""

    def __init__(self, steering: Steering, *, queue: bool) -> None:
        self._steering, self._queue = steering, queue
        self._waiting: list[Decision] = []
        self._underway: tuple[Decision, float] | None = None  # frame, and end of its step
        self._finished: Decision | None = None
        self._newest_s = -math.inf
        self.oldest_s = 0.0  # greatest age of a frame when its angle is there

    def step(self, decision: Decision | None, state: VehicleState | None, *, now_s: float) -> Command:
        """The command of the driver for the newest finished frame."""
        if decision is not None and decision.t_s is not None and decision.t_s > self._newest_s:
            self._newest_s = decision.t_s
            self._waiting = [*self._waiting, decision] if self._queue else [decision]
        if self._underway is not None and now_s >= self._underway[1] - _SAME_INSTANT_S:
            self._finished, self._underway = self._underway[0], None
            self.oldest_s = max(self.oldest_s, now_s - (self._finished.t_s or 0.0))
        if self._underway is None and self._waiting:
            self._underway = (self._waiting.pop(0), now_s + NETWORK_S)
        return self._steering.step(self._finished, state, now_s=now_s)
