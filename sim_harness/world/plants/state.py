"""Where a simulated vehicle is and how it moves."""

from dataclasses import dataclass

from trepid.frozen import quick


@quick
@dataclass(frozen=True, slots=True, kw_only=True)
class PlantState:
    """Pose of the centre of the rear axle, motion along the vehicle, and the steering on its way to the tyres."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0  # not wrapped: grows by 2π per left-hand lap
    speed_mps: float = 0.0  # along the vehicle; never negative
    accel_mps2: float = 0.0
    road_wheel_angle_rad: float = 0.0  # as the sensor on the steering knows it
    acting_demand_rad: float = 0.0  # the demand that the steering follows now
    pending: tuple[tuple[float, float], ...] = ()  # (clock when it acts [s], demand [rad]), earliest first
    clock_s: float = 0.0  # time driven
    play_rad: float = 0.0  # how far the tyres are ahead of the steering, within its friction
    inner: tuple[float, ...] = ()  # what only the model knows; () = settled on what the wheels ask for
