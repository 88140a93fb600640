"""Settings of a camera without a camera file: section ``self_calibration`` of ``config/perception.yaml``."""

from typing import Annotated

from pydantic import Field

from trepid.config import Settings
from trepid.types import Positive, Share


class SelfCalibrationSettings(Settings):
    """Section ``self_calibration`` of ``config/perception.yaml``."""

    focal_per_width: Positive
    focal_sigma: Positive
    height_m: Positive
    height_sigma: Positive
    ahead_of_rear_axle_m: float
    horizon_share: Share
    horizon_sigma: Positive
    horizon_keep: Share
    horizon_known: Annotated[int, Field(ge=1)]
    horizon_every: Annotated[int, Field(ge=1)]
    centre_sigma: Positive
    min_segment_px: Positive
    angle_sigma_rad: Positive
    prior_weight: Positive
    grid_step_px: Annotated[int, Field(ge=1)]
