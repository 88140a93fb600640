"""Faults of a run and their times: of the camera, the processes, the estimators and the sensors of the car."""

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from trepid.car.vehicle import road_wheel_angle
from trepid.clothoid import Lane
from trepid.config import Settings
from trepid.messages import EstimateKind, SteeringEstimate, VehicleState
from trepid.types import NonNegative, Positive, Share

Quantity = Literal["speed", "wheel_angle", "yaw_rate"]
Form = Literal["absent", "stuck", "offset", "sign", "factor", "spike", "swapped"]
FIELDS: dict[str, str] = {
    "speed": "speed_mps",
    "wheel_angle": "road_wheel_angle_rad",
    "yaw_rate": "yaw_rate_radps",
}
SPIKE_S = 0.02  # of each spike
SPIKE_EVERY_S = 1.0


class Span(Settings):
    """A time interval from the start of the run; without `to_s` it lasts to the end."""

    from_s: NonNegative
    to_s: Positive | None = None

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s {self.to_s:g} must be after from_s {self.from_s:g}")
        return self

    def active(self, elapsed_s: float) -> bool:
        """True within the interval."""
        return self.from_s <= elapsed_s and (self.to_s is None or elapsed_s < self.to_s)


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


class WrongMeasurement(Span):
    """A sensor of the car reports a wrong value, or calls its value invalid.

    ``absent``: "signal not available". ``stuck``: the value at the begin. ``offset``: plus ``by`` [SI].
    ``sign``: its negative. ``factor``: times ``by``, such as 3.6 for km/h taken as m/s. ``spike``: plus ``by`` for
    ``SPIKE_S`` every ``SPIKE_EVERY_S``. ``swapped``: the value of ``other``, whose sensor reports this one's.
    """

    kind: Literal["wrong_measurement"]
    quantity: Quantity
    form: Form
    by: float | None = None
    other: Quantity | None = None

    @model_validator(mode="after")
    def _complete(self) -> Self:
        if (self.form in ("offset", "factor", "spike")) != (self.by is not None):
            raise ValueError("by: is for offset, factor and spike, and they need it")
        if (self.form == "swapped") != (self.other is not None) or self.other == self.quantity:
            raise ValueError("other: is another quantity for swapped, which needs it")
        return self


Fault = Annotated[
    FrozenCamera | BlackFrames | LateFrames | LostProcess | EstimatorBias | LostLane | WrongMeasurement,
    Field(discriminator="kind"),
]


class Sensors:
    """The sensors of one car under the faults of its scenario. Call ``step`` with every state, in order."""

    def __init__(self, faults: Iterable[object]) -> None:
        self._faults = [fault for fault in faults if isinstance(fault, WrongMeasurement)]
        self._stuck: dict[int, float | None] = {}  # number of the fault -> value at its begin

    def step(self, state: VehicleState, *, elapsed_s: float) -> VehicleState:
        """``state`` as the sensors report it. A value that they call invalid is absent, and doubted."""
        for number, fault in enumerate(self._faults):
            if not fault.active(elapsed_s):
                self._stuck.pop(number, None)
                continue
            field = FIELDS[fault.quantity]
            value = getattr(state, field)
            changes: dict[str, float | None] = {field: self._wrong(number, fault, value, elapsed_s)}
            if fault.other is not None:
                other = FIELDS[fault.other]
                changes = {field: getattr(state, other), other: value}
            if fault.form == "absent":
                state = replace(state, doubted=tuple(sorted({*state.doubted, field})))
            state = replace(state, **changes)  # type: ignore[arg-type]
        return state

    def _wrong(
        self, number: int, fault: WrongMeasurement, value: float | None, elapsed_s: float
    ) -> float | None:
        """The value that is reported instead of ``value``."""
        if value is None or fault.form == "absent":
            return None
        by = fault.by or 0.0
        spikes = (elapsed_s - fault.from_s) % SPIKE_EVERY_S < SPIKE_S
        wrong = {
            "stuck": self._stuck.setdefault(number, value),
            "offset": value + by,
            "sign": -value,
            "factor": value * by,
            "spike": value + by if spikes else value,
        }
        return wrong.get(fault.form, value)
