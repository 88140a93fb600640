"""A limiter and its inputs for tests, with limits whose edges are exact in binary."""

import message_rig
from message_rig import SHUTTLE

from controller.limiter import Limiter, Limits
from controller.limiter.inputs import SeenState
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import VehicleState

SHIPPED = load(CONFIG_DIR / "limiter.yaml", Limits)
EXACT_CAR = SHUTTLE.model_copy(update={"standstill_mps": 0.125})
DT_S = 1.0 / 128.0  # a tick whose multiples are exact

# Edges that a test can stand on exactly.
EXACT = SHIPPED.model_copy(
    update=dict(
        command_late_s=0.0625,
        command_timeout_s=0.25,
        command_rate_hz=16.0,  # 8 commands in half a second
        state_timeout_s=0.125,
        frame_timeout_s=0.5,
        early_s=0.0625,
        max_step_s=0.0625,
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


def limiter(limits: Limits = AT_ONCE, car: Vehicle = EXACT_CAR) -> Limiter:
    """A limiter before its first step."""
    return Limiter(car, limits)


def state(now_s=0.0, **changes) -> VehicleState:
    """A fresh state: straight on at 5 m/s, no yaw rate measured; changed."""
    return message_rig.state(now_s, **(dict(yaw_rate_radps=None) | changes))


def seen_state(**changes) -> SeenState:
    """A plausible state: straight on at 5 m/s, with changes."""
    calm = dict(speed_mps=5.0, wheel_rad=0.0, driver=False, torque_nm=None, yaw_rate_radps=None)
    return SeenState(**(calm | changes))
