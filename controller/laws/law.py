"""Input and interface of the lateral laws."""

from typing import NamedTuple, Protocol

from trepid.clothoid import Lane


class Acting(NamedTuple):
    """The car and the lane at the moment at which a command given now begins to act.

    From there on the plant has no dead time, only the lags of steering and tyres.
    """

    lane: Lane  # heading of the course of the rear axle: drift of the tyres included
    speed_mps: float
    wheel_rad: float  # predicted road-wheel angle
    curvature_1pm: float  # of the path of the rear axle ...
    steady_1pm: float  # ... and of the steady turn at the wheel angle
    seen: Lane  # the lane at the last vehicle state, for laws that do not predict


class LateralLaw(Protocol):
    """Lane to path curvature; the controller adds understeer and the limits of the wheel."""

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """Demanded path curvature κ_cmd [1/m], finite. ``dt_s``: since the last call, or 0."""
        ...

    def release(self) -> None:
        """Reset the state of the law, if it has one: a driver steers, or there is no path."""
        return
