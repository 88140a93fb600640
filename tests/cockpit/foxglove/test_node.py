"""The server for Foxglove, asked by a client of its own that speaks the protocol of the viewers."""

import json
import struct
import time
from collections.abc import Iterator
from typing import Any

import pytest
from message_rig import decision as some_decision
from websockets.sync.client import ClientConnection, connect

from drive.open_road import OpenRoad
from drive.plan import plan_processes
from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns, seconds
from trepid.config import InputError
from trepid.messages import CompressedFrame
from trepid.processes.endpoint import listening
from trepid.processes.launch import Fleet
from trepid.processes.page_door import foxglove_port
from trepid.processes.settings import ProcessSpec, load_processes
from trepid.topics import CAMERA_COMPRESSED, DECISION
from trepid.wire import from_cdr

pytest.importorskip("foxglove", reason="needs pip install 'trepid[foxglove]'")
PROTOCOL = "foxglove.sdk.v1"
MESSAGE = 1  # of a binary message: one of a subscription


class FoxgloveServer:
    """A server process, and the bus that it reads."""

    def __init__(self) -> None:
        self._offset_ns, self.endpoint, self.port = epoch_offset_ns(), free_endpoint(), foxglove_port(0)
        self.clock = epoch_clock(self._offset_ns)
        options = {"foxglove": {"port": self.port, "what": "a test"}}
        spec = ProcessSpec("foxglove", "cockpit.foxglove.node", options)
        self.fleet = Fleet(
            (spec,), vehicle_name="car", endpoint=self.endpoint, clock_offset_ns=self._offset_ns
        )

    def connect(self) -> ClientConnection:
        until_s = time.monotonic() + 30
        while True:
            try:
                return connect(f"ws://127.0.0.1:{self.port}", subprotocols=[PROTOCOL], open_timeout=5)  # type: ignore[list-item]
            except OSError:
                assert time.monotonic() < until_s, self.fleet.children["foxglove"].stderr_tail()
                time.sleep(0.1)


@pytest.fixture(scope="module")
def server_and_bus() -> Iterator[tuple[FoxgloveServer, Any]]:
    server = FoxgloveServer()
    with open_bus("car", server.clock, listen=server.endpoint) as bus, server.fleet:
        yield server, bus


def channels_of(client: ClientConnection, *wanted: str) -> dict[str, dict[str, Any]]:
    """The channels by topic, once all ``wanted`` ones are there."""
    channels: dict[str, dict[str, Any]] = {}
    while not set(wanted) <= set(channels):
        received = client.recv(timeout=20)
        told = json.loads(received) if isinstance(received, str) else {}
        if told.get("op") == "serverInfo":
            assert told["capabilities"] == []  # nothing can be changed
        channels |= {one["topic"]: one for one in told.get("channels", ())}
    return channels


def test_the_topics_and_what_the_viewers_draw_are_served_live(
    server_and_bus: tuple[FoxgloveServer, Any],
) -> None:
    server, bus = server_and_bus
    decide, show = bus.publisher(DECISION), bus.publisher(CAMERA_COMPRESSED)
    with server.connect() as client:
        first = ("/viewer/annotations", "/camera/image/compressed")
        channels = channels_of(client, *first)
        until_s = time.monotonic() + 30
        while "/supervisor/decision" not in channels and time.monotonic() < until_s:
            decide(some_decision(t_s=server.clock(), decided_s=server.clock()))
            time.sleep(0.2)
            try:
                channels |= {
                    one["topic"]: one for one in json.loads(client.recv(timeout=0.2)).get("channels", ())
                }
            except TimeoutError:
                continue
        assert channels["/viewer/annotations"]["schemaName"] == "foxglove_msgs/msg/ImageAnnotations"
        assert {one["encoding"] for one in channels.values()} == {"cdr"}
        wanted = {7: "/supervisor/decision", 8: "/viewer/annotations", 9: "/camera/image/compressed"}
        subscriptions = [
            {"id": number, "channelId": channels[topic]["id"]} for number, topic in wanted.items()
        ]
        client.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
        got: dict[str, tuple[int, bytes]] = {}
        sent: list[float] = []
        while set(got) != set(wanted.values()) and time.monotonic() < until_s:
            sent.append(server.clock())
            decide(some_decision(t_s=sent[-1], decided_s=sent[-1]))
            show(CompressedFrame(t_s=sent[-1], jpeg=b"\xff\xd8\xff\xd9"))
            time.sleep(0.1)
            try:
                received = client.recv(timeout=0.2)
            except TimeoutError:
                continue
            if isinstance(received, bytes) and received[0] == MESSAGE:
                number, at_ns = struct.unpack_from("<IQ", received, 1)
                got[wanted[number]] = at_ns, received[13:]
        assert set(got) == set(wanted.values())
        at_ns, data = got["/supervisor/decision"]
        assert from_cdr(data, DECISION.type).t_s in [pytest.approx(one, abs=1e-6) for one in sent]
        assert abs(seconds(at_ns) - sent[-1]) < 30
        assert from_cdr(got["/camera/image/compressed"][1], CompressedFrame).jpeg == b"\xff\xd8\xff\xd9"


def test_the_server_runs_when_asked_for_and_its_loss_changes_nothing() -> None:
    specs = load_processes()
    (spec,) = [spec for spec in specs if spec.name == "foxglove"]
    assert spec.loss == "nothing" and spec.publishes == ()
    assert spec not in plan_processes(specs, OpenRoad()) and spec in plan_processes(
        specs, OpenRoad(), foxglove=True
    )


def test_a_car_that_leaves_the_server_out_is_refused_when_it_is_asked_for() -> None:
    specs = tuple(spec for spec in load_processes() if spec.name != "foxglove")
    assert plan_processes(specs, OpenRoad())
    with pytest.raises(InputError, match=r"--foxglove: processes\.yaml of the car leaves out"):
        plan_processes(specs, OpenRoad(), foxglove=True)


def test_a_port_in_use_is_replaced_by_a_free_one() -> None:
    with listening("127.0.0.1", 0) as held:
        held.listen()
        used = held.getsockname()[1]
        assert foxglove_port(used) not in (0, used)


def test_without_the_extra_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trepid.processes.page_door.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"trepid\[foxglove\]"):
        foxglove_port(8765)
