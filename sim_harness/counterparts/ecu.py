"""A simulated ECU: the electronics of a car on a CAN bus, with the simulated car behind them.

It takes the command messages of the map of signals and sends its reports at their periods. Frames with a wrong
length, checksum or counter are refused. Without an accepted frame of every command message for ``silence_s``, or
when the sender is no longer engaged, the ECU goes to its safe state: no drive, the brake at ``safe_decel_mps2``,
the wheel held. The safe state ends at standstill, when engaged commands come again.
"""

from collections.abc import Iterable, Mapping

from sim_harness.counterparts.car import CarBehindWire, wire_settings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, Settings, load
from trepid.messages import Command, Health, VehicleState
from trepid.processes.process import Process, Ticker, process
from trepid.types import Positive
from vehicle.actuators.can.frames import Sender
from vehicle.actuators.can.quantities import of_state, to_command
from vehicle.actuators.can.settings import CanSettings
from vehicle.actuators.can.signal_map import SignalMap, load_map
from vehicle.actuators.can.wire import CanWire

EARLY = 0.5  # of a step: a report is sent in the step nearest to its time


class EcuSettings(Settings):
    """Options of the process."""

    silence_s: Positive = 0.08
    safe_decel_mps2: Positive = 3.5
    mute_after_s: Positive | None = None  # a fault: the reports end so long after the first engaged command


class Ecu:
    """Commands from frames, reports as frames. Pure: no bus, no clock."""

    def __init__(self, signals: SignalMap, settings: EcuSettings, vehicle: Vehicle) -> None:
        self._settings, self._ratio = settings, vehicle.steering_ratio
        self._standstill_mps = vehicle.standstill_mps
        self.receivers = [signals.receiver(each) for each in signals.settings.commands]
        self._heard_s: list[float | None] = [None] * len(self.receivers)
        self._quantities: dict[str, float] = {}
        self._has_engaged = any(
            each.quantity == "engaged" for mapped in signals.settings.commands for each in mapped.signals
        )
        self._reports = signals.settings.reports
        self._senders = [signals.sender(each) for each in self._reports]
        self._next_s = [0.0] * len(self._senders)
        self._held_rad = 0.0
        self._begun_s: float | None = None
        self.safe = ""
        """Why the ECU is in its safe state; empty while it follows commands."""

    def take(self, address: int, extended: bool, data: bytes, *, now_s: float) -> None:
        """Take a frame of the bus; other addresses, wrong checksums and wrong counters do not count."""
        for k, receiver in enumerate(self.receivers):
            if (receiver.address, receiver.extended) == (address, extended):
                found = receiver.quantities(data)
                if found is not None and not receiver.invalid:
                    self._quantities |= found
                    self._heard_s[k] = now_s

    def command(self, speed_mps: float, wheel_rad: float, *, now_s: float) -> Command | None:
        """The command that acts at this speed and wheel angle; None until the first engaged command."""
        fault = self._fault(now_s)
        if self._begun_s is None:
            if fault:
                return None
            self._begun_s = now_s
        if fault:
            self._held_rad = self._held_rad if self.safe else wheel_rad
            self.safe = fault
        elif speed_mps <= self._standstill_mps:
            self.safe = ""
        if self.safe:
            decel_mps2 = self._settings.safe_decel_mps2
            return Command(
                t_s=now_s, road_wheel_angle_rad=self._held_rad, speed_mps=0.0, accel_mps2=-decel_mps2
            )
        return to_command(self._quantities, steering_ratio=self._ratio, t_s=now_s)

    def _fault(self, now_s: float) -> str:
        """Why commands do not count now; empty when they do."""
        for receiver, heard_s in zip(self.receivers, self._heard_s, strict=True):
            if heard_s is None or now_s - heard_s > self._settings.silence_s:
                return f"no valid {receiver.name}"
        if self._has_engaged and not self._quantities["engaged"]:
            return "not engaged"
        return ""

    def reports(self, state: VehicleState, *, now_s: float, step_s: float) -> Iterable[tuple[Sender, bytes]]:
        """The reports of ``state`` that are due."""
        if self._is_mute(now_s):
            return
        quantities: Mapping[str, float] = of_state(state, steering_ratio=self._ratio)
        for k, sender in enumerate(self._senders):
            if now_s >= self._next_s[k] - EARLY * step_s:
                period_s = self._reports[k].period_s
                late = now_s - self._next_s[k] > period_s
                self._next_s[k] = (now_s if late else self._next_s[k]) + period_s
                yield sender, sender.frame(quantities)

    def _is_mute(self, now_s: float) -> bool:
        mute_after_s = self._settings.mute_after_s
        return mute_after_s is not None and self._begun_s is not None and now_s - self._begun_s > mute_after_s

    def refused_frames(self) -> dict[str, int]:
        """Number of refused frames by message and reason."""
        return {
            f"refused {receiver.name} {why}": count
            for receiver in self.receivers
            for why, count in receiver.refused.items()
        }


def run(me: Process) -> None:
    """The ECU and the car, in real time, on the bus of the block ``can`` in ``config/actuator.yaml``."""
    options = {field: me.options[field] for field in EcuSettings.model_fields if field in me.options}
    settings = wire_settings(me, CanSettings, "can")
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    signals = load_map(settings.map_file, vehicle)
    ecu = Ecu(signals, EcuSettings.model_validate(options), vehicle)
    car, wire = CarBehindWire(me), CanWire(settings, ecu.receivers)
    me.ready(values=lambda: tuple((name, str(count)) for name, count in ecu.refused_frames().items()))
    ticker, speed_mps, wheel_rad = Ticker(1 / car.settings.period_s), 0.0, 0.0
    try:
        while me.running():
            ticker.sleep()
            ticker.due()
            now_s = me.now_s()
            for address, extended, data in wire.frames():
                ecu.take(address, extended, data, now_s=now_s)
            released = car.release.is_granted()  # its faults count from then on
            command = ecu.command(speed_mps, wheel_rad, now_s=now_s) if released else None
            state = car.step(command, now_s=now_s)
            speed_mps, wheel_rad = abs(state.speed_mps or 0.0), state.road_wheel_angle_rad or 0.0
            for sender, frame in ecu.reports(state, now_s=now_s, step_s=car.settings.period_s):
                wire.send(sender, frame)
            if ecu.safe:
                me.count_step(Health.WARN, f"safe state: {ecu.safe}")
            else:
                me.count_step()
    finally:
        wire.close()


if __name__ == "__main__":
    with process() as me:
        run(me)
