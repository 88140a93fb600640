"""The stop button: a car that it stops stays stopped until the button is released.

While the car moves, the limiter stops it, and the controller still steers. At standstill driving is not permitted,
as without the dead man's switch. A request stays in force when its sender ends.
"""

from trepid.messages import Command, StopRequest, VehicleState

STOPPED = "stopped: STOP pressed; waits for a person to press Drive on"
"""Beginning of the message of the heartbeat while the button holds the car."""
OLDEST_S = 1.0  # an older release is not heard


class StopButton:
    """Call ``hear`` with every request, then ask ``held``, ``stops`` and ``permits``."""

    def __init__(self, standstill_mps: float) -> None:
        self._standstill_mps = standstill_mps
        self._stands = False
        self.held = False
        """The button holds the car."""

    def hear(self, request: StopRequest | None, state: VehicleState | None, *, now_s: float) -> None:
        """Note the newest ``request``, if there is a new one, and the newest ``state`` of the car.

        A stop counts always; a release at standstill, and when it is at most OLDEST_S old.
        """
        speed_mps = None if state is None else state.speed_mps
        self._stands = speed_mps is not None and abs(speed_mps) <= self._standstill_mps
        if request is None:
            return
        if request.stop:
            self.held = True
        elif self._stands and abs(now_s - request.t_s) <= OLDEST_S:
            self.held = False

    @property
    def stops(self) -> bool:
        """The limiter is to stop the car now."""
        return self.held and not self._stands

    def permit(self, command: Command | None) -> Command | None:
        """``command``; None while the car stands and the button holds it, which lets the limiter hold the brake."""
        return None if self.held and self._stands else command
