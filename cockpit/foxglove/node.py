"""Process that serves the topics of a drive to Foxglove and Lichtblick, as they are, and what these viewers draw.

The server has no capability but to send: no viewer changes anything. Pictures are read, and messages of the viewers
derived, only while a viewer subscribes to them. Needs the extra ``foxglove``.
"""

from typing import TYPE_CHECKING, Any

from cockpit.foxglove.convert import DEFINITIONS
from cockpit.foxglove.scene import Scene
from trepid.bus import Bus
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clock import nanoseconds
from trepid.config import CONFIG_DIR, Settings, load
from trepid.processes.process import Process, process
from trepid.recording.writer import RECORDED
from trepid.topics import CAMERA_COMPRESSED, SIM_TRUTH, VEHICLE_STATE, topic_of
from trepid.wire import definition, ros_name

if TYPE_CHECKING:
    from foxglove import Channel

PERIOD_S = 0.03  # between two looks at the bus
IDLE_S = 0.5  # the same without a viewer
SMALL = tuple(key for key in RECORDED if key != CAMERA_COMPRESSED.key)
POSED = frozenset({SIM_TRUTH.key, VEHICLE_STATE.key})
"""Topics from which the pose follows; they are read without a viewer too."""


class ServerOptions(Settings):
    """What the launcher gives to the process as ``foxglove``."""

    port: int
    what: str


class Feed:
    """The channels of the server, and the messages of the bus that go into them."""

    def __init__(self, bus: Bus, scene: Scene) -> None:
        self._bus, self._scene = bus, scene
        self._channels: dict[str, Channel] = {}
        self._tap = bus.tap(*SMALL)
        self._pictures: Any = None
        for key, (name, text) in DEFINITIONS.items():
            self._add(key, name, text)
        self._add(CAMERA_COMPRESSED.key, ros_name(CAMERA_COMPRESSED.type), definition(CAMERA_COMPRESSED.type))

    @property
    def is_watched(self) -> bool:
        """True while a viewer subscribes to a topic."""
        return any(channel.has_sinks() for channel in self._channels.values())

    def turn(self) -> None:
        """Pass on what has arrived."""
        self._look(self._channels[CAMERA_COMPRESSED.key].has_sinks())
        derived = any(self._channels[key].has_sinks() for key in DEFINITIONS)
        for key, data, at_s in self._pictures.drain() if self._pictures is not None else ():
            self._pass(key, data, at_s)
        for key, data, at_s in self._tap.drain():
            self._pass(key, data, at_s)
            if derived or key in POSED:
                for name, content in self._scene.step(key, data):
                    self._pass(name, content, at_s)

    def close(self) -> None:
        """End the subscriptions."""
        self._tap.close()
        self._look(False)

    def _look(self, at: bool) -> None:
        """Subscribe to pictures, or end it."""
        if at and self._pictures is None:
            self._pictures = self._bus.tap(CAMERA_COMPRESSED.key, kept=2)
        elif not at and self._pictures is not None:
            self._pictures.close()
            self._pictures = None

    def _add(self, key: str, name: str, text: str) -> "Channel":
        from foxglove import Channel, Schema

        schema = Schema(name=name, encoding="ros2msg", data=text.encode())
        self._channels[key] = Channel(f"/{key}", schema=schema, message_encoding="cdr")
        return self._channels[key]

    def _pass(self, key: str, data: bytes, at_s: float) -> None:
        channel = self._channels.get(key)
        if channel is None:
            topic = topic_of(key)
            if topic is None:
                return
            channel = self._add(key, ros_name(topic.type), definition(topic.type))
        if channel.has_sinks():
            channel.log(data, log_time=nanoseconds(at_s))


def run(me: Process) -> None:
    """Serve until the process is to stop."""
    import foxglove

    options = ServerOptions.model_validate(me.options["foxglove"])
    scene = Scene(load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle))
    feed = Feed(me.bus, scene)
    server = foxglove.start_server(name=f"trepid: {options.what}", host="127.0.0.1", port=options.port)
    me.ready()
    while me.running():
        feed.turn()
        me.count_step()
        me.bus.wait(timeout_s=PERIOD_S if feed.is_watched else IDLE_S)
    feed.close()
    server.stop()


if __name__ == "__main__":
    with process() as me:
        run(me)
