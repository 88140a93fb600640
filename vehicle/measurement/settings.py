"""The settings of the checks of measurements."""

from typing import ClassVar

from trepid.config import CONFIG_DIR, Settings, load
from trepid.types import NonNegative, Positive


class RangeSettings(Settings):
    """``range``: the largest magnitudes."""

    speed_mps: Positive
    yaw_rate_radps: Positive
    torque_nm: Positive
    lock_share: Positive  # of the lock of the vehicle file ...
    lock_rad: NonNegative  # ... and so much beyond


class DoubtSettings(Settings):
    """``doubt``: how long a doubt lasts."""

    trust_after_s: Positive
    spike_s: NonNegative
    moving_mps: Positive


class SpeedSettings(Settings):
    """``speed``."""

    tyre_accel_mps2: Positive
    step_mps: Positive
    step_share: NonNegative
    window_s: Positive
    drive_slack_mps2: Positive
    brake_slack_mps2: Positive
    reverse_mps: Positive
    return_mps: Positive
    return_share: NonNegative


class WheelSettings(Settings):
    """``wheel_angle``."""

    rate_share: Positive
    step_rad: Positive
    command_rad: Positive
    command_after_s: NonNegative
    lateness: Positive


class YawSettings(Settings):
    """``yaw_rate``."""

    moved_fields: ClassVar = {"standing_mps": "standstill_mps of vehicle.yaml"}

    step_radps: Positive
    step_rad: NonNegative
    filter_s: Positive
    offset_rad: NonNegative
    offset_s: Positive
    wheel_rad: Positive
    wheel_share: NonNegative
    understeer_share: NonNegative
    noise_radps: NonNegative
    lag_s: Positive
    standing_radps: Positive


class StandsSettings(Settings):
    """``stands``: a value that repeats itself."""

    after_s: Positive
    usual_times: Positive
    speed_mps: Positive
    wheel_angle_rad: Positive
    yaw_rate_radps: Positive


class SlopeSettings(Settings):
    """``slope``: small movements of the steering over several seconds."""

    span_s: Positive
    filter_s: Positive
    moved_rad: Positive
    sigmas: Positive
    most: Positive


class MeasurementSettings(Settings):
    """``config/measurement.yaml``."""

    range: RangeSettings
    doubt: DoubtSettings
    speed: SpeedSettings
    wheel_angle: WheelSettings
    yaw_rate: YawSettings
    slope: SlopeSettings
    stands: StandsSettings


def load_measurement() -> MeasurementSettings:
    """The settings in ``config/``. Raises InputError."""
    return load(CONFIG_DIR / "measurement.yaml", MeasurementSettings)
