"""Settings of the choice between the lanes of a street: section ``street`` of ``config/perception.yaml``."""

from typing import Annotated

from pydantic import Field

from trepid.config import Settings
from trepid.types import NonNegative, Positive, Share


class CourseSigma(Settings):
    """Standard deviations of a course around the one expected; ``horizon`` in widths of the image."""

    heading_rad: Positive
    curvature_1pm: Positive
    horizon: Positive


class SearchSettings(Settings):
    """Section ``street.search``: courses, and the profile along one."""

    reach_m: Positive
    half_range_m: Positive
    step_m: Positive
    heading_range_rad: Positive
    heading_steps: Annotated[int, Field(ge=1)]
    curvature_range_1pm: Positive
    curvature_steps: Annotated[int, Field(ge=1)]
    horizon_step: Positive
    horizon_steps: Annotated[int, Field(ge=1)]
    any_course: CourseSigma
    same_course: CourseSigma
    course_weight: NonNegative
    step_weight: NonNegative
    step_chance: NonNegative
    step_window_m: Positive
    min_step_grey: Positive
    step_sigma: Positive
    patch_half_width_m: Positive
    yellow_b: Positive
    gate_m: Positive
    gate_growth: NonNegative
    clear_step: Share
    step_sigma_m: Positive


class PairSettings(Settings):
    """Section ``street.pairs``: boundaries, and the pairs of them that can be a lane."""

    min_line: Share
    full_line: Positive
    min_step: Share
    full_step: Positive
    step_trust: Share
    apart_m: Positive
    width_m: Positive
    width_sigma_m: Positive
    kerb_width_sigma_m: Positive
    road_width_m: Positive
    road_width_sigma_m: Positive
    both_ways_m: Positive
    both_ways_sigma_m: Positive
    offset_sigma_m: Positive
    margin_m: NonNegative
    line_within: NonNegative
    step_within: NonNegative
    other_within: NonNegative
    wrong_side: Positive
    kerbs_only: Positive
    none: Positive
    evidence_of_frame: Positive
    forget: Positive
    same_place_m: Positive
    other_road: Share
    traffic_log_odds: Positive
    max_traffic_log_odds: Positive


class SearchedWeights(Settings):
    """Section ``street.searched``: of the lane of the search between heights (:mod:`.rating`)."""

    bias: float
    probability: float
    marked: float
    offset: float
    same: float
    other: float
    shown: float
    rough: float
    inside: float
    along: float


class StreetWeights(Settings):
    """Section ``street.pair``: of the pair of a street (:mod:`.rating`)."""

    bias: float
    probability: float
    steps: float
    uneven: float
    offset: float
    same: float
    other: float
    shown: float
    along: float


class StreetSettings(Settings):
    """Section ``street`` of ``config/perception.yaml``."""

    day_grey: Positive
    max_gain: Positive
    search: SearchSettings
    pairs: PairSettings
    bounded: Share
    searched: SearchedWeights
    pair: StreetWeights
