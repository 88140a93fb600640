"""What the faults make of the messages of a process."""

from pathlib import Path

import numpy as np
import pytest

from lab.bench.live.faults.catalogue import Act
from lab.bench.live.faults.inside import (
    FaultyPublisher,
    Host,
    HostOptions,
    Order,
    restamp,
)
from trepid.clock import stamp_of, stamper
from trepid.messages import Frame, VehicleState
from trepid.topics import CAMERA_IMAGE, COMMAND, VEHICLE_STATE
from trepid.wire import from_cdr, to_cdr


class Wire:
    """In place of a publisher of Zenoh."""

    def __init__(self) -> None:
        self.sent: list[tuple[bytes, bytes | None]] = []

    def put(self, data: bytes, *, attachment: bytes | None = None) -> None:
        self.sent.append((data, attachment))


class Sender:
    """A faulty publisher at 50 Hz, the host of its faults, and what reaches the wire."""

    def __init__(self, folder: Path, key: str = COMMAND.key) -> None:
        self.now_s = 100.0
        self.host = Host(HostOptions(hosted="", control=folder), "controller", lambda: self.now_s)
        self.marks = self.host._marks = Wire()
        self.wire = Wire()
        self._publisher = FaultyPublisher(self.wire, key, self.host)
        self._key = key

    def send(self, *messages: bytes) -> list[bytes]:
        """The bytes on the wire after sending ``messages``."""
        self.wire.sent.clear()
        for data in messages:
            self.now_s += 0.02
            self._publisher.put(data, attachment=b"stamp of " + data)
        return [data for data, _ in self.wire.sent]

    def order(self, act: Act | None, **options: object) -> None:
        self.host.order = Order(act=act, key=self._key if act else "", **options)  # type: ignore[arg-type]


@pytest.fixture
def sender(tmp_path: Path) -> Sender:
    return Sender(tmp_path)


def test_messages_pass_unchanged_without_a_fault(sender: Sender) -> None:
    assert sender.send(b"one", b"two") == [b"one", b"two"]
    assert sender.wire.sent[1] == (b"two", b"stamp of two")
    assert sender.marks.sent == []


def test_a_silent_topic_marks_what_it_did_not_send(sender: Sender) -> None:
    sender.order(Act.SILENT)
    assert sender.send(b"one", b"two") == []
    assert [data for data, _ in sender.marks.sent] == [COMMAND.key.encode()] * 2


def test_a_fault_concerns_its_topic_only(sender: Sender) -> None:
    sender.host.order = Order(act=Act.SILENT, key="another/topic")
    assert sender.send(b"one") == [b"one"]


def test_a_corrupt_message_differs_from_the_true_one(sender: Sender) -> None:
    sender.order(Act.CORRUPT)
    true = [bytes(range(50))] * 40
    false = sender.send(*true)
    assert len(false) == len(true)
    assert not set(true) & set(false)
    assert {len(data) < len(true[0]) for data in false} == {True, False}


def test_a_replayed_message_has_the_stamp_of_its_time(sender: Sender) -> None:
    sender.send(*(str(n).encode() for n in range(100)))
    sender.order(Act.REPLAY)
    assert sender.send(b"now", b"next") == [b"50", b"51"]
    assert sender.wire.sent[0][1] == b"stamp of 50"


def test_disorder_exchanges_neighbours_and_loses_none(sender: Sender) -> None:
    sender.order(Act.DISORDER)
    assert sender.send(b"1", b"2", b"3", b"4") == [b"2", b"1", b"4", b"3"]


def test_a_repeated_image_has_the_time_of_the_new_one(tmp_path: Path) -> None:
    sender = Sender(tmp_path, CAMERA_IMAGE.key)
    frames = [to_cdr(Frame(t_s=1.0 * n, image=np.full((2, 2, 3), n, np.uint8))) for n in (1, 2)]
    sender.order(Act.REPEAT)
    first, second = (from_cdr(data, Frame) for data in sender.send(*frames))
    assert (first.t_s, second.t_s) == (1.0, 2.0)
    assert (second.image == 1).all()


def test_a_clock_that_steps_moves_the_time_of_the_process(sender: Sender) -> None:
    sender.order(Act.CLOCK, clock_step_s=-1.0)
    assert sender.host.now_s() == pytest.approx(sender.now_s - 1.0)
    assert sender.send(b"one") == [b"one"]


def test_stamps_that_step_leave_the_clock_of_a_simulation_alone(tmp_path: Path) -> None:
    sender = Sender(tmp_path, VEHICLE_STATE.key)
    state = VehicleState(
        t_s=5.0, speed_mps=1.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )
    sender.order(Act.CLOCK, clock_step_s=1.0, stamps_only=True)
    assert sender.host.now_s() == sender.now_s
    attachment = stamper(lambda: sender.now_s)()
    sender._publisher.put(to_cdr(state), attachment=attachment)
    ((data, stamped),) = sender.wire.sent
    assert from_cdr(data, VehicleState).t_s == pytest.approx(6.0)
    assert stamp_of(stamped).published_s == pytest.approx(stamp_of(attachment).published_s + 1.0)


def test_a_restamped_message_keeps_its_number_and_publisher() -> None:
    attachment = stamper(lambda: 7.0)()
    before, after = stamp_of(attachment), stamp_of(restamp(attachment, 1.0))
    assert (after.sequence, after.publisher) == (before.sequence, before.publisher)
    assert after.published_s == pytest.approx(8.0)


def test_an_order_is_read_from_the_file_of_the_process(tmp_path: Path) -> None:
    sender = Sender(tmp_path)
    order = Order(act=Act.SILENT, key=COMMAND.key, renewals=1)
    (tmp_path / "controller.json").write_text(order.model_dump_json())
    sender.host.read()
    assert sender.host.order == order
    assert sender.host.renewing()
    sender.host.renew()
    assert not sender.host.renewing()
