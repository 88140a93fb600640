"""The whole drive through an Ackermann driver on the bus: camera to simulated driver, over real processes."""

import pytest
from wire_drive_rig import WireDrive

pytestmark = pytest.mark.processes
PROCESSES = """\
  vehicle: {module: vehicle.actuators.node, publishes: [vehicle/state, actuator/command]}
  driver:
    module: sim_harness.counterparts.ackermann_driver
    publishes: [sim/truth, actuator/state]
    restart: never
"""


@pytest.fixture
def drive_of(tmp_path):
    made = []

    def make(state, wheel_angle):
        block = f"ackermann: {{state: {state}, wheel_angle: {wheel_angle}}}"
        actuator = f"actuator: ackermann\n{block}\n"
        made.append(WireDrive(tmp_path / "car", actuator=actuator, processes=PROCESSES))
        return made[-1]

    yield make
    for drive in made:
        drive.close()


@pytest.mark.parametrize(("state", "wheel_angle"), [("vehicle_state", "reported"), ("odometry", "commanded")])
def test_the_main_job_drives_through_an_ackermann_driver(drive_of, state, wheel_angle):
    returncode, row, _ = drive_of(state, wheel_angle).start(18).ended()
    assert (returncode, row["status"], row["reasons"]) == (0, "passed", [])
    assert row["departures"] == row["interventions"] == 0
    assert row["distance_m"] > 30
