"""The simulated camera as a node: truth in, frame out, with the camera faults of the scenario."""

from dataclasses import dataclass

import numpy as np

from sim_harness.render.lead import Pose
from sim_harness.render.renderer import Renderer
from sim_harness.scenarios.faults import BlackFrames, Fault, FrozenCamera, LateFrames
from sim_harness.scenarios.scenario import Scenario
from trepid.messages import Frame, Image, SimTruth


@dataclass(frozen=True, slots=True)
class _Underway:
    """A frame that is on its way."""

    due_s: float
    frame: Frame


class SimulatedCamera:
    """Photographs the road from the true pose."""

    def __init__(self, scenario: Scenario, renderer: Renderer) -> None:
        self._scenario = scenario
        self._renderer = renderer
        self._origin_s: float | None = None
        self._last: Image | None = None
        self._underway: list[_Underway] = []

    def step(self, truth: SimTruth, *, now_s: float) -> Frame | None:
        """The newest frame that has arrived by ``now_s``: that of ``truth``, or None while frames are late."""
        if self._origin_s is None:
            self._origin_s = now_s
        faults = [f for f in self._scenario.faults if f.active(now_s - self._origin_s)]
        frame = Frame(t_s=truth.t_s, image=self._image(truth, faults))
        delay_s = sum(fault.delay_s for fault in faults if isinstance(fault, LateFrames))
        self._underway.append(_Underway(now_s + delay_s, frame))
        arrived = [entry for entry in self._underway if entry.due_s <= now_s + 1e-9]
        self._underway = [entry for entry in self._underway if entry.due_s > now_s + 1e-9]
        return max((entry.frame for entry in arrived), key=lambda frame: frame.t_s, default=None)

    def _image(self, truth: SimTruth, faults: list[Fault]) -> Image:
        if self._last is not None and any(isinstance(fault, FrozenCamera) for fault in faults):
            return self._last
        image = self._renderer.render(
            truth.x_m,
            truth.y_m,
            truth.yaw_rad,
            station_m=truth.station_m,
            t_s=truth.t_s,
            lead=lead_pose(truth),
        )
        if any(isinstance(fault, BlackFrames) for fault in faults):
            image = np.zeros_like(image)
        self._last = image
        return image


def lead_pose(truth: SimTruth) -> Pose | None:
    """x, y and yaw of the vehicle ahead, at its rear axle; None without one."""
    if truth.lead_x_m is None or truth.lead_y_m is None or truth.lead_yaw_rad is None:
        return None
    return truth.lead_x_m, truth.lead_y_m, truth.lead_yaw_rad
