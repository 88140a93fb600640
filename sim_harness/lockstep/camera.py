"""The simulated camera as a node: truth in, frame out, with the camera faults of the scenario."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from sim_harness.scenarios.faults import BlackFrames, Fault, FrozenCamera, LateFrames
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.plants.axles import GRAVITY_MPS2
from sim_harness.world.plants.springs import LEVEL, Attitude, BodyOnSprings
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.people import Figure
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import STILL, ShutterMotion
from sim_harness.world.roads.road import Road
from sim_harness.world.sight_truth import SightDistance, SightTruth
from trepid.messages import Frame, SimTruth
from trepid.types import Image


@dataclass(frozen=True, slots=True)
class FrameWithTruth:
    """A frame and the truth at its capture."""

    truth: SimTruth  # at the capture; also of a frozen or a black frame
    frame: Frame | None  # None where nothing is rendered
    sight: SightDistance | None = None  # how far the camera sees in truth, faults of the camera apart


class Pictures(Protocol):
    """What draws the images: the renderer, or a world of another package, which knows its own pose."""

    seed: int

    @property
    def road(self) -> Road | None:
        """The road that is drawn; None: it is not known here, and the body stands level."""
        ...

    def render(
        self,
        x_m: float,
        y_m: float,
        yaw_rad: float,
        *,
        station_m: float | None,
        t_s: float,
        vehicles: Sequence[tuple[Pose, Body | Figure]],
        motion: ShutterMotion,
        attitude: Attitude,
    ) -> Image:
        """The image of one moment, BGR."""
        ...


class SimulatedCamera:
    """Renders frames from the true pose, with the camera faults that are active."""

    def __init__(
        self,
        scenario: Scenario,
        renderer: Pictures | None,
        sight_truth: SightTruth | None = None,
        *,
        wheelbase_m: float,
    ) -> None:
        """Without a ``renderer`` shots have no frames, without ``sight_truth`` no sight."""
        self._faults = scenario.faults
        self._bodies = [vehicle.body for vehicle in scenario.traffic]
        self._figures = [user.figure for user in scenario.road_users]
        self.renderer, self._sight_truth = renderer, sight_truth
        """What draws the images."""
        plant = scenario.plant
        self._body = BodyOnSprings(plant.springs, load_kg=plant.load_kg) if plant.springs else None
        self._plant_bank_rad, self._wheelbase_m = plant.bank_rad, wheelbase_m
        self._last: Image | None = None
        self._underway: list[tuple[float, FrameWithTruth]] = []  # time of arrival

    def step(self, truth: SimTruth, *, now_s: float) -> Frame | None:
        """The frame of :meth:`shoot`."""
        shot = self.shoot(truth, now_s=now_s)
        return shot.frame if shot else None

    def shoot(self, truth: SimTruth, *, now_s: float) -> FrameWithTruth | None:
        """The newest shot that has arrived by ``now_s``: that of ``truth``, or None while frames are late."""
        elapsed_s = truth.elapsed_s
        faults = [] if elapsed_s is None else [f for f in self._faults if f.active(elapsed_s)]
        frame = None
        if self.renderer is not None:
            frame = Frame(t_s=truth.t_s, image=self._image(self.renderer, truth, faults))
        delay_s = sum(fault.delay_s for fault in faults if isinstance(fault, LateFrames))
        self._underway.append((now_s + delay_s, FrameWithTruth(truth, frame, self._sight(truth))))
        arrived = [shot for due_s, shot in self._underway if due_s <= now_s + 1e-9]
        self._underway = [(due_s, shot) for due_s, shot in self._underway if due_s > now_s + 1e-9]
        return max(arrived, key=lambda shot: shot.truth.t_s, default=None)

    def _sight(self, truth: SimTruth) -> SightDistance | None:
        if self._sight_truth is None:
            return None
        pose = (truth.x_m, truth.y_m, truth.yaw_rad)
        return self._sight_truth.at(truth.station_m, pose, others(truth, self._bodies))

    def _attitude(self, renderer: Pictures, truth: SimTruth) -> Attitude:
        """The attitude of the body by humps and by the forces of its tyres, which also hold its weight."""
        road = renderer.road
        if road is None:
            return LEVEL
        axles_rad = road.pitch_over_humps(truth.station_m, self._wheelbase_m)
        if self._body is None:
            return Attitude(pitch_rad=axles_rad)
        grade, lean_rad = road.grade_at(truth.station_m), self._plant_bank_rad + road.bank_at(truth.station_m)
        ahead_mps2 = truth.longitudinal_accel_mps2 + GRAVITY_MPS2 * math.sin(math.atan(grade))
        left_mps2 = truth.lateral_accel_mps2 + GRAVITY_MPS2 * math.sin(lean_rad)
        return self._body.step(ahead_mps2, left_mps2, now_s=truth.t_s, axles_rad=axles_rad)

    def _image(self, renderer: Pictures, truth: SimTruth, faults: list[Fault]) -> Image:
        if self._last is not None and any(isinstance(fault, FrozenCamera) for fault in faults):
            return self._last
        image = renderer.render(
            truth.x_m,
            truth.y_m,
            truth.yaw_rad,
            station_m=truth.station_m,
            t_s=truth.t_s,
            vehicles=[*others(truth, self._bodies), *people(truth, self._figures, seed=renderer.seed)],
            motion=own_motion(truth),
            attitude=self._attitude(renderer, truth),
        )
        if any(isinstance(fault, BlackFrames) for fault in faults):
            image = np.zeros_like(image)
        self._last = image
        return image


def others(truth: SimTruth, bodies: Sequence[Body]) -> list[tuple[Pose, Body]]:
    """Poses and bodies of the other vehicles."""
    poses = zip(truth.traffic_x_m, truth.traffic_y_m, truth.traffic_yaw_rad, strict=True)
    return list(zip(poses, bodies, strict=True))


def people(truth: SimTruth, figures: Sequence[Figure], *, seed: int) -> list[tuple[Pose, Figure]]:
    """Poses and figures of the road users, of different looks, in the step of the way along their heading."""
    poses = zip(truth.user_x_m, truth.user_y_m, truth.user_yaw_rad, strict=True)
    moving = zip(poses, truth.user_speed_mps, figures, strict=True)
    return [
        (pose, replace(figure, looks=100 * seed + number, speed_mps=speed_mps, walked_m=_way_m(pose)))
        for number, (pose, speed_mps, figure) in enumerate(moving)
    ]


def _way_m(pose: Pose) -> float:
    x_m, y_m, yaw_rad = pose
    return x_m * math.cos(yaw_rad) + y_m * math.sin(yaw_rad)


def own_motion(truth: SimTruth) -> ShutterMotion:
    """The motion of the camera; STILL without speed and yaw rate."""
    if truth.speed_mps is None or truth.yaw_rate_radps is None:
        return STILL
    return ShutterMotion(truth.speed_mps, truth.yaw_rate_radps)
