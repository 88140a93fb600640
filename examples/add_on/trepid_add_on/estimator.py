"""An estimator: Trepid's `cv` on the mirrored image, a second opinion with other rounding and other blind spots."""

from dataclasses import replace

import numpy as np

from perception.estimators import ESTIMATORS
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Frame, PixelPath, SteeringEstimate, VehicleState

NAME = "mirrored_cv"
ODD = (
    "lateral_offset_m",
    "heading_error_rad",
    "curvature_1pm",
    "curvature_rate_1pm2",
    "road_wheel_angle_rad",
)
"""Fields that change their sign in a mirror."""


class MirroredCv:
    """Estimates on the image mirrored left to right, as a camera on the other side of the car would see it."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        mirrored = camera.model_copy(
            update={
                "cx_px": camera.width_px - 1 - camera.cx_px,
                "y_m": -camera.y_m,
                "yaw_rad": -camera.yaw_rad,
            }
        )
        self._estimator = ESTIMATORS["cv"].build(mirrored, vehicle)
        self._last_px = camera.width_px - 1

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The estimate of ``frame``; every field that is odd in a mirror is turned back."""
        image = np.ascontiguousarray(frame.image[:, ::-1])
        found = self._estimator.step(replace(frame, image=image), _mirror_state(state), now_s=now_s)
        values = {name: getattr(found, name) for name in ODD}
        return replace(
            found,
            estimator=NAME,
            **{name: None if value is None else -value for name, value in values.items()},
            left_boundary_px=self._turn_path(found.right_boundary_px),
            right_boundary_px=self._turn_path(found.left_boundary_px),
        )

    def _turn_path(self, path: PixelPath) -> PixelPath:
        """A boundary with its columns counted from the other side."""
        return tuple((self._last_px - x_px, y_px) for x_px, y_px in path)


def _mirror_state(state: VehicleState | None) -> VehicleState | None:
    if state is None:
        return None
    odd = {
        name: getattr(state, name) for name in ("road_wheel_angle_rad", "yaw_rate_radps", "driver_torque_nm")
    }
    return replace(state, **{name: None if value is None else -value for name, value in odd.items()})
