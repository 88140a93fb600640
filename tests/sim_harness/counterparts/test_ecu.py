"""The simulated ECU: what it accepts, when it goes to its safe state, and its reports. No bus, given times."""

import can_rig
import pytest

from sim_harness.counterparts.ecu import Ecu, EcuSettings

MAP = can_rig.SHUTTLE
WHEEL_RAD = 0.07  # measured


class Sending:
    """Both command messages to an ECU, at 100 Hz."""

    def __init__(self):
        self.ecu = Ecu(MAP, EcuSettings(), can_rig.VEHICLE)
        self.senders = MAP.senders()
        self.now_s = 10.0

    def step(self, command, *, only=(0, 1), speed_mps=5.0, spoil=lambda data: data):
        """10 ms with the messages ``only``; the first is spoilt."""
        for k in only:
            sender, data = self.senders[k], self.senders[k].frame(can_rig.command_quantities(command))
            self.ecu.take(sender.address, False, data if k else spoil(data), now_s=self.now_s)
        acting = self.ecu.command(speed_mps, WHEEL_RAD, now_s=self.now_s)
        self.now_s += 0.01
        return acting

    def steps(self, count, command, **how):
        return [self.step(command, **how) for _ in range(count)]


@pytest.fixture
def sending():
    return Sending()


def test_the_run_begins_with_the_first_engaged_command(sending):
    assert set(sending.steps(20, can_rig.command(t_s=None))) == {None}
    assert sending.step(can_rig.command(0.1, 1.0)) is not None


def test_a_command_acts_as_it_was_sent(sending):
    acting = sending.steps(3, can_rig.command(0.1, -1.25))[-1]
    assert acting.road_wheel_angle_rad == pytest.approx(0.1, abs=1e-4)
    assert acting.accel_mps2 == pytest.approx(-1.25)
    assert sending.ecu.safe == ""


@pytest.mark.parametrize("heard", [(), (0,), (1,)])
def test_silence_of_any_command_message_brakes(sending, heard):
    sending.steps(5, can_rig.command(0.1, 1.0))
    acting = sending.steps(15, can_rig.command(0.1, 1.0), only=heard)
    assert acting[6].accel_mps2 == pytest.approx(1.0)  # 70 ms are no silence yet
    assert acting[8].accel_mps2 == acting[-1].accel_mps2 == -3.5  # 90 ms
    assert acting[-1].road_wheel_angle_rad == WHEEL_RAD
    assert sending.ecu.safe.startswith("no valid ")


@pytest.mark.parametrize("what", ["checksum", "counter"])
def test_wrong_checksums_and_counters_are_refused_and_lead_to_the_safe_state(sending, what):
    first = MAP.senders()[0].frame(can_rig.command_quantities(can_rig.command()))
    spoils = {"checksum": lambda data: data[:-1] + bytes([data[-1] ^ 1]), "counter": lambda _: first}
    sending.steps(5, can_rig.command(0.1, 1.0))
    acting = sending.steps(20, can_rig.command(0.3, 1.5), spoil=spoils[what])
    assert acting[-1].accel_mps2 == -3.5
    assert acting[-1].road_wheel_angle_rad == WHEEL_RAD
    assert sending.ecu.refused_frames() == {f"refused STEERING_LTA {what}": 20}


def test_the_end_of_the_engagement_is_the_safe_state(sending):
    sending.steps(5, can_rig.command(0.1, 1.0))
    acting = sending.step(can_rig.command(0.1, 1.0, t_s=None))
    assert (acting.accel_mps2, sending.ecu.safe) == (-3.5, "not engaged")


def test_the_safe_state_lasts_until_standstill(sending):
    sending.steps(5, can_rig.command(0.0, 1.0))
    sending.steps(20, can_rig.command(0.0, 1.0), only=())
    assert {acting.accel_mps2 for acting in sending.steps(20, can_rig.command(0.0, 1.0))} == {-3.5}
    assert sending.steps(2, can_rig.command(0.0, 1.0), speed_mps=0.0)[-1].accel_mps2 == pytest.approx(1.0)


def test_reports_are_sent_at_their_periods(sending):
    counts = {each.address: 0 for each in map(MAP.sender, MAP.settings.reports)}
    for k in range(100):
        for sender, _ in sending.ecu.reports(can_rig.state(), now_s=10.0 + 0.01 * k, step_s=0.01):
            counts[sender.address] += 1
    assert counts == {608: 100, 180: 50, 36: 50}


def test_a_mute_ecu_drives_on_and_reports_nothing():
    ecu = Sending()
    ecu.ecu = Ecu(MAP, EcuSettings(mute_after_s=0.5), can_rig.VEHICLE)
    counts = []
    for _ in range(100):
        assert ecu.step(can_rig.command()) is not None
        counts.append(len(list(ecu.ecu.reports(can_rig.state(), now_s=ecu.now_s, step_s=0.01))))
    assert min(counts[:45]) >= 1
    assert max(counts[55:]) == 0
