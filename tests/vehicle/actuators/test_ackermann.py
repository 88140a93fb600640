"""The Ackermann actuator over a real bus, against the driver's end of the topics."""

import can_rig
import pytest
from process_rig import until

from sim_harness.counterparts.ackermann_driver import QUICKEST_MPS2, SAFE_DECEL_MPS2, motion_of
from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock
from trepid.messages import Command, Odometry, VehicleState
from trepid.topics import Topic
from trepid.wire import from_cdr, ros_name, to_cdr
from vehicle.actuators.ackermann import AckermannActuator, AckermannSettings, of_standard
from vehicle.actuators.actuator import Car

CLOCK = epoch_clock(0)
NEVER_S = 1e6


def settings(**changes):
    base = dict(command_topic="actuator/command", state_topic="actuator/state", state="vehicle_state")
    further = dict(wheel_angle="reported", timeout_s=NEVER_S, acceleration="magnitude", safe_decel_mps2=3.0)
    return AckermannSettings.model_validate(base | further | changes)


@pytest.fixture
def buses():
    endpoint = free_endpoint()
    with open_bus("v", CLOCK, listen=endpoint) as ours, open_bus("v", CLOCK, connect=endpoint) as theirs:
        yield ours, theirs


def actuator_on(bus, **changes):
    return AckermannActuator(settings(**changes), Car(can_rig.VEHICLE, bus, CLOCK))


def test_commands_travel_as_ackermann_drive_stamped_and_the_state_comes_back(buses):
    ours, theirs = buses
    actuator = actuator_on(ours)
    commands = theirs.latest(Topic("actuator/command", Command, 100))
    report = theirs.publisher(Topic("actuator/state", VehicleState, 100))
    assert ros_name(Command) == "ackermann_msgs/msg/AckermannDriveStamped"

    def has_exchanged():
        actuator.write(can_rig.command(0.2, 1.0, t_s=5.0), now_s=CLOCK())
        report(can_rig.state(0.1, 3.0, override=True, t_s=4.0))
        return commands.refresh() and actuator.read(now_s=CLOCK())

    assert until(has_exchanged, patience_s=20)
    arrived = commands.message
    assert (arrived.t_s, arrived.road_wheel_angle_rad, arrived.accel_mps2) == pytest.approx((5.0, 0.2, 1.0))
    state = actuator.read(now_s=CLOCK())
    assert (state.t_s, state.speed_mps, state.road_wheel_angle_rad, state.driver_override) == (
        4.0,
        3.0,
        0.1,
        True,
    )
    assert actuator.read(now_s=CLOCK() + 2 * NEVER_S) is None  # the driver is silent


def test_an_odometry_gives_speed_and_yaw_rate_and_the_angle_is_that_of_the_last_command(buses):
    ours, theirs = buses
    actuator = actuator_on(ours, state="odometry", wheel_angle="commanded")
    report = theirs.publisher(Topic("actuator/state", Odometry, 100))

    def has_reported(speed_mps):
        report(Odometry(t_s=4.0, speed_mps=speed_mps, yaw_rate_radps=-0.3))
        state = actuator.read(now_s=CLOCK())
        return state and state.speed_mps == speed_mps

    assert until(lambda: has_reported(0.0), patience_s=20)
    assert actuator.read(now_s=CLOCK()).road_wheel_angle_rad == 0.0
    assert until(lambda: has_reported(2.5), patience_s=20)
    assert actuator.read(now_s=CLOCK()).road_wheel_angle_rad is None  # of a car that rolls it is not known
    actuator.write(can_rig.command(0.2), now_s=CLOCK())
    state = actuator.read(now_s=CLOCK())
    assert (state.speed_mps, state.yaw_rate_radps, state.road_wheel_angle_rad) == (2.5, -0.3, 0.2)


def test_before_the_first_report_there_is_no_state(buses):
    assert actuator_on(buses[0]).read(now_s=CLOCK()) is None


def test_the_end_before_the_first_command_is_silent(buses):
    sent = []
    actuator = actuator_on(buses[0])
    actuator._send = sent.append
    actuator.close()
    assert sent == []


@pytest.mark.parametrize(("acceleration", "sent_mps2"), [("magnitude", 3.0), ("signed", -3.0)])
def test_the_end_is_a_brake_to_a_stand_that_is_based_on_no_frame(buses, acceleration, sent_mps2):
    sent = []
    actuator = actuator_on(buses[0], acceleration=acceleration)
    actuator._send = sent.append
    actuator.write(can_rig.command(0.2, 1.0), now_s=CLOCK())
    actuator.close()
    assert (sent[-1].t_s, sent[-1].speed_mps, sent[-1].accel_mps2) == (None, 0.0, sent_mps2)
    assert sent[-1].road_wheel_angle_rad == 0.2


@pytest.mark.parametrize("speed_mps", [0.0, 0.4, 3.0, 8.0])
@pytest.mark.parametrize("goal_mps", [0.0, 2.9, 8.0])
@pytest.mark.parametrize("demand_mps2", [-3.5, -1.0, -0.2])
def test_a_car_that_changes_to_the_speed_at_the_magnitude_brakes_as_demanded(
    speed_mps, goal_mps, demand_mps2
):
    sent = of_standard(can_rig.command(0.1, demand_mps2, goal_mps), speed_mps)
    assert sent.accel_mps2 == -demand_mps2
    assert 0.0 <= sent.speed_mps <= goal_mps
    assert sent.speed_mps < speed_mps or sent.speed_mps == speed_mps == 0.0


def test_a_drive_keeps_its_target_speed_and_no_command_asks_for_the_quickest_change():
    sent = of_standard(can_rig.command(0.1, 0.7, 6.0), 3.0)
    assert (sent.speed_mps, sent.accel_mps2) == (6.0, 0.7)
    assert of_standard(can_rig.command(0.1, 0.0, 6.0), 6.0).accel_mps2 > 0.0


def test_a_brake_of_a_car_that_reports_no_speed_is_a_stop():
    assert of_standard(can_rig.command(0.1, -1.0, 6.0), None).speed_mps == 0.0


def test_the_goal_of_a_brake_is_below_the_reported_speed(buses):
    ours, theirs = buses
    actuator, sent = actuator_on(ours), []
    actuator._send = sent.append
    report = theirs.publisher(Topic("actuator/state", VehicleState, 100))

    def has_reported():
        report(can_rig.state(0.0, 3.0, t_s=4.0))
        return actuator.read(now_s=CLOCK())

    assert until(has_reported, patience_s=20)
    actuator.write(can_rig.command(0.0, -1.0, 5.0), now_s=CLOCK())
    assert (sent[-1].speed_mps, sent[-1].accel_mps2) == pytest.approx((2.0, 1.0))


def test_a_driver_of_signed_accelerations_gets_the_demand_itself(buses):
    sent = []
    actuator = actuator_on(buses[0], acceleration="signed")
    actuator._send = sent.append
    actuator.write(can_rig.command(0.0, -1.0), now_s=CLOCK())
    assert sent == [can_rig.command(0.0, -1.0)]


def test_an_odometry_comes_through_the_wire_format():
    message = Odometry(t_s=1.5, speed_mps=-0.5, yaw_rate_radps=0.25)
    assert from_cdr(to_cdr(message), Odometry) == message
    assert ros_name(Odometry) == "nav_msgs/msg/Odometry"


@pytest.mark.parametrize(("t_s", "age_s", "acts"), [(1.0, 0.05, True), (1.0, 0.2, False), (None, 0.0, False)])
def test_the_driver_brakes_without_fresh_commands_on_a_frame(t_s, age_s, acts):
    command = can_rig.command(0.1, 1.0, t_s=t_s)
    assert motion_of(command, age_s, 3.0).accel_mps2 == (1.0 if acts else -SAFE_DECEL_MPS2)
    assert motion_of(command, age_s, 3.0).road_wheel_angle_rad == 0.1


@pytest.mark.parametrize("demand_mps2", [-2.0, -0.5, 0.5, 1.5])
def test_the_driver_does_what_was_demanded_before_the_wire(demand_mps2):
    demanded = can_rig.command(0.1, demand_mps2, 8.0)
    assert motion_of(of_standard(demanded, 5.0), 0.0, 5.0).accel_mps2 == demand_mps2
    assert motion_of(demanded, 0.0, 5.0, signed=True) == demanded


def test_an_acceleration_of_zero_is_the_quickest_change():
    assert motion_of(can_rig.command(0.1, 0.0, 2.0), 0.0, 5.0).accel_mps2 == -QUICKEST_MPS2
