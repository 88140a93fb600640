"""The shipped CNN estimator on single images."""

import numpy as np

from perception.net.steer_net import SteerNet, SteerNetSettings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame, SteeringEstimate

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SETTINGS = load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings)


def step(net: SteerNet, image: np.ndarray, t_s: float = 1.0) -> SteeringEstimate:
    return net.step(Frame(t_s=t_s, image=image), None, now_s=t_s)


def measurements(estimate: SteeringEstimate) -> tuple[float | None, ...]:
    return (
        estimate.lateral_offset_m,
        estimate.heading_error_rad,
        estimate.curvature_1pm,
        estimate.curvature_rate_1pm2,
        estimate.road_wheel_angle_rad,
    )
