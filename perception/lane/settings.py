"""Settings of the lane estimator: ``config/perception.yaml``."""

from typing import Annotated, ClassVar

from pydantic import Field

from perception.camera.settings import SelfCalibrationSettings
from perception.lane.camera_check import CameraCheckSettings
from perception.lane.detection.edges import EdgeSettings
from perception.lane.detection.points import MarkingSettings
from perception.lane.detection.vote import VoteSettings
from perception.lane.model.evidence import EvidenceSettings
from perception.lane.model.fit import FitSettings
from perception.lane.model.prediction import TrackSettings
from perception.lane.model.prior import PriorSettings
from perception.lane.street.settings import StreetSettings
from trepid.config import CONFIG_DIR, Settings, load
from trepid.types import NonNegative, Positive, Share


class VoteStages(Settings):
    """Section ``vote``: the lane shapes of a search with and without a prediction."""

    cold: VoteSettings
    refine: VoteSettings
    tracked: VoteSettings
    prior_weight: Positive
    min_support: Positive


class ConfidenceSettings(Settings):
    """Section ``confidence``: weights of the logistic regression of the probability (:mod:`.rating`)."""

    bias: float
    support: float
    plausible: float
    tight: float
    sure: float
    one_line: float
    by_edges: float
    looks: float
    askew: float
    bend: float
    bent_edges: float
    apart: float


class SteeringSettings(Settings):
    """Section ``steering`` of ``config/perception.yaml``: what all estimators share."""

    lookahead_m: Positive
    min_confidence: Share


class UnknownCameraSettings(Settings):
    """Section ``unknown_camera``: lanes without a camera file (:mod:`.unknown_camera`)."""

    open_mind: Positive
    edge_weight: Share
    uneven_free: float
    uneven_weight: NonNegative
    divided_excess: Positive
    change_margin: Share
    steady_every: Annotated[int, Field(ge=1)]
    width_looks: Annotated[int, Field(ge=1)]


class LaneCvSettings(Settings):
    """``config/perception.yaml``. Limits of the score and of the probability are separate fields."""

    former_names: ClassVar = {
        "min_confidence": ("min_score", "min_probability"),
        "enough_confidence": ("enough_score",),
        "good_confidence": ("good_score", "good_probability"),
        "sure_confidence": ("sure_probability",),
    }

    working_width_px: Annotated[int, Field(ge=64, le=1280)]
    reach_m: Positive
    drawn_reach_m: Positive
    drawn_step_px: Annotated[int, Field(ge=1)]
    band_m: Positive
    max_band_px: Annotated[int, Field(ge=1)]
    min_score: Share
    enough_score: Share
    good_score: Share
    min_probability: Share
    good_probability: Share
    sure_probability: Share
    markings: MarkingSettings
    fit: FitSettings
    edge_fit: FitSettings
    vote: VoteStages
    prior: PriorSettings
    track: TrackSettings
    evidence: EvidenceSettings
    confidence: ConfidenceSettings
    steering: SteeringSettings
    self_calibration: SelfCalibrationSettings
    unknown_camera: UnknownCameraSettings
    street: StreetSettings
    camera_check: CameraCheckSettings
    edges: EdgeSettings


def steering_settings() -> SteeringSettings:
    """The section ``steering`` of ``config/perception.yaml``. Raises InputError."""
    return load(CONFIG_DIR / "perception.yaml", LaneCvSettings).steering
