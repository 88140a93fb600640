"""Faults of a run and their times: of the camera, the processes, the estimators and the sensors of the car."""

import math
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from sim_harness.scenarios.measurements import WrongMeasurement
from sim_harness.scenarios.span import Span
from trepid.car.vehicle import road_wheel_angle
from trepid.clothoid import Lane
from trepid.messages import EstimateKind, SteeringEstimate
from trepid.types import Positive, Share


class FrozenCamera(Span):
    """The camera repeats its last image with fresh time stamps."""

    kind: Literal["frozen_camera"]


class BlackFrames(Span):
    """The camera sends black images."""

    kind: Literal["black_frames"]


class LateFrames(Span):
    """Frames arrive ``delay_s`` after their capture, rounded up to whole frames, with their true time stamps."""

    kind: Literal["late_frames"]
    delay_s: Positive


class LostProcess(Span):
    """A process publishes nothing. Afterwards it continues with its old state, as after SIGSTOP and SIGCONT."""

    kind: Literal["lost_process"]
    process: str  # "camera", "supervisor", "controller" or the name of an estimator


class EstimatorBias(Span):
    """An estimator reports a wrong lane, or the angle of that lane, with its usual confidence or `confidence`.

    Estimates without a lane or angle stay as they are. With one such fault for each estimator both are wrong alike.
    """

    kind: Literal["estimator_bias"]
    estimator: str
    lateral_m: float = 0.0  # added to the lateral offset of the car in the lane
    heading_rad: float = 0.0  # ... to its heading error
    curvature_1pm: float = 0.0  # ... to the curvature of the lane
    confidence: Share | None = None  # instead of its own

    @model_validator(mode="after")
    def _changes_something(self) -> Self:
        if not (self.lateral_m or self.heading_rad or self.curvature_1pm or self.confidence is not None):
            raise ValueError("changes nothing; give lateral_m, heading_rad, curvature_1pm or confidence")
        return self

    def falsify(self, estimate: SteeringEstimate, *, wheelbase_m: float) -> SteeringEstimate:
        """The estimate that is published instead of ``estimate``."""
        confidence = estimate.confidence if self.confidence is None else self.confidence
        if estimate.kind is EstimateKind.ANGLE:
            return self._with_wrong_angle(estimate, confidence, wheelbase_m)
        offset_m, heading_rad = estimate.lateral_offset_m, estimate.heading_error_rad
        curvature_1pm = estimate.curvature_1pm
        if offset_m is None or heading_rad is None or curvature_1pm is None:
            return estimate
        return replace(
            estimate,
            lateral_offset_m=offset_m + self.lateral_m,
            heading_error_rad=heading_rad + self.heading_rad,
            curvature_1pm=curvature_1pm + self.curvature_1pm,
            confidence=confidence,
        )

    def _with_wrong_angle(
        self, estimate: SteeringEstimate, confidence: float, wheelbase_m: float
    ) -> SteeringEstimate:
        """δ' = atan(tan δ + L·Δκ), where Δκ is the pursuit curvature of the added lane at the look-ahead."""
        angle_rad = estimate.road_wheel_angle_rad
        if angle_rad is None:
            return estimate
        added = Lane(self.lateral_m, self.heading_rad, self.curvature_1pm, 0.0)
        wrong_1pm = math.tan(angle_rad) / wheelbase_m + added.pursuit_curvature(estimate.lookahead_m)
        wrong_rad = road_wheel_angle(wrong_1pm, wheelbase_m=wheelbase_m)
        return replace(estimate, road_wheel_angle_rad=wrong_rad, confidence=confidence)


class LostLane(Span):
    """An estimator reports that it finds no lane."""

    kind: Literal["lost_lane"]
    estimator: str | None = None  # default: all of them

    def falsify(self, estimate: SteeringEstimate, *, wheelbase_m: float) -> SteeringEstimate:
        """The estimate that is published instead of ``estimate``."""
        name, ahead_m = estimate.estimator, estimate.lookahead_m
        return SteeringEstimate.nothing(
            estimate.t_s, estimator=name, lookahead_m=ahead_m, reason="lost lane", kind=estimate.kind
        )


Fault = Annotated[
    FrozenCamera | BlackFrames | LateFrames | LostProcess | EstimatorBias | LostLane | WrongMeasurement,
    Field(discriminator="kind"),
]
