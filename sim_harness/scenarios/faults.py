"""What goes wrong in a run, and when: the camera, the processes, the estimators."""

from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from trepid.config import Settings
from trepid.messages import SteeringEstimate
from trepid.types import NonNegative, Positive, Share


class Span(Settings):
    """A stretch of time, from the start of the run; without an end it lasts."""

    from_s: NonNegative
    to_s: Positive | None = None

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s {self.to_s:g} must be after from_s {self.from_s:g}")
        return self

    def active(self, elapsed_s: float) -> bool:
        """True within the span."""
        return self.from_s <= elapsed_s and (self.to_s is None or elapsed_s < self.to_s)


class FrozenCamera(Span):
    """The camera repeats its last image with fresh time stamps."""

    kind: Literal["frozen_camera"]


class BlackFrames(Span):
    """The camera sends black images."""

    kind: Literal["black_frames"]


class LateFrames(Span):
    """Frames arrive ``delay_s`` after their capture, rounded up to whole frames, with honest time stamps."""

    kind: Literal["late_frames"]
    delay_s: Positive


class LostProcess(Span):
    """A process is gone: it publishes nothing. Afterwards it goes on where it was, as after SIGSTOP, SIGCONT."""

    kind: Literal["lost_process"]
    process: str  # "camera", "supervisor", "controller" or the name of an estimator


class EstimatorBias(Span):
    """An estimator sees another lane than there is, and is as sure as ever, or as sure as ``confidence``.

    It lies only about a lane that it sees. Two of these, one for each estimator, are wrong the same way.
    """

    kind: Literal["estimator_bias"]
    estimator: str
    lateral_m: float = 0.0  # added to the lateral offset of the car in the lane
    heading_rad: float = 0.0  # ... to its heading error
    curvature_1pm: float = 0.0  # ... to the curvature of the lane
    confidence: Share | None = None  # claimed instead of its own

    @model_validator(mode="after")
    def _lies(self) -> Self:
        if not (self.lateral_m or self.heading_rad or self.curvature_1pm or self.confidence is not None):
            raise ValueError("changes nothing; give lateral_m, heading_rad, curvature_1pm or confidence")
        return self

    def told(self, estimate: SteeringEstimate) -> SteeringEstimate:
        """What the estimator says instead of ``estimate``."""
        offset_m, heading_rad = estimate.lateral_offset_m, estimate.heading_error_rad
        curvature_1pm = estimate.curvature_1pm
        if offset_m is None or heading_rad is None or curvature_1pm is None:
            return estimate
        return replace(
            estimate,
            lateral_offset_m=offset_m + self.lateral_m,
            heading_error_rad=heading_rad + self.heading_rad,
            curvature_1pm=curvature_1pm + self.curvature_1pm,
            confidence=estimate.confidence if self.confidence is None else self.confidence,
        )


class LostLane(Span):
    """An estimator sees no lane, and says so: as under snow, or where the paint ends and the light is bad."""

    kind: Literal["lost_lane"]
    estimator: str | None = None  # default: all of them

    def told(self, estimate: SteeringEstimate) -> SteeringEstimate:
        """What the estimator says instead of ``estimate``."""
        name, ahead_m = estimate.estimator, estimate.lookahead_m
        return SteeringEstimate.nothing(
            estimate.t_s, estimator=name, lookahead_m=ahead_m, reason="lost lane", kind=estimate.kind
        )


Fault = Annotated[
    FrozenCamera | BlackFrames | LateFrames | LostProcess | EstimatorBias | LostLane,
    Field(discriminator="kind"),
]
