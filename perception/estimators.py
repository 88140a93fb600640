"""The table of estimators: what `--estimator NAME` and the perception process can run."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

from perception.lane_cv import LaneCv, LaneCvSettings
from trepid.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.vehicle import Vehicle


class Estimator(Protocol):
    """Sees the lane in a frame. Its only state is what earlier steps gave it."""

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``; all None with a reason when there is none to be seen."""
        ...


@dataclass(frozen=True, slots=True)
class Entry:
    """How to build an estimator, and what it is in a line."""

    description: str
    build: Callable[[Camera, Vehicle], Estimator]


@cache  # reading YAML costs as much as estimating ten frames, and a folder of stills builds one for each
def lane_cv_settings() -> LaneCvSettings:
    """``config/perception.yaml``. Raises InputError."""
    return load(CONFIG_DIR / "perception.yaml", LaneCvSettings)


def _lane_cv(camera: Camera, vehicle: Vehicle) -> Estimator:
    return LaneCv(lane_cv_settings(), camera, vehicle)


def _steer_net(camera: Camera, vehicle: Vehicle) -> Estimator:
    # Imported here: ONNX Runtime costs 0.2 s and 40 MB that the other estimators need not pay.
    from perception.steer_net import SteerNet, SteerNetSettings

    return SteerNet(load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings), camera, vehicle)


ESTIMATORS = {
    "cv": Entry("lane lines or road edges, robust clothoid fit, Kalman tracking", _lane_cv),
    "cnn": Entry("PilotNet-sized network from pixels to lane state with its own uncertainty", _steer_net),
}


def build(
    name: str, *, camera: Path = CONFIG_DIR / "camera.yaml", vehicle: Path = CONFIG_DIR / "vehicle.yaml"
) -> Estimator:
    """The estimator called ``name`` for the camera and vehicle files. Raises InputError."""
    if name not in ESTIMATORS:
        raise InputError(f"no estimator {name!r}; there are {', '.join(ESTIMATORS)}")
    return ESTIMATORS[name].build(load(camera, Camera), load(vehicle, Vehicle))
