"""Messages of an undisturbed drive, with changes."""

from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, Decision, Mode, SteeringEstimate, Stop, VehicleState

SHUTTLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SIGHT_M = 10.0


def vehicle(**changes) -> Vehicle:
    """The shuttle, changed."""
    return SHUTTLE.model_copy(update=changes)


def decision(now_s=0.0, **changes) -> Decision:
    """A fresh decision to keep a straight lane at 5 m/s, changed."""
    calm = dict(
        t_s=now_s,
        decided_s=now_s,
        mode=Mode.KEEP,
        stop=Stop.NONE,
        fear=0.0,
        level="very_low",
        cause="none",
        path_t_s=now_s,
        lateral_offset_m=0.0,
        heading_error_rad=0.0,
        curvature_1pm=0.0,
        curvature_rate_1pm2=0.0,
        lookahead_m=SIGHT_M,
        path_source="cv",
        sources=("cv",),
        trust=(1.0,),
        speed_factor=1.0,
        speed_cap_mps=5.0,
    )
    return Decision(**(calm | changes))


def estimate(t_s=0.0, **changes) -> SteeringEstimate:
    """A sure estimate of a lane with two lines, changed."""
    calm = dict(
        t_s=t_s,
        estimator="cv",
        lateral_offset_m=0.1,
        heading_error_rad=0.01,
        curvature_1pm=0.002,
        curvature_rate_1pm2=0.0001,
        lookahead_m=8.0,
        road_wheel_angle_rad=0.0,
        confidence=0.9,
        lanes_detected=2,
        lane_width_m=3.4,
        reason="",
    )
    return SteeringEstimate(**(calm | changes))


def state(now_s=0.0, **changes) -> VehicleState:
    """A fresh state: straight on at 5 m/s, changed."""
    calm = dict(t_s=now_s, speed_mps=5.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False)
    return VehicleState(**(calm | changes))


def command(now_s=0.0, **changes) -> Command:
    """Straight on at constant speed, changed."""
    calm = dict(
        t_s=now_s,
        road_wheel_angle_rad=0.0,
        speed_mps=5.0,
        accel_mps2=0.0,
    )
    return Command(**(calm | changes))
