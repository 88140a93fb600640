"""Settings of the sight distance: ``config/sight.yaml``."""

from typing import Annotated

from pydantic import Field

from trepid.config import Settings
from trepid.types import NonNegative, OpenShare, Positive, Share


class StripSettings(Settings):
    """Section ``strip``: the ground whose light is compared over distance (:mod:`.strip`)."""

    near_m: Positive
    far_m: Positive
    half_width_m: Positive
    cell_m: Positive
    band_ratio: Annotated[float, Field(gt=1)]
    horizon_margin_px: NonNegative
    path_known_m: Positive


class AirSettings(Settings):
    """Section ``air``: the fit of Koschmieder's law (:mod:`.air`)."""

    least_m: Positive
    most_m: Positive
    steps: Annotated[int, Field(ge=8, le=200)]
    unevenness: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=8)]
    noise: OpenShare
    independent: Positive
    reflectance: Share
    reflectance_sigma: Positive
    mirror_sigma: Positive
    sky_up_rad: Positive
    sky_side_rad: Positive
    model_sigma: Positive
    corridor_half_m: Positive
    corridor_up_m: Positive
    corridor_m: Annotated[tuple[Positive, ...], Field(min_length=1, max_length=16)]
    corridor_sigma: Positive


class DarkSettings(Settings):
    """Section ``dark``: the contrast of a target over the noise (:mod:`.dark`)."""

    noise_multiple: Positive
    target_side_m: Positive
    target_ratio: Annotated[float, Field(gt=1)]
    least_noise_grey: Positive
    model_sigma: Positive


class CrestSettings(Settings):
    """Section ``crest``: the end of the ground below the horizon (:mod:`.crest`)."""

    least_dip_rad: Positive
    least_step: Positive
    step_sigmas: Positive
    memory_s: Positive
    seen_share: Share
    least_closing: float
    most_closing: OpenShare
    usual_closing: OpenShare
    closing_sigma: Positive
    row_sigma_rad: Positive
    model_sigma: Positive


class HiddenSettings(Settings):
    """Section ``hidden``: things that stand on the ground and hide the road (:mod:`.upright`, :mod:`.hidden`)."""

    near_m: Positive
    far_m: Positive
    above_rad: Positive
    least_step_grey: Positive
    step_multiple: Positive
    vehicle_m: tuple[Positive, Positive]  # narrowest and widest thing in the lane
    lane_error_1pm: NonNegative
    other_sigmas: Positive
    beside_sigmas: Positive
    horizon_share: OpenShare
    beside_m: Positive
    bend_share: Share
    least_apart: Positive
    vehicle_sigma: Positive
    wall_sigma: Positive
    memory_s: Positive
    seen_share: Share


class GlareSettings(Settings):
    """Section ``glare``: a source of light that veils the image (:mod:`.glare`)."""

    least_source: Share  # of the image that is white
    darker_sky: Share  # of white, below which the darkest tenth of the sky lies


class SightSettings(Settings):
    """``config/sight.yaml``."""

    reach_m: Positive
    reach_sigma: Positive
    least_range_grey: Positive
    growth_1ps: Positive
    memory_s: Positive
    hold_s: Positive
    strip: StripSettings
    air: AirSettings
    glare: GlareSettings
    dark: DarkSettings
    crest: CrestSettings
    hidden: HiddenSettings
