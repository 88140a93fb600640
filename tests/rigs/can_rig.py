"""The CAN map and DBC of the shuttle for tests, on python-can's bus inside one process."""

import itertools
import shutil
from contextlib import suppress
from pathlib import Path

import can

from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Command, VehicleState
from vehicle.actuators.actuator import Car
from vehicle.actuators.can.actuator import CanActuator
from vehicle.actuators.can.quantities import of_command, of_state
from vehicle.actuators.can.settings import CanSettings
from vehicle.actuators.can.signal_map import load_map

FOLDER = CONFIG_DIR / "cars" / "shuttle" / "can"
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SHUTTLE = load_map(FOLDER / "map.yaml", VEHICLE)
RATIO = VEHICLE.steering_ratio
_channels = itertools.count()


def copy_map(folder: Path, **changes: str) -> Path:
    """The map of the shuttle in ``folder``, beside its DBC, with each key of ``changes`` replaced by its value."""
    shutil.copy(FOLDER / "shuttle.dbc", folder)
    text = (FOLDER / "map.yaml").read_text()
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new, 1)
    (folder / "map.yaml").write_text(text)
    return folder / "map.yaml"


def command(angle_rad=0.0, accel_mps2=0.0, speed_mps=5.0, t_s=1.0):
    return Command(t_s=t_s, road_wheel_angle_rad=angle_rad, speed_mps=speed_mps, accel_mps2=accel_mps2)


def state(angle_rad=0.0, speed_mps=0.0, yaw_rate_radps=0.0, *, override=False, torque_nm=0.0, t_s=0.0):
    return VehicleState(
        t_s=t_s,
        speed_mps=speed_mps,
        road_wheel_angle_rad=angle_rad,
        yaw_rate_radps=yaw_rate_radps,
        driver_override=override,
        driver_torque_nm=torque_nm,
    )


def report_quantities(state):
    """The quantities of ``state`` for the senders of reports."""
    return of_state(state, steering_ratio=RATIO)


def command_quantities(command):
    """The quantities of ``command`` for the senders of commands."""
    return of_command(command, engaged=command.t_s is not None, steering_ratio=RATIO)


class OneBus:
    """A CAN actuator and the other end of its bus."""

    def __init__(self, map_file=FOLDER / "map.yaml"):
        self.channel = channel = f"test {next(_channels)}"
        self.end = can.Bus(interface="virtual", channel=channel)
        settings = CanSettings(interface="virtual", channel=channel, map=map_file)
        self.actuator = CanActuator(settings, Car(VEHICLE, None, lambda: 0.0))

    def drain_frames(self):
        """The frames that the actuator has sent since the last call."""
        return list(iter(lambda: self.end.recv(timeout=0.0), None))

    def put(self, address, data):
        """A frame from the car."""
        self.end.send(can.Message(arbitration_id=address, data=data, is_extended_id=False))

    def report(self, state, senders):
        """The frames of ``state`` from the car."""
        for sender in senders:
            self.put(sender.address, sender.frame(report_quantities(state)))

    def close(self):
        with suppress(OSError):  # a test may have closed it
            self.actuator.close()
        self.end.shutdown()
