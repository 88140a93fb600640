"""An image topic of a foreign ROS 2 graph over real Zenoh sessions."""

import re
import time
from collections.abc import Callable, Iterator

import foreign_ros_rig as foreign
import pytest
from camera_source_rig import drive, number_of, picture
from process_rig import until

from trepid.bus import Bus, free_endpoint, open_bus
from trepid.config import InputError
from trepid.messages import Frame
from vehicle.cameras.ros_topic import RosTopic, RosTopicSettings

PATIENCE_S = 20.0
KEY = "0/front/image_raw/sensor_msgs::msg::dds_::Image_/RIHS01_0123"


@pytest.fixture
def graph() -> Iterator[tuple[Bus, str]]:
    """The router of a ROS 2 graph."""
    endpoint = free_endpoint()
    with open_bus("graph", time.time, listen=endpoint) as bus:
        yield bus, endpoint


@pytest.fixture
def topic(graph: tuple[Bus, str]) -> Iterator[Callable[..., RosTopic]]:
    opened: list[RosTopic] = []

    def topic(**settings: object) -> RosTopic:
        known = {"key": "0/front/image_raw/**", "connect": graph[1], **settings}
        opened.append(RosTopic(RosTopicSettings.model_validate(known), drive(time.time)))
        return opened[-1]

    yield topic
    for one in opened:
        one.close()


def send_until(
    bus: Bus, source: RosTopic, data: Callable[[], bytes], done: Callable[[Frame | None], bool]
) -> bool:
    """Publish again and again as the graph does, until ``done`` with a reading."""

    def once() -> bool:
        bus._session.put(KEY, data())
        return done(source.read(timeout_s=0.1))

    return until(once, patience_s=PATIENCE_S)


def now_ns() -> int:
    return time.time_ns()


def test_images_arrive_with_the_stamps_of_their_headers(
    graph: tuple[Bus, str], topic: Callable[..., RosTopic]
) -> None:
    source, frames = topic(), []
    stamps: list[int] = []

    def data() -> bytes:
        stamps.append(now_ns() - 20_000_000)
        return foreign.image(picture(6), "bgr8", stamp_ns=stamps[-1])

    assert send_until(graph[0], source, data, lambda frame: frame is not None and not frames.append(frame))
    assert number_of(frames[0].image) == 6
    assert min(abs(frames[0].t_s - stamp / 1e9) for stamp in stamps) < 1e-5
    assert source.trouble == ""


def test_compressed_images_arrive(graph: tuple[Bus, str], topic: Callable[..., RosTopic]) -> None:
    source = topic(type="CompressedImage")

    def data() -> bytes:
        return foreign.compressed_image(picture(4), stamp_ns=now_ns())

    assert send_until(graph[0], source, data, lambda frame: frame is not None and number_of(frame.image) == 4)


@pytest.mark.parametrize(("offset_s", "sign"), [(-3600, r"\+36"), (3600, "-3[56]")])
def test_stamps_of_another_clock_are_refused_unless_the_arrival_counts(
    graph: tuple[Bus, str], topic: Callable[..., RosTopic], offset_s: int, sign: str
) -> None:
    def data() -> bytes:
        return foreign.image(picture(6), "bgr8", stamp_ns=now_ns() + offset_s * 10**9)

    strict = topic()
    assert send_until(
        graph[0], strict, data, lambda frame: frame is None and "differ from the clock" in strict.trouble
    )
    assert re.search(sign, strict.trouble)
    lenient = topic(stamp="arrival")
    assert send_until(
        graph[0], lenient, data, lambda frame: frame is not None and abs(frame.t_s - time.time()) < 30
    )


def test_a_message_that_is_no_image_is_counted_and_the_next_image_arrives(
    graph: tuple[Bus, str], topic: Callable[..., RosTopic]
) -> None:
    source = topic()
    assert send_until(
        graph[0], source, lambda: b"\x00\x01\x00\x00nonsense", lambda _: source.values()[1][1] != "0"
    )
    assert "not a sensor_msgs" in source.trouble

    def good() -> bytes:
        return foreign.image(picture(1), "bgr8", stamp_ns=now_ns())

    assert send_until(graph[0], source, good, lambda frame: frame is not None)


def test_a_router_that_does_not_answer_is_named_with_the_remedy(topic: Callable[..., RosTopic]) -> None:
    with pytest.raises(InputError, match=r"no router answers at .*; start rmw_zenohd or correct it"):
        topic(connect=free_endpoint())


def test_a_wrong_key_expression_is_named(topic: Callable[..., RosTopic]) -> None:
    with pytest.raises(InputError, match="is no key expression of Zenoh"):
        topic(key="//front//")
