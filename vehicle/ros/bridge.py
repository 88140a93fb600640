"""ROS 2 process: the topics of a drive in a ROS 2 graph over rmw_zenoh.

Nothing comes back into the drive but the state of a car with an Ackermann driver, where ``ros.yaml`` names it.

The process has a session of its own in the graph, so that the driving processes publish once, and a ROS 2 graph has
no way to their topics. The bytes pass unchanged, since messages of a drive are ROS 2 CDR already.
"""

from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Annotated, Any

import numpy as np
from pydantic import Field

from trepid.bus import Bus, open_graph
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, Settings, load
from trepid.messages import Health
from trepid.processes.process import Process, Ticker, process
from trepid.security import load_security, on_loopback
from trepid.spelling import did_you_mean
from trepid.topics import FIXED, Topic, estimate_topic
from trepid.types import Array
from trepid.wire import CAMERA_FRAME, ROS, STORE, VEHICLE_FRAME, ros_name
from vehicle.actuators.ackermann import AckermannSettings, command_topic, state_topic
from vehicle.actuators.table import configured_actuator
from vehicle.ros.graph import RosNode, RosTopic, ros_topic_name

RATE_HZ = 200  # looks for messages
RETRY_S = 2.0  # between attempts to reach the router of the graph
SESSION = {"mode": "client", "timestamping/enabled": True}  # latched publishers need the time stamps of Zenoh
STATIC_S = 1.0  # between repetitions of the pose of the camera
TF_STATIC = RosTopic("/tf_static", "tf2_msgs/msg/TFMessage")


RosName = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$")]


class RosSettings(Settings):
    """``config/ros.yaml``."""

    domain: Annotated[int, Field(ge=0, le=232)]
    router: Annotated[str, Field(pattern=r"^\w+/.+:\d+$")]
    node: Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$")]
    names: Mapping[str, RosName]
    exclude: tuple[str, ...]
    state: RosName | None

    def forwarded_topics(
        self, vehicle_name: str, estimators: tuple[str, ...], driver: AckermannSettings | None
    ) -> dict[str, RosTopic]:
        """Topics of the graph by the keys of a drive, with the limited command to ``driver``, that of the car.

        Raises InputError for a key that is not one of them.
        """
        limited = () if driver is None else (command_topic(driver),)
        every: dict[str, Topic[Any]] = {
            **FIXED,
            **{topic.key: topic for topic in (*map(estimate_topic, estimators), *limited)},
        }
        for key in (*self.exclude, *self.names):
            if key not in every:
                hint = did_you_mean(key, every)
                further = "" if limited else "; the limited command is a topic with actuator: ackermann only"
                raise InputError(f"ros.yaml: no topic {key!r} in a drive; {hint}{further}")
        return {
            key: RosTopic(
                self.names.get(key) or ros_topic_name(f"trepid/{vehicle_name}/{key}"), ros_name(topic.type)
            )
            for key, topic in every.items()
            if key not in self.exclude
        }


def load_settings() -> RosSettings:
    """The settings of the car.

    Raises InputError, also for a router on another machine, and for a state that has no use or may be forged.
    """
    settings = load(CONFIG_DIR / "ros.yaml", RosSettings)
    if settings.state is not None and ackermann_driver() is None:
        raise InputError(
            "ros.yaml: state: is that of a car with actuator: ackermann; actuator.yaml names another"
        )
    if settings.state is not None and load_security().keys is not None:
        raise InputError("ros.yaml: state: comes in the clear, so it needs a drive without keys")
    if not on_loopback(settings.router):
        raise InputError(
            f"ros.yaml: router {settings.router} is on another machine, and ROS 2 sends in the clear; run a router "
            "of the graph on this one: `ros2 run rmw_zenoh_cpp rmw_zenohd`"
        )
    return settings


def ackermann_driver() -> AckermannSettings | None:
    """The settings of the Ackermann driver of the car; None where it has another actuator. Raises InputError."""
    _, settings = configured_actuator()
    return settings if isinstance(settings, AckermannSettings) else None


def camera_pose(camera: Camera, now_s: float) -> bytes:
    """CDR of the pose of the camera in the frame of the vehicle, for ``/tf_static`` (REP 103, REP 105)."""
    w, x, y, z = quaternion(camera.optical_from_vehicle.T)
    transform = ROS["geometry_msgs/msg/TransformStamped"](
        header=ROS["std_msgs/msg/Header"](
            stamp=ROS["builtin_interfaces/msg/Time"](sec=int(now_s), nanosec=0), frame_id=VEHICLE_FRAME
        ),
        child_frame_id=CAMERA_FRAME,
        transform=ROS["geometry_msgs/msg/Transform"](
            translation=ROS["geometry_msgs/msg/Vector3"](x=camera.x_m, y=camera.y_m, z=camera.height_m),
            rotation=ROS["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w),
        ),
    )
    message = ROS[TF_STATIC.type](transforms=[transform])
    return bytes(STORE.serialize_cdr(message, TF_STATIC.type))


def quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """(w, x, y, z) of a rotation matrix, shape (3, 3): the eigenvector of Bar-Itzhack's symmetric matrix.

    I. Y. Bar-Itzhack, J. Guidance 23 (2000) 1085; exact also where the trace is near -1.
    """
    m = rotation
    k = np.array(
        [
            [m[0, 0] + m[1, 1] + m[2, 2], m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1]],
            [m[2, 1] - m[1, 2], m[0, 0] - m[1, 1] - m[2, 2], m[0, 1] + m[1, 0], m[0, 2] + m[2, 0]],
            [m[0, 2] - m[2, 0], m[0, 1] + m[1, 0], m[1, 1] - m[0, 0] - m[2, 2], m[1, 2] + m[2, 1]],
            [m[1, 0] - m[0, 1], m[0, 2] + m[2, 0], m[1, 2] + m[2, 1], m[2, 2] - m[0, 0] - m[1, 1]],
        ]
    )
    w, x, y, z = np.linalg.eigh(k)[1][:, -1].tolist()
    return w, x, y, z


def run(me: Process) -> None:
    """Forward until the process is to stop; without a router of the graph, look for one and report it."""
    settings, driver = load_settings(), ackermann_driver()
    topics = settings.forwarded_topics(me.bus.vehicle_name, tuple(me.options.get("estimators", ())), driver)
    tap, camera = me.bus.tap(*topics), load(CONFIG_DIR / "camera.yaml", Camera)
    me.ready()
    ticker, retry, static = Ticker(RATE_HZ), Ticker(1 / RETRY_S), Ticker(1 / STATIC_S)
    node: RosNode | None = None
    with ExitStack() as stack:
        while me.running():
            ticker.sleep()
            ticker.due()
            arrived = tap.drain()
            if node is None and retry.due():
                node = _join_graph(stack, settings)
                send = {key: node.publisher(topic) for key, topic in topics.items()} if node else {}
                send_pose = node.publisher(TF_STATIC, latched=True) if node else None
                pass_state = _state_sender(me.bus, node, settings.state, driver) if node else None
            if node is None or send_pose is None or pass_state is None:
                me.alive(Health.WARN, f"no ROS 2 router at {settings.router}; start rmw_zenohd")
                continue
            for key, data, published_s in arrived:
                send[key](data, published_s)
            pass_state()
            if static.due():
                send_pose(camera_pose(camera, me.now_s()), me.now_s())
            me.count_step()


def _state_sender(
    bus: Bus, node: RosNode, name: str | None, driver: AckermannSettings | None
) -> Callable[[], None]:
    """A function that publishes the newest state in the graph, if one has arrived, to the actuator."""
    if name is None or driver is None:
        return lambda: None
    topic = state_topic(driver)
    newest, send = node.subscriber(RosTopic(name, ros_name(topic.type))), bus.forwarder(topic.key)

    def send_newest() -> None:
        data = newest()
        if data is not None:
            send(data)

    return send_newest


def _join_graph(stack: ExitStack, settings: RosSettings) -> RosNode | None:
    """A node in the graph; None while its router cannot be reached."""
    try:
        graph = stack.enter_context(open_graph({**SESSION, "connect/endpoints": [settings.router]}))
    except ConnectionError:
        return None
    return RosNode(graph, domain=settings.domain, name=settings.node)


if __name__ == "__main__":
    with process() as me:
        run(me)
