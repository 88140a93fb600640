"""The interface of actuators. The limiter is always the last step before ``write``, in the same process."""

from typing import NamedTuple, Protocol

from trepid import config
from trepid.bus import Bus
from trepid.car.vehicle import Vehicle
from trepid.clock import Clock
from trepid.messages import Command, VehicleState

INVALID = "invalid "
"""Begins the name of a value of the heartbeat that gives the reason for which a quantity is no measurement."""


class Car(NamedTuple):
    """What an actuator may use besides its settings."""

    vehicle: Vehicle
    bus: Bus | None  # None: without the other processes, as in `trepid doctor`
    now_s: Clock  # of the drive


class Actuator(Protocol):
    """The wire to the steering, drive and brakes of one car."""

    def read(self, *, now_s: float) -> VehicleState | None:
        """The newest state that the car reports, with the time of its measurement.

        None before the first, and while the car is silent for longer than it may be. Quantities that the car does
        not measure are None. An attribute ``computed`` of the actuator, a set of fields of the state, names those
        that no sensor measures, such as the speed by a throttle table: physics cannot contradict them. Raises
        OSError when the wire fails.
        """
        ...

    def write(self, command: Command, *, now_s: float) -> None:
        """Send ``command``, an output of the limiter: angle of the road wheels and acceleration.

        ``t_s`` is None before the first command that is based on a frame. Raises OSError when the wire refuses it.
        """
        ...

    def values(self) -> tuple[tuple[str, str], ...]:
        """Names and values for the heartbeat, such as counts of refused frames; empty without any.

        A name that begins with ``INVALID`` gives the reason for which a quantity is absent, and is in the message.
        """
        ...

    def close(self) -> None:
        """Bring the actuators to their safe state: no drive, wheel released to the driver or held.

        Raises OSError when the wire refuses it.
        """
        ...


class ActuatorKind(Protocol):
    """A class of actuators: what the table and the entry points of ``trepid.actuators`` name."""

    Settings: type[config.Settings]
    """Of the block of ``config/actuator.yaml`` that has the name of the actuator."""

    def __call__(self, settings: config.Settings, car: Car) -> Actuator:
        """Open the wire. Raises InputError with one line for the user when the settings do not fit it."""
        ...
