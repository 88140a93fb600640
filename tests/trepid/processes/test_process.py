"""The heartbeat of a process."""

import threading

import pytest
from heartbeat_rig import RecordingBus

from trepid.messages import Health
from trepid.processes.process import Assignment, Process
from trepid.topics import COMMAND, DRIVER_INPUT


@pytest.fixture
def bus():
    return RecordingBus()


@pytest.fixture
def me(bus):
    assignment = Assignment(name="one", vehicle_name="v", connect="", clock_offset_ns=0)
    return Process(assignment, bus, threading.Event())


def test_a_heartbeat_carries_the_current_further_values_of_the_process(bus, me):
    count = [0]
    me.ready(values=lambda: (("count", str(count[0])),))
    count[0] = 3
    me.beat(Health.OK, "later")
    assert [dict(beat.values)["count"] for beat in bus.sent] == ["0", "3"]
    assert {"pid", "rate_hz", "cpu_percent"} <= dict(bus.sent[0].values).keys()


def test_malformed_messages_are_reported_at_once_with_their_number_and_raise_health_to_warn(bus, me):
    me.alive(Health.OK, "")
    assert bus.sent == []
    bus.counts = {"vehicle/state": 2}
    me.alive(Health.OK, "")
    (beat,) = bus.sent
    assert (beat.health, beat.message) == (Health.WARN, "malformed messages on vehicle/state")
    assert dict(beat.values)["malformed vehicle/state"] == "2"


def test_a_series_of_malformed_messages_does_not_speed_up_the_heartbeat(bus, me):
    for count in range(1, 100):
        bus.counts = {"vehicle/state": count}
        me.count_step()
    assert len(bus.sent) == 1


def test_health_recovers_with_the_first_heartbeat_without_new_malformed_messages(bus, me):
    bus.counts = {"vehicle/state": 1}
    me.beat(Health.OK, "driving")
    me.beat(Health.OK, "driving")
    assert [beat.health for beat in bus.sent] == [Health.WARN, Health.OK]
    assert bus.sent[0].message == "driving; malformed messages on vehicle/state"
    assert dict(bus.sent[1].values)["malformed vehicle/state"] == "1"


def test_malformed_messages_do_not_lower_an_error_to_a_warning(bus, me):
    bus.counts = {"perception/lead": 1}
    me.beat(Health.ERROR, "no rules")
    assert bus.sent[0].health is Health.ERROR


def test_a_topic_has_a_publisher_when_an_entry_of_the_drive_names_it(bus):
    publishes = {"driver": ("driver/input",)}
    assignment = Assignment(name="one", vehicle_name="v", connect="", clock_offset_ns=0, publishes=publishes)
    me = Process(assignment, bus, threading.Event())
    assert me.has_publisher(DRIVER_INPUT) and me.publisher(DRIVER_INPUT) == "driver"
    assert not me.has_publisher(COMMAND) and me.publisher(COMMAND) is None
