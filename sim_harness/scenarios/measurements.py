"""Faults of the measurements of a run: what sensors report instead of speed, wheel angle and yaw rate."""

from collections.abc import Iterable
from dataclasses import replace
from typing import Literal, Self

from pydantic import model_validator

from sim_harness.scenarios.span import Span
from trepid.messages import VehicleState

Quantity = Literal["speed", "wheel_angle", "yaw_rate"]
Form = Literal["absent", "stuck", "offset", "sign", "factor", "spike", "swapped"]
FIELDS: dict[str, str] = {
    "speed": "speed_mps",
    "wheel_angle": "road_wheel_angle_rad",
    "yaw_rate": "yaw_rate_radps",
}
SPIKE_S = 0.02  # of each spike
SPIKE_EVERY_S = 1.0


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
