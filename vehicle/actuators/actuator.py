"""The interface of actuators. The limiter is always the last step before ``write``, in the same process."""

from typing import Protocol

from trepid.messages import Command, VehicleState


class Actuator(Protocol):
    """The wire to the steering, drive and brakes of one car."""

    def read(self, *, now_s: float) -> VehicleState | None:
        """The newest state that the car reports, with the time of its measurement; None before the first.

        Quantities that the car does not measure are None.
        """
        ...

    def write(self, command: Command, *, now_s: float) -> None:
        """Send ``command``, an output of the limiter: angle of the road wheels and acceleration.

        Raises OSError when the wire refuses it.
        """
        ...

    def close(self) -> None:
        """Bring the actuators to their safe state: no drive, wheel released to the driver or held straight."""
        ...
