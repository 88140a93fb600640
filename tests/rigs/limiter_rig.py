"""Shared by the limiter's tests: messages with calm defaults, and limits whose edges are exact in binary."""

from controller.limiter import Limiter, Limits
from controller.limiter.inputs import Seen
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, VehicleState
from trepid.vehicle import Vehicle

SHUTTLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SHIPPED = load(CONFIG_DIR / "limiter.yaml", Limits)
DT_S = 1.0 / 128.0  # a tick whose multiples are exact

# Edges that a test can stand on exactly.
EXACT = SHIPPED.model_copy(
    update=dict(
        command_timeout_s=0.25,
        command_rate_hz=16.0,  # 8 commands in half a second
        state_timeout_s=0.125,
        frame_timeout_s=0.5,
        early_s=0.0625,
        max_step_s=0.0625,
        standstill_mps=0.125,
        lateral_accel_share=1.0,
        lateral_jerk_share=1.0,
        override=SHIPPED.override.model_copy(
            update=dict(
                torque_nm=3.0,
                angle_rad=0.03125,
                angle_after_s=0.25,
                lateness=2.0,
                still_rad=0.0078125,
                release_s=1.0,
                fade_mps3=4.0,
                fade_in_s=0.5,
            )
        ),
        saturation=SHIPPED.saturation.model_copy(update=dict(cut_mps2=0.25, after_s=0.5, from_mps=2.0)),
    )
)
AT_ONCE = EXACT.model_copy(  # no fading in, no driver found by deviation
    update=dict(override=EXACT.override.model_copy(update=dict(fade_in_s=1e-9, angle_rad=9.0)))
)


def vehicle(**changes) -> Vehicle:
    """The shuttle, changed."""
    return SHUTTLE.model_copy(update=changes)


def limiter(limits: Limits = AT_ONCE, car: Vehicle = SHUTTLE) -> Limiter:
    """A limiter before its first step."""
    return Limiter(car, limits)


def state(now_s=0.0, **changes) -> VehicleState:
    """A fresh state: straight on at 5 m/s, no yaw rate measured; changed."""
    calm = dict(
        t_s=now_s, speed_mps=5.0, road_wheel_angle_rad=0.0, yaw_rate_radps=None, driver_override=False
    )
    return VehicleState(**(calm | changes))


def command(now_s=0.0, **changes) -> Command:
    """Straight on at constant speed, changed."""
    calm = dict(
        t_s=now_s,
        road_wheel_angle_rad=0.0,
        road_wheel_rate_radps=0.0,
        speed_mps=5.0,
        accel_mps2=0.0,
        jerk_mps3=0.0,
    )
    return Command(**(calm | changes))


def seen(**changes) -> Seen:
    """A plausible state: straight on at 5 m/s, with changes."""
    calm = dict(speed_mps=5.0, wheel_rad=0.0, driver=False, torque_nm=None, yaw_rate_radps=None)
    return Seen(**(calm | changes))
