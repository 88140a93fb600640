"""What every lateral law is given and gives: the car when its command begins to act, to a path curvature."""

from typing import NamedTuple, Protocol

from trepid.clothoid import Lane


class Acting(NamedTuple):
    """The car and the lane at the moment at which a command given now begins to act.

    A law that starts from here has no dead time left to think of, only the lag of the steering and of the tyres.
    """

    lane: Lane  # its heading is that of the course of the rear axle, drift of the tyres included
    speed_mps: float
    wheel_rad: float  # predicted road-wheel angle
    curvature_1pm: float  # that the path of the rear axle then has, ...
    steady_1pm: float  # ... and that it goes towards while the wheel stays
    seen: Lane  # the lane at the last vehicle state, for laws that do not predict


class LateralLaw(Protocol):
    """Lane to path curvature; the controller adds understeer and the limits of the wheel."""

    def curvature(self, at: Acting, *, dt_s: float) -> float:
        """Path curvature κ_cmd [1/m] to be asked of the vehicle; finite. ``dt_s`` since the last call, or 0."""
        ...

    def release(self) -> None:
        """Forget what was integrated: a driver steers, or there is no path."""
        ...
