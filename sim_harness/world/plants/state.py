"""The state of a simulated vehicle."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """Pose of the centre of the rear axle, longitudinal motion, and the state of the steering."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0  # not wrapped: grows by 2π per left-hand lap
    speed_mps: float = 0.0  # along the vehicle; never negative
    accel_mps2: float = 0.0  # by drive and brakes, without the pull of the weight on a hill
    road_wheel_angle_rad: float = 0.0  # as measured by the steering sensor
    acting_demand_rad: float = 0.0  # the demand that acts on the steering
    pending: tuple[tuple[float, float], ...] = ()  # (time at which it acts [s], demand [rad]), earliest first
    clock_s: float = 0.0  # time driven
    play_rad: float = 0.0  # tyre angle minus steering angle, within the friction
    inner: tuple[float, ...] = ()  # further states of the model; () = steady state at the wheel angle
