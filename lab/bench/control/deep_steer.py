"""The failure of the Deep Steer paper and its remedy: one winding road at 5 to 20 mph.

The network of the paper maps an image to the steering angle of a driver at 5 mph, five times a second, and the
angle is held until the next image. It followed the road at 5 mph and lost it "in high road curvature areas" at
speeds near 20 mph (section 5.2). Two effects are not compensated: the angle that grows with speed (understeer;
future work in section 6), and the delay: image, network, half of the hold and the actuator take one metre at 5 mph,
but four metres at 20 mph, with a look-ahead of five metres.

Every controller gets the same exact lane, so that no error is one of perception.
"""

import math
from dataclasses import replace
from typing import Any

from controller.model.bicycle import angle_from_curvature, transposed_angle
from lab.bench.control.contestants import nominal, shipped_settings
from lab.bench.control.episode import FRAME_EVERY, LATENCY_S, Episode, drive, drive_by, road_of
from lab.bench.control.speeds import MPH
from sim_harness.world.roads.road import Road
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.messages import Command, Decision, VehicleState

SPEEDS_MPH = (5, 10, 15, 20)
LEARNED_AT_MPS = 5 * MPH
DRIVER_AHEAD_M = 5.0  # 2.2 s at 5 mph
PAPER_EVERY, PAPER_LATENCY_S = 20, 0.2  # ticks: 5 Hz; one frame of latency
RADIUS_M = 40.0  # 2 m/s² at 20 mph


class AnglesOfFiveMph:
    """The angle that a driver holds at 5 mph for the newest frame, at any speed."""

    def __init__(self, vehicle: Vehicle, *, transposed: bool) -> None:
        """``transposed``: correct the angle to the present speed by the understeer gradient (section 6)."""
        self._vehicle, self._transposed = vehicle, transposed

    def step(self, decision: Decision | None, state: VehicleState | None, *, now_s: float) -> Command:
        """Hold the angle until the next decision."""
        angle_rad = self._angle(decision) if decision is not None else 0.0
        if self._transposed and state is not None and state.speed_mps is not None:
            to_mps = state.speed_mps
            angle = transposed_angle(
                angle_rad, from_speed_mps=LEARNED_AT_MPS, to_speed_mps=to_mps, vehicle=self._vehicle
            )
            angle_rad = angle or 0.0
        return Command(t_s=now_s, road_wheel_angle_rad=angle_rad, speed_mps=0.0, accel_mps2=0.0)

    def _angle(self, seen: Decision) -> float:
        lane = Lane.of_message(seen) or Lane(0.0, 0.0, 0.0, 0.0)
        curvature_1pm = lane.pursuit_curvature(DRIVER_AHEAD_M)
        return angle_from_curvature(curvature_1pm, speed_mps=LEARNED_AT_MPS, vehicle=self._vehicle)


def bench_deep_steer(seed: int) -> dict[str, Any]:
    """Largest distance from the centre [m] by speed; "lost": a wheel left the lane."""
    vehicle, settings = nominal(), shipped_settings()
    rows: dict[str, dict[str, str]] = {}
    for mph in SPEEDS_MPH:
        paper = winding_episode(vehicle, mph * MPH, seed)
        ours = replace(paper, frame_every=FRAME_EVERY, latency_s=LATENCY_S)
        plain = AnglesOfFiveMph(vehicle, transposed=False)
        tracks = {
            "angles of 5 mph, 5 Hz": drive_by(plain, paper),
            "angles of 5 mph, 25 Hz": drive_by(plain, ours),
            "transposed by understeer, 5 Hz": drive_by(AnglesOfFiveMph(vehicle, transposed=True), paper),
            "Trepid's controller, 5 Hz": drive(paper, settings),
            "Trepid's controller, 25 Hz": drive(ours, settings),
        }
        for name, track in tracks.items():
            rows.setdefault(name, {})[f"{mph} mph"] = _verdict(track.worst_m, paper.road, vehicle)
    return rows


def winding_episode(vehicle: Vehicle, speed_mps: float, seed: int) -> Episode:
    """Bends of ``RADIUS_M`` with short entries, as on a country lane, with frames at the rate of the paper."""
    k = 1.0 / RADIUS_M
    pieces: list[tuple[float, float | tuple[float, float]]] = [(20.0, 0.0)]
    for bend in (k, -k, k):
        pieces += [(12.0, (0.0, bend)), (25.0, bend), (12.0, (bend, 0.0))]
    road = road_of([*pieces, (20.0, 0.0)])
    return Episode(
        road=road,
        speed_mps=speed_mps,
        duration_s=math.floor((road.length_m - 2.0) / speed_mps),
        nominal=vehicle,
        frame_every=PAPER_EVERY,
        latency_s=PAPER_LATENCY_S,
        seed=seed,
    )


def _verdict(worst_m: float, road: Road, vehicle: Vehicle) -> str:
    room_m = 0.5 * (road.width_at(0.0) - vehicle.track_m)
    return f"{worst_m:.3f}" if worst_m <= room_m else f"lost ({worst_m:.2f})"
