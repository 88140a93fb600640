"""The simulated car of a counterpart: commands from a wire in, the measured state out; the truth on the bus.

The limiter stands at the other end of the wire, so commands take effect as they arrive.
"""

from typing import TypeVar

from sim_harness.live.release import Release
from sim_harness.lockstep.road_user_sensor import build_road_user_sensor
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.scenario import LeadSensor, Scenario
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, Settings, load
from trepid.messages import Command, VehicleState
from trepid.processes.process import Process, Ticker
from trepid.topics import LEAD_VEHICLE, ROAD_USERS, SIM_TRUTH
from vehicle.actuators.table import configured_actuator

S = TypeVar("S", bound=Settings)


def wire_settings(me: Process, kind: type[S], actuator: str) -> S:
    """The settings of the configured actuator, the other end of the wire.

    Raises InputError when ``config/actuator.yaml`` names an actuator other than ``actuator``.
    """
    name, settings = configured_actuator()
    if not isinstance(settings, kind):
        raise InputError(
            f"process {me.name} simulates the other end of the actuator {actuator!r}, but actuator.yaml names "
            f"{name!r}; set actuator: {actuator}, or remove the process from processes.yaml"
        )
    return settings


class CarBehindWire:
    """The simulated car of the drive of a process; its options are ``scenario`` and ``seed``.

    Raises InputError without a scenario: a counterpart belongs to simulated drives only.
    """

    def __init__(self, me: Process) -> None:
        if me.options.get("scenario") is None:
            raise InputError(f"process {me.name} simulates a car and needs a scenario; a real car has none")
        scenario = Scenario.model_validate(me.options["scenario"])
        self.settings, self.vehicle = load_simulator(), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
        seed = me.options.get("seed", 0)
        self._simulated = SimulatedVehicle(
            scenario, scenario.build_road(), self.vehicle, None, self.settings, seed=seed
        )
        self._send_truth, self._send_lead = me.bus.publisher(SIM_TRUTH), me.bus.publisher(LEAD_VEHICLE)
        self.release = Release(me)
        """When the car may move."""
        self._send_users = me.bus.publisher(ROAD_USERS)
        self._publishes_lead = scenario.leads_by is LeadSensor.TRUTH
        self._user_sensor = build_road_user_sensor(scenario.road_users_by, seed=seed)
        self._sensor_ticker = Ticker(LEAD_VEHICLE.rate_hz)

    def step(self, command: Command | None, *, now_s: float) -> VehicleState:
        """Advance to ``now_s``, then apply ``command``; the measured state.

        The run begins with the first command after the release by the launcher; until then the car stands at the
        start of the scenario.
        """
        if not self.release.is_granted() or command is None:
            state, truth = self._simulated.wait(now_s=now_s)
        else:
            state, truth = self._simulated.step(command, now_s, now_s=now_s)
        self._send_truth(truth)
        if self._sensor_ticker.due():
            self._sense()
        return state

    def _sense(self) -> None:
        """Publish the vehicle ahead and the road users, where the scenario has the simulated car give them."""
        lead = self._simulated.sense_lead() if self._publishes_lead else None
        if lead is not None:
            self._send_lead(lead)
        users = self._user_sensor.step(self._simulated) if self._user_sensor else None
        if users is not None:
            self._send_users(users)
