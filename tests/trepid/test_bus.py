"""The bus over real Zenoh sessions on the loopback interface."""

import subprocess
import sys
import time
from collections.abc import Iterator

import pytest
from process_rig import until

from trepid.bus import Bus, Latest, ZenohError, free_endpoint, open_bus
from trepid.clock import UNSTAMPED, Stamp
from trepid.config import ROOT
from trepid.messages import ImageStatistics, VehicleState
from trepid.topics import COMMAND, VEHICLE_STATE, Topic


def state(t_s: float) -> VehicleState:
    return VehicleState(
        t_s=t_s, speed_mps=None, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )


@pytest.fixture
def buses() -> Iterator[tuple[Bus, Bus]]:
    endpoint = free_endpoint()
    with (
        open_bus("car", time.monotonic, listen=endpoint) as one,
        open_bus("car", time.monotonic, connect=endpoint) as other,
    ):
        yield one, other


def received_after_sending(
    sender: Bus, latest: Latest[VehicleState], *, timeout_s: float
) -> VehicleState | None:
    """Send until a message arrives or the time is up; sessions need a moment to connect."""
    send = sender.publisher(VEHICLE_STATE)
    deadline_s = time.monotonic() + timeout_s
    while latest.refresh() is None and time.monotonic() < deadline_s:
        send(state(1.0))
        time.sleep(0.02)
    return latest.message


def test_a_message_arrives_unchanged_on_the_other_side(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    assert received_after_sending(one, other.latest(VEHICLE_STATE), timeout_s=5) == state(1.0)


def test_the_latest_message_wins_and_is_taken_once(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    latest, stream = other.latest(VEHICLE_STATE), other.stream(VEHICLE_STATE)
    assert received_after_sending(one, latest, timeout_s=5)
    send = one.publisher(VEHICLE_STATE)
    for t_s in (2.0, 3.0, 4.0):
        send(state(t_s))
    received: list[float] = []
    deadline_s = time.monotonic() + 5
    while 4.0 not in received and time.monotonic() < deadline_s:
        other.wait(0.05)
        received += [message.t_s for message, _ in stream.drain()]
    assert [t_s for t_s in received if t_s > 1.0] == [2.0, 3.0, 4.0]
    taken = latest.take()
    assert taken is not None
    assert taken.t_s == 4.0
    assert latest.take() is None
    assert latest.message == taken


def test_two_drives_on_one_machine_do_not_receive_each_others_messages(buses: tuple[Bus, Bus]) -> None:
    one, _ = buses
    with open_bus("car", time.monotonic, listen=free_endpoint()) as stranger:
        assert received_after_sending(one, stranger.latest(VEHICLE_STATE), timeout_s=1) is None


def test_malformed_messages_are_counted_by_topic_and_treated_as_not_received(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    states, commands = other.latest(VEHICLE_STATE), other.latest(COMMAND)
    send_malformed = one.publisher(Topic(COMMAND.key, VehicleState, 1))
    deadline_s = time.monotonic() + 5
    while commands.malformed == 0 and time.monotonic() < deadline_s:
        send_malformed(state(1.0))
        time.sleep(0.02)
        commands.take()
    assert commands.malformed > 0
    assert commands.broken
    assert commands.message is None
    assert states.message is None
    assert not states.broken
    assert other.malformed_counts() == {COMMAND.key: commands.malformed}


def test_an_input_is_broken_until_the_next_valid_message_arrives(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    latest = other.latest(VEHICLE_STATE)
    assert received_after_sending(one, latest, timeout_s=5)
    send_malformed = one.publisher(Topic(VEHICLE_STATE.key, ImageStatistics, 1))
    send_malformed(
        ImageStatistics(
            t_s=2.0, brightness=0.5, contrast=0.2, over_exposed=0.0, under_exposed=0.0,
            sharpness=1.0, frozen_s=0.0, spots=0.0,
        )
    )  # fmt: skip
    assert until(lambda: latest.refresh() and latest.broken, patience_s=5)
    assert latest.message == state(1.0)
    assert until(lambda: one.publisher(VEHICLE_STATE)(state(3.0)) or latest.take() is not None, patience_s=5)
    assert not latest.broken


def test_a_publisher_refuses_another_topics_message(buses: tuple[Bus, Bus]) -> None:
    with pytest.raises(TypeError, match="'controller/command' carries Command, got VehicleState"):
        buses[0].publisher(COMMAND)(state(1.0))  # type: ignore[arg-type]


def test_a_process_with_a_subscription_ends_by_itself() -> None:
    program = (
        "import time\n"
        "from trepid.bus import free_endpoint, open_bus\n"
        "from trepid.topics import VEHICLE_STATE\n"
        "with open_bus('car', time.monotonic, listen=free_endpoint()) as bus:\n"
        "    latest = bus.latest(VEHICLE_STATE)\n"
    )
    assert subprocess.run([sys.executable, "-c", program], cwd=ROOT, timeout=20, check=False).returncode == 0


def test_a_message_that_triggers_no_step_lies_until_it_is_read_and_wakes_nothing(
    buses: tuple[Bus, Bus],
) -> None:
    one, other = buses
    read = other.latest(VEHICLE_STATE, wakes=False)
    assert received_after_sending(one, read, timeout_s=5)
    one.publisher(VEHICLE_STATE)(state(2.0))
    assert not other.wait(0.2)
    assert read.refresh() == state(2.0)


def test_a_message_that_triggers_a_step_wakes_the_process(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    assert received_after_sending(one, other.latest(VEHICLE_STATE), timeout_s=5)
    other.wait(0.1)
    one.publisher(VEHICLE_STATE)(state(2.0))
    assert other.wait(5)


def test_every_message_carries_its_publisher_number_and_time_of_publication(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    latest = other.latest(VEHICLE_STATE)
    assert received_after_sending(one, latest, timeout_s=5)
    send = one.publisher(VEHICLE_STATE)
    stamps = []
    for t_s in (2.0, 3.0):
        before_s = time.monotonic()
        send(state(t_s))
        assert until(lambda wanted=t_s: (latest.refresh() or state(0.0)).t_s == wanted, patience_s=5)
        assert latest.received_s is not None
        assert before_s - 1e-6 <= latest.stamp.published_s <= latest.received_s + 1e-6
        stamps.append(latest.stamp)
    assert [stamp.sequence for stamp in stamps] == [1, 2]
    assert stamps[0].publisher == stamps[1].publisher


def test_nodes_of_one_process_hand_messages_over_as_they_are(buses: tuple[Bus, Bus]) -> None:
    one, _ = buses
    read, waking = one.latest(VEHICLE_STATE, wakes=False), one.latest(VEHICLE_STATE)
    sent = state(1.0)
    one.publisher(VEHICLE_STATE)(sent)
    assert read.take() is sent
    assert waking.take() is sent
    assert one.wait(0)


def test_nodes_of_one_process_receive_a_message_of_another_at_the_same_time(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    first, second = other.latest(VEHICLE_STATE), other.latest(VEHICLE_STATE)
    assert received_after_sending(one, first, timeout_s=5)
    assert second.take() == first.message
    assert second.received_s == first.received_s
    assert second.stamp == first.stamp


def test_a_tap_dates_messages_by_their_publication(buses: tuple[Bus, Bus]) -> None:
    one, other = buses
    tap, latest = other.tap("vehicle/**"), other.latest(VEHICLE_STATE)
    assert received_after_sending(one, latest, timeout_s=5)
    time.sleep(0.1)
    found = tap.drain()
    assert found[-1][0] == VEHICLE_STATE.key
    assert found[-1][2] == pytest.approx(latest.stamp.published_s, abs=1e-6)
    assert [at_s for *_, at_s in found] == sorted(at_s for *_, at_s in found)


def test_a_replayed_and_an_overtaken_message_are_recognised_by_their_stamps() -> None:
    newest = Stamp(5, 10.0, b"publisher")
    for older in (newest, Stamp(4, 10.0, b"publisher"), Stamp(9, 9.0, b"another")):
        assert older.repeats(newest, now_s=10.0)
        assert not Stamp(6, 10.1, b"publisher").repeats(older, now_s=10.1)
    assert not newest.repeats(Stamp(9, 9.0, b"another"), now_s=10.0)
    assert not newest.repeats(UNSTAMPED, now_s=10.0)


def test_a_clock_that_steps_back_is_recognised_by_a_later_number_with_an_earlier_time() -> None:
    newest = Stamp(5, 10.0, b"publisher")
    assert Stamp(6, 9.0, b"publisher").steps_back(newest)
    replayed, overtaken, of_another = Stamp(4, 9.0, b"publisher"), newest, Stamp(6, 9.0, b"another")
    for other in (replayed, overtaken, of_another, Stamp(6, 10.0, b"publisher"), UNSTAMPED):
        assert not other.steps_back(newest)
    assert not Stamp(6, 9.0, b"publisher").steps_back(UNSTAMPED)


def test_an_input_is_broken_while_the_clock_of_its_sender_has_stepped_back() -> None:
    step_s = [0.0]
    endpoint = free_endpoint()
    with (
        open_bus("car", lambda: time.monotonic() + step_s[0], listen=endpoint) as one,
        open_bus("car", time.monotonic, connect=endpoint) as other,
    ):
        send, latest = one.publisher(VEHICLE_STATE), other.latest(VEHICLE_STATE)
        assert until(lambda: send(state(1.0)) or latest.take() is not None, patience_s=5)
        step_s[0] = -1.0
        assert until(lambda: send(state(2.0)) or latest.take() or latest.broken, patience_s=5)
        assert latest.message == state(1.0)
        step_s[0] = 0.0
        assert until(lambda: send(state(3.0)) or latest.take() is not None, patience_s=5)
        assert not latest.broken


def test_a_stamp_from_the_future_makes_no_later_message_old() -> None:
    future = Stamp(5, 1000.0, b"faulty clock")
    assert not Stamp(1, 10.0, b"sound clock").repeats(future, now_s=10.0)


def test_a_key_of_others_is_received_as_bytes_and_only_the_newest(buses: tuple[Bus, Bus]) -> None:
    sender, receiver = buses
    newest = receiver.newest("0/front/image_raw/**")
    numbers = iter(range(10_000))

    def has_arrived() -> bool:
        for _ in range(3):
            sender._session.put("0/front/image_raw/type/hash", str(next(numbers)).encode())
        return receiver.wait(0.1)

    assert until(has_arrived, patience_s=10.0)
    last = str(next(numbers) - 1).encode()
    taken: list[bytes] = []

    def newest_taken() -> bool:
        found = newest.take()
        taken.extend([found[0]] if found else [])
        return last in taken

    assert until(newest_taken, patience_s=10.0)
    assert len(taken) <= 3 and newest.take() is None


def test_text_that_is_no_key_expression_is_refused(buses: tuple[Bus, Bus]) -> None:
    with pytest.raises(ZenohError):
        buses[0].newest("//front")
