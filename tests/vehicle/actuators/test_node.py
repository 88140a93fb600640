"""The step between bus and wire, and the guards around an actuator."""

from types import SimpleNamespace

import can_rig
import pytest

from controller.limiter import build as build_limiter
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Health, StopRequest
from trepid.topics import COMMAND, DRIVER_INPUT, STOP_REQUEST
from vehicle.actuators.node import ActuatorStep, Loop, Wire, safe_at_end
from vehicle.driver.stop_button import STOPPED
from vehicle.measurement.check import build as build_check

VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)

SCRIPTED = frozenset({"speed_mps", "road_wheel_angle_rad", "yaw_rate_radps"})  # states of no car: range only


@pytest.fixture
def node():
    return ActuatorStep(build_limiter(VEHICLE), build_check(VEHICLE, computed=SCRIPTED))


def drive_node(node, *, steps, refused_at=None, state=True, from_s=10.0):
    """Steps with fresh commands at 5 m/s; the accelerations that go to the wire."""
    given = []
    for k in range(steps):
        now_s = from_s + 0.01 * k
        car = can_rig.state(0.0, 5.0, t_s=now_s) if state else None
        order = can_rig.command(accel_mps2=0.5, t_s=now_s)
        applied = node.step(order, now_s, car, stop=k == refused_at, now_s=now_s)
        given.append(applied.command.accel_mps2)
    return given, applied


def test_nothing_reaches_the_wire_before_the_first_wheel_angle(node):
    """A process that is started again in a bend would straighten the wheels."""
    order = can_rig.command(0.3, t_s=10.0)
    for state in (None, can_rig.state(0.3, 5.0, t_s=9.0)):  # none, and one that is too old
        assert node.step(order, 10.0, state, now_s=10.0).command is None
    applied = node.step(order, 10.0, can_rig.state(0.3, 5.0, t_s=10.01), now_s=10.01)
    assert applied.command.road_wheel_angle_rad == pytest.approx(0.3, abs=0.01)
    assert node.step(order, 10.0, None, now_s=10.02).command is not None


def test_a_fresh_command_passes_through_the_limiter_to_the_wire(node):
    accel_mps2, applied = drive_node(node, steps=50)
    assert accel_mps2[-1] == pytest.approx(0.5)
    assert applied.state.speed_mps == 5.0


def test_a_command_beyond_the_limits_does_not_reach_the_wire(node):
    sharp = can_rig.command(0.5, 9.0, t_s=10.0)
    applied = node.step(sharp, 10.0, can_rig.state(0.0, 8.0, t_s=10.0), now_s=10.0)
    assert applied.command.road_wheel_angle_rad < 0.01
    assert applied.command.accel_mps2 <= 1.5


def test_an_absent_state_travels_as_such_and_brakes(node):
    drive_node(node, steps=20)
    accel_mps2, applied = drive_node(node, steps=30, state=False, from_s=10.2)
    assert accel_mps2[0] <= -1.0
    assert accel_mps2[-1] == pytest.approx(-3.5)
    state = applied.state
    assert (state.speed_mps, state.road_wheel_angle_rad, state.yaw_rate_radps) == (None, None, None)


def test_an_old_state_travels_with_its_own_time(node):
    applied = node.step(None, None, can_rig.state(t_s=9.0), now_s=10.0)
    assert applied.state.t_s == 9.0


def test_a_refusal_of_the_wire_stops_the_car_until_standstill(node):
    accel_mps2, _ = drive_node(node, steps=100, refused_at=20)
    assert accel_mps2[19] == pytest.approx(0.5)
    assert max(accel_mps2[20:]) == pytest.approx(-3.5)
    standing = can_rig.state(0.0, 0.0, t_s=11.0)
    assert (
        node.step(can_rig.command(accel_mps2=0.5, t_s=11.0), 11.0, standing, now_s=11.0).command.accel_mps2
        > -3.5
    )


def test_the_override_of_the_driver_is_read_back_and_the_wheel_follows_the_hand(node):
    drive_node(node, steps=20)
    state = can_rig.state(0.1, 5.0, override=True, t_s=10.2)
    applied = node.step(can_rig.command(t_s=10.2), 10.2, state, now_s=10.2)
    assert applied.state.driver_override
    assert applied.command.road_wheel_angle_rad == pytest.approx(0.1)


class Faulty:
    """An actuator of which every call fails."""

    def read(self, *, now_s):
        raise OSError(100, "Network is down")

    write = values = None

    def close(self):
        raise OSError(100, "Network is down")


def test_a_failure_of_the_wire_is_counted_and_its_text_kept():
    wire = Wire(Faulty(), "can")
    assert wire.read(1.0) is None
    assert wire.read(1.1) is None
    assert (wire.failures, "Network is down" in wire.last) == (2, True)


class Closing:
    closed = False

    def close(self):
        self.closed = True


@pytest.mark.parametrize("end", [RuntimeError, KeyboardInterrupt, SystemExit])
def test_whatever_ends_the_process_the_actuator_goes_to_its_safe_state(end):
    actuator = Closing()
    with pytest.raises(end), safe_at_end(actuator):
        raise end
    assert actuator.closed


def test_a_safe_state_that_the_wire_refuses_is_reported(capsys):
    with safe_at_end(Faulty()):
        pass
    assert "the safe state was not sent" in capsys.readouterr().err


class Rolling:
    """An actuator whose car rolls at the commanded acceleration."""

    def __init__(self):
        self.speed_mps, self.least_mps2, self.override = 5.0, 0.0, False

    def read(self, *, now_s):
        return can_rig.state(0.0, self.speed_mps, override=self.override, t_s=now_s)

    def write(self, command, *, now_s):
        self.least_mps2 = min(self.least_mps2, command.accel_mps2)
        self.speed_mps = max(0.0, self.speed_mps + 0.01 * command.accel_mps2)

    def values(self):
        return ()


class Drive:
    """What the loop uses of its process, in given time; it holds one command and no input of a driver."""

    name = "vehicle"

    def __init__(self, command=None, *, with_driver=False):
        self.s, self.command, self._with_driver, self.reasons = 10.0, command, with_driver, []
        self.stop = None
        self.bus = SimpleNamespace(latest=self._latest, publisher=lambda _: lambda _: None)

    def _latest(self, topic):
        message = self.command if topic is COMMAND else None
        return SimpleNamespace(
            take=lambda: self.stop if topic is STOP_REQUEST else None,
            message=message,
            received_s=message and self.s,
        )

    def now_s(self):
        return self.s

    def has_publisher(self, topic):
        return self._with_driver and topic is DRIVER_INPUT

    def ready(self, **_):
        pass

    def count_step(self, *reasons):
        self.reasons += reasons


@pytest.fixture
def rolling(node):
    """A loop in given time, and the time."""
    drive = Drive()
    return Loop(drive, Rolling(), "can", node), drive


@pytest.mark.parametrize("with_driver", [False, True])
def test_where_a_process_publishes_driver_input_the_controller_waits_for_it(node, with_driver):
    drive = Drive(can_rig.command(accel_mps2=0.5, t_s=10.0), with_driver=with_driver)
    actuator = Rolling()
    turn_loop((Loop(drive, actuator, "can", node), drive), 2)
    assert (actuator.speed_mps > 5.0) != with_driver
    assert ("no input of the driver" in drive.reasons) == with_driver


def turn_loop(rolling, turns, **how):
    loop, clock = rolling
    for _ in range(turns):
        clock.s += 0.01
        loop.turn(**how)
    return loop


def test_before_its_end_the_process_brings_a_moving_car_to_a_standstill(rolling):
    loop = turn_loop(rolling, 1)
    assert loop.moving
    turn_loop(rolling, 150, ending=True)
    assert not loop.moving
    assert loop._wire._actuator.least_mps2 == pytest.approx(-3.5)


def test_a_car_that_the_driver_has_is_not_stopped_at_the_end(rolling):
    turn_loop(rolling, 1)
    rolling[0]._wire._actuator.override = True
    assert not turn_loop(rolling, 5, ending=True).moving


def test_a_standing_car_is_left_at_once(rolling):
    rolling[0]._wire._actuator.speed_mps = 0.0
    assert not turn_loop(rolling, 1).moving


class Mute(Rolling):
    """An actuator whose car rolls and reports nothing."""

    def read(self, *, now_s):
        return None


@pytest.mark.parametrize(
    ("actuator", "how", "health", "message"),
    [
        (Rolling(), {}, Health.WARN, STOPPED),
        (Rolling(), {"ending": True}, Health.WARN, f"{STOPPED}; stops the car before it ends"),
        (Mute(), {}, Health.WARN, f"{STOPPED}; actuator can: the car reports no state"),
        (Faulty(), {}, Health.ERROR, f"{STOPPED}; actuator can: [Errno 100] Network is down"),
    ],
)
def test_a_car_that_the_stop_button_holds_is_reported_as_held_beside_any_fault(
    node, actuator, how, health, message
):
    drive = Drive()
    drive.stop = StopRequest(t_s=10.0, stop=True)
    turn_loop((Loop(drive, actuator, "can", node), drive), 1, **how)
    assert drive.reasons == [health, message]
