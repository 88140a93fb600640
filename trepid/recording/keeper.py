"""The ring of a drive and the events that keep it: an intervention of the driver or referee, an emergency stop."""

from collections.abc import Callable, Mapping

from trepid.config import InputError
from trepid.messages import Decision, SimTruth, Stop, VehicleState
from trepid.processes.drive_settings import RingSettings
from trepid.processes.process import Process
from trepid.recording.ring import MB, Ring, keep_apart, kept_name, kept_size
from trepid.recording.writer import RECORDED
from trepid.topics import DECISION, SIM_TRUTH, VEHICLE_STATE

EMERGENCY, INTERVENTION = "emergency-stop", "intervention"
ENDING_S = 2.0
"""An emergency stop so short before the end of the recorder is that of the end of the drive, at which the process
next to the actuator ends first."""


class Events:
    """Finds the beginning of each event in the newest messages."""

    def __init__(self) -> None:
        self._stops = self._overrides = True  # what is so at the beginning is no event
        self._interventions: int | None = None

    def step(
        self, decision: Decision | None, state: VehicleState | None, truth: SimTruth | None
    ) -> str | None:
        """Name of an event that began since the last call; None without one."""
        found = None
        if decision is not None:
            found = EMERGENCY if decision.stop is Stop.EMERGENCY and not self._stops else found
            self._stops = decision.stop is Stop.EMERGENCY
        if state is not None:
            person = state.driver_override or state.stop_pressed
            found = INTERVENTION if person and not self._overrides else found
            self._overrides = person
        if truth is not None:
            before, self._interventions = self._interventions, truth.interventions
            found = INTERVENTION if before is not None and truth.interventions > before else found
        return found


class Keeper:
    """Writes the ring of a drive and keeps it ``after_s`` after an event. A disk that refuses ends the ring."""

    def __init__(
        self,
        me: Process,
        ring: str,
        settings: RingSettings,
        files: Mapping[str, bytes],
        notes: Mapping[str, str],
    ) -> None:
        """``ring``: name of the ring of the drive."""
        self._me, self._settings = me, settings
        self.problem = ""
        """Why the ring is not written, or an event was not kept; "" while all is well."""
        self._events, self._event_s, self._due_s, self._reason = Events(), float("inf"), float("inf"), ""
        bus = me.bus
        self._decision = bus.latest(DECISION, wakes=False)
        self._state = bus.latest(VEHICLE_STATE, wakes=False)
        self._truth = bus.latest(SIM_TRUTH, wakes=False)
        self._ring: Ring | None = None
        try:
            self._ring = Ring(bus.tap(*RECORDED), ring, settings, files, notes)
        except InputError as error:
            self.problem = f"the last minutes are not recorded: {error}"

    def began_ns(self, stamp_ns: int) -> None:
        """Note the start of the drive."""
        self._attempt(lambda ring: ring.began_ns(stamp_ns))

    def turn(self) -> None:
        """Write what has come, and keep the ring when it is due."""
        self._attempt(Ring.write)
        event = self._events.step(self._decision.refresh(), self._state.refresh(), self._truth.refresh())
        now_s = self._me.now_s()
        if event is not None and not self._reason:
            self._reason, self._event_s, self._due_s = event, now_s, now_s + self._settings.after_s
        if now_s >= self._due_s:
            self._keep(now_s)

    def close(self) -> None:
        """Write the rest and keep the ring if an event before the end of the drive asks for it."""
        self._attempt(Ring.write)
        self._attempt(Ring.close)
        now_s = self._me.now_s()
        ends = self._reason == EMERGENCY and now_s - self._event_s < ENDING_S
        if self._reason and not ends:
            self._keep(now_s)

    def _keep(self, now_s: float) -> None:
        reason, self._reason, self._due_s = self._reason, "", float("inf")
        if kept_size() > MB * self._settings.max_kept_mb:
            self.problem = (
                f"the {reason} is not kept: more than {self._settings.max_kept_mb:g} MB are kept already"
            )
        else:
            self._attempt(lambda ring: keep_apart(ring.folder, kept_name(reason, now_s=now_s)))

    def _attempt(self, act: Callable[[Ring], None]) -> None:
        if self._ring is None:
            return
        try:
            act(self._ring)
        except InputError as error:
            self.problem = f"the last minutes are not recorded any more: {error}"
            self._ring = None
