"""The process that puts a drive into a ROS 2 graph, with a real router, and an independent ROS 2 implementation.

The environment variable ``TREPID_ROS_PYTHON`` names a Python interpreter with zenoh-ros2-sdk, catkin-pkg,
ros-rosidl-adapter, ros-rosidl-parser and ros-rosidl-generator-type-description; without it their tests are skipped.
"""

import json
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from process_rig import until

from trepid.bus import Bus, free_endpoint, open_bus, open_graph
from trepid.clock import GID_BYTES, stamp_of
from trepid.config import CAR
from trepid.messages import Command, Odometry
from trepid.processes.launch import Fleet
from trepid.processes.settings import ProcessSpec
from trepid.topics import COMMAND, DIAGNOSTICS
from trepid.wire import DERIVED, STORE, from_cdr, msg_text, ros_name, to_cdr
from vehicle.actuators.ackermann import command_topic, state_topic
from vehicle.ros.bridge import ackermann_driver
from vehicle.ros.graph import RosNode, RosTopic
from vehicle.ros.package import write_package

PEER = os.environ.get("TREPID_ROS_PYTHON")
needs_peer = pytest.mark.skipif(not PEER, reason="TREPID_ROS_PYTHON names no interpreter with ROS 2 tools")
COMMAND_TOPIC = "/trepid/car/controller/command"


def command(t_s: float | None) -> Command:
    return Command(t_s=t_s, road_wheel_angle_rad=0.25, speed_mps=3.0, accel_mps2=-1.0)


class Drive:
    """A bus with the bridge as its only process, and the router of a ROS 2 graph."""

    def __init__(self, bus: Bus, router: str) -> None:
        self.bus, self.router = bus, router
        self.send = bus.publisher(COMMAND)
        self.beats = bus.stream(DIAGNOSTICS)


@pytest.fixture
def drive(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Drive]:
    """The car has an Ackermann driver in the graph."""
    router, endpoint = free_endpoint(), free_endpoint()
    names = "names: {actuator/command: /ackermann_cmd}\nstate: /odom\n"
    (tmp_path / "ros.yaml").write_text(f"router: {router}\n{names}")
    driver = "ackermann: {state: odometry, wheel_angle: commanded}\n"
    (tmp_path / "actuator.yaml").write_text(f"actuator: ackermann\n{driver}")
    monkeypatch.setenv(CAR, str(tmp_path))
    with (
        open_bus("car", time.time, listen=endpoint) as bus,
        Fleet(
            (ProcessSpec("ros", "vehicle.ros.bridge"),),
            vehicle_name="car",
            endpoint=endpoint,
            clock_offset_ns=time.time_ns() - time.monotonic_ns(),
        ),
    ):
        yield Drive(bus, router)


def router_of(drive: Drive):
    return open_graph({"mode": "router", "listen/endpoints": [drive.router]})


def test_a_command_reaches_the_graph_unchanged_with_its_stamp_and_the_node_is_declared(drive: Drive) -> None:
    with router_of(drive):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("connect/endpoints", json.dumps([drive.router]))
        with zenoh.open(config) as graph:
            commands = graph.declare_subscriber(
                "0/trepid/car/controller/command/**", zenoh.handlers.RingChannel(1)
            )
            poses = graph.declare_subscriber("0/tf_static/**", zenoh.handlers.RingChannel(1))
            found = []

            def has_arrived() -> bool:
                drive.send(command(123.5))
                found.append(commands.try_recv())
                return found[-1] is not None

            assert until(has_arrived, patience_s=20)
            key = str(found[-1].key_expr)
            assert key.endswith(f"AckermannDriveStamped_/{STORE.hash_rihs01(ros_name(Command))}")
            assert from_cdr(found[-1].payload.to_bytes(), Command) == command(123.5)
            stamp = stamp_of(found[-1].attachment.to_bytes())
            assert stamp.sequence >= 1
            assert len(stamp.publisher) == GID_BYTES
            assert abs(stamp.published_s - time.time()) < 20
            assert until(lambda: poses.try_recv() is not None, patience_s=5)
            tokens = [str(reply.ok.key_expr) for reply in graph.liveliness().get("@ros2_lv/0/**") if reply.ok]
    assert any("/NN/%/%/trepid" in token for token in tokens)
    assert any("/MP/" in token and "%trepid%car%controller%command" in token for token in tokens)


def test_the_limited_command_reaches_a_driver_in_the_graph_and_its_odometry_the_actuator(
    drive: Drive,
) -> None:
    driver = ackermann_driver()
    limited, reports = drive.bus.publisher(command_topic(driver)), drive.bus.latest(state_topic(driver))
    with router_of(drive), open_graph({"mode": "client", "connect/endpoints": [drive.router]}) as graph:
        node = RosNode(graph, domain=0, name="driver")
        heard = node.subscriber(RosTopic("/ackermann_cmd", ros_name(Command)))
        send = node.publisher(RosTopic("/odom", ros_name(Odometry)))
        commands = []

        def has_exchanged() -> bool:
            limited(command(123.5))
            send(to_cdr(Odometry(t_s=7.0, speed_mps=2.5, yaw_rate_radps=0.1)), time.time())
            commands.extend(filter(None, [heard()]))
            return bool(commands) and reports.refresh() is not None

        assert until(has_exchanged, patience_s=20)
    assert from_cdr(commands[0], Command) == command(123.5)
    assert (reports.message.t_s, reports.message.speed_mps) == (7.0, 2.5)


def test_without_a_router_the_bridge_waits_for_one_and_says_so(drive: Drive) -> None:
    def waiting() -> bool:
        return any("no ROS 2 router" in beat.message for beat, _ in drive.beats.drain())

    assert until(waiting, patience_s=20)
    with router_of(drive):
        assert until(lambda: any(beat.message == "" for beat, _ in drive.beats.drain()), patience_s=10)


LISTENER = """
import json, sys, time
from zenoh_ros2_sdk import ROS2Subscriber
port, definition = int(sys.argv[1]), sys.argv[2]
heard = []
sub = ROS2Subscriber("/trepid/car/controller/command", "ackermann_msgs/msg/AckermannDriveStamped", heard.append,
                     msg_definition=definition, type_hash=sys.argv[3], domain_id=0, router_port=port)
until = time.monotonic() + 20
while not heard and time.monotonic() < until:
    time.sleep(0.05)
from zenoh_ros2_sdk.session import ZenohSession
lv = ZenohSession.get_instance("127.0.0.1", port).liveliness
tokens = [str(r.ok.key_expr) for r in lv.get("@ros2_lv/0/*/*/*/MP/**", timeout=2.0) if r.ok]
print(json.dumps({"angle": heard[0].drive.steering_angle if heard else None, "tokens": tokens}), flush=True)
import os; os._exit(0)
"""


@needs_peer
def test_an_independent_implementation_hears_the_commands_and_finds_the_publishers(drive: Drive) -> None:
    definition, _ = STORE.generate_msgdef(ros_name(Command), ros_version=2)
    words = [drive.router.rpartition(":")[2], definition, STORE.hash_rihs01(ros_name(Command))]
    with (
        router_of(drive),
        subprocess.Popen([PEER, "-c", LISTENER, *words], stdout=subprocess.PIPE, text=True) as peer,
    ):
        while peer.poll() is None:
            drive.send(command(time.time()))
            time.sleep(0.05)
        heard = json.loads(peer.stdout.read().splitlines()[-1])
    assert heard["angle"] == 0.25
    assert any("%trepid%car%controller%command" in token for token in heard["tokens"])


CHECK = """
import json, pathlib, sys
from catkin_pkg.package import parse_package
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_type_description import generate_type_hash
from rosidl_parser.definition import IdlLocator
from rosidl_parser.parser import parse_idl_file
folder = pathlib.Path(sys.argv[1])
package = parse_package(str(folder))
out = folder.parent / "idl"
types = []
for path in sorted((folder / "msg").glob("*.msg")):
    convert_msg_to_idl(folder, package.name, path.relative_to(folder), out)
    content = parse_idl_file(IdlLocator(out, path.with_suffix(".idl").name)).content
    types.append(content)
print(json.dumps({"name": package.name, "groups": [g.name for g in package.member_of_groups],
                  "depends": [d.name for d in package.build_depends], "messages": len(types)}))
"""


@needs_peer
def test_the_tools_of_ros_2_read_the_package_and_every_message(tmp_path: Path) -> None:
    package = write_package(tmp_path)
    done = subprocess.run([PEER, "-c", CHECK, str(package)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    read = json.loads(done.stdout.splitlines()[-1])
    assert read == {
        "name": "trepid_msgs",
        "groups": ["rosidl_interface_packages"],
        "depends": ["std_msgs"],
        "messages": len(DERIVED),
    }
    assert all((package / "msg" / f"{kind.__name__}.msg").read_text() == msg_text(kind) for kind in DERIVED)
