"""Attacks on the bus of a drive with real sessions: number of foreign or malformed messages that are acted upon.

Processes of a drive with keys take messages as in a drive. Each attack sends its share of the messages to the
consumers of commands, decisions, images or states; a message that a consumer takes is acted upon. Afterwards
a genuine message must arrive, so that a broken network does not count as a safe one. The same messages against
a drive without keys are a control of the measurement: there they are acted upon.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trepid.bus import Bus, Graph, Latest, free_endpoint, open_bus, open_graph
from trepid.clock import Stamp, nanoseconds, stamp_of, stamper
from trepid.messages import Command, Decision, Frame, VehicleState
from trepid.security import (
    LAUNCHER,
    OBSERVER,
    Security,
    certificate,
    load_security,
    session_settings,
)
from trepid.topics import CAMERA_IMAGE, COMMAND, DECISION, VEHICLE_STATE, Topic, estimate_topic
from trepid.wire import to_cdr

CAR = "shuttle"
PATIENCE_S = 10.0  # for a genuine message
SETTLE_S = 0.3  # for the last forged messages
PACE_S = 2e-4  # between forged messages
OVERSIZE_BYTES = 20 * 2**20
PUBLISHES = {
    "camera": (CAMERA_IMAGE.key,),
    "supervisor": (DECISION.key,),
    "controller": (COMMAND.key,),
    "vehicle": (VEHICLE_STATE.key,),
    "cv": (estimate_topic("cv").key,),
}


def bench_security(seed: int, *, messages: int = 10_000) -> dict[str, Any]:
    """Messages sent and acted upon by attack; ``acted_upon`` in total."""
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        drive = stack.enter_context(secured_drive(Path(folder)))
        attacks = [*foreign(drive), *wrong_roles(drive), *broken_messages(drive, rng)]
        share = -(-messages // len(attacks))
        rows = {attack.name: attack.run(drive, share) for attack in attacks}
    with open_drive() as drive:
        control = forge_messages(drive, "no keys at all (for comparison)", {}).run(drive, share)
    total = {key: sum(row[key] for row in rows.values()) for key in ("sent", "acted_upon")}
    return {"attacks": rows, "comparison": {"no keys at all": control}, **total}


class AttackedDrive(NamedTuple):
    """The processes of a drive that take part in the attacks, all in this process."""

    endpoint: str
    keys: Path | None
    buses: Mapping[str, Bus]
    consumers: Mapping[str, Latest[Any]]  # of commands, decisions and images by key
    genuine: Mapping[str, Callable[[], None]]  # sends a genuine message, by key

    def settings(self, role: str, folder: Path | None = None) -> dict[str, Any]:
        """Settings of a session of an attacker with the keys of ``role`` in ``folder``."""
        security = with_keys(folder or self.keys)
        return session_settings(role, connect=self.endpoint, security=security)


def with_keys(keys: Path | None) -> Security:
    """The settings of the car with other keys."""
    return load_security().model_copy(update={"keys": keys, "listen": None})


@contextmanager
def secured_drive(folder: Path) -> Iterator[AttackedDrive]:
    """A drive with keys of its own in ``folder``."""
    from vehicle.certificates import create

    create(folder / "own", [LAUNCHER, OBSERVER, *PUBLISHES])
    create(folder / "foreign", ["controller"])
    with open_drive(folder / "own") as drive:
        yield drive


@contextmanager
def open_drive(keys: Path | None = None) -> Iterator[AttackedDrive]:
    """Sessions of launcher, camera, supervisor, controller and vehicle; the last three consume."""
    security, endpoint = with_keys(keys), free_endpoint()
    if keys is not None:
        endpoint = endpoint.replace("tcp/", "tls/")
    with ExitStack() as stack:
        stack.enter_context(
            open_bus(
                CAR,
                time.time,
                listen=endpoint,
                further=session_settings(LAUNCHER, publishes=PUBLISHES, listen=endpoint, security=security),
            )
        )
        buses = {
            role: stack.enter_context(
                open_bus(
                    CAR,
                    time.time,
                    connect=endpoint,
                    further=session_settings(role, publishes=PUBLISHES, connect=endpoint, security=security),
                )
            )
            for role in PUBLISHES
        }
        consumers: dict[str, Latest[Any]] = {
            COMMAND.key: buses["vehicle"].latest(COMMAND),
            DECISION.key: buses["controller"].latest(DECISION),
            CAMERA_IMAGE.key: buses["cv"].latest(CAMERA_IMAGE),
            VEHICLE_STATE.key: buses["supervisor"].latest(VEHICLE_STATE),
        }
        genuine = {
            topic.key: _sender(buses[topic.key.split("/")[0]], topic)
            for topic in (COMMAND, DECISION, CAMERA_IMAGE, VEHICLE_STATE)
        }
        drive = AttackedDrive(endpoint, keys, buses, consumers, genuine)
        for key in consumers:
            if not arrives(drive, key):
                raise RuntimeError(f"no genuine message arrives on {key}")
        yield drive


def _sender(bus: Bus, topic: Topic[Any]) -> Callable[[], None]:
    send = bus.publisher(topic)
    return lambda: send(message_of(topic))


def message_of(topic: Topic[Any]) -> Any:
    """A valid message of ``topic`` with the present time."""
    now_s = time.time()
    if topic.type is Command:
        return Command(t_s=now_s, road_wheel_angle_rad=0.3, speed_mps=15.0, accel_mps2=2.0)
    if topic.type is Frame:
        return Frame(t_s=now_s, image=np.zeros((24, 32, 3), np.uint8))
    if topic.type is VehicleState:
        return VehicleState(
            t_s=now_s, speed_mps=1.0, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
        )
    return replace(_decision(), t_s=now_s, decided_s=now_s)


@cache
def _decision() -> Decision:
    """The first decision of a supervisor without inputs."""
    from supervisor.supervisor import build

    return build().step({}, None, None, None, now_s=0.0)


def arrives(drive: AttackedDrive, key: str) -> bool:
    """Whether a genuine message arrives at its consumer within PATIENCE_S."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        drive.genuine[key]()
        time.sleep(0.02)
        if drive.consumers[key].take() is not None:
            time.sleep(SETTLE_S)
            drive.consumers[key].take()  # the last of several
            return True
    return False


class Attack(NamedTuple):
    """A session of the attacker, the topics attacked, and the bytes and attachment of its next message."""

    name: str
    settings: Mapping[str, Any]
    keys: tuple[str, ...]
    forge: Callable[[str], tuple[bytes, bytes | None]]

    def run(self, drive: AttackedDrive, count: int) -> dict[str, Any]:
        """Send ``count`` messages; how many consumers acted upon, and whether genuine ones arrive afterwards."""
        acted, before = 0, {key: drive.consumers[key].malformed for key in self.keys}
        try:
            with open_graph({**SENDER, **self.settings}) as graph:
                acted = self._send(graph, drive, count)
            refused = False
        except ConnectionError:
            refused = True
        malformed = sum(drive.consumers[key].malformed - before[key] for key in self.keys)
        return {
            "sent": count,
            "acted_upon": acted,
            "counted_as_malformed": malformed,
            "session_refused": refused,
            "genuine_arrive_after": all(arrives(drive, key) for key in self.keys),
        }

    def _send(self, graph: Graph, drive: AttackedDrive, count: int) -> int:
        senders = {key: graph.publisher(f"trepid/{CAR}/{key}") for key in self.keys}
        time.sleep(1.0)  # for connections by gossip
        acted = 0
        for number in range(count):
            key = self.keys[number % len(self.keys)]
            senders[key](*self.forge(key))
            time.sleep(PACE_S)
            acted += drive.consumers[key].take() is not None
        until_s = time.monotonic() + SETTLE_S
        while time.monotonic() < until_s:
            acted += sum(drive.consumers[key].take() is not None for key in self.keys)
            time.sleep(PACE_S)
        return acted


SENDER = {
    "mode": "peer",
    "scouting/gossip/enabled": True,
    "listen/endpoints": ["tcp/127.0.0.1:0"],
    "connect/timeout_ms": 1000,
    "connect/exit_on_failure": False,
}
TOPICS = {topic.key: topic for topic in (COMMAND, DECISION, CAMERA_IMAGE, VEHICLE_STATE)}


def forge_messages(drive: AttackedDrive, name: str, settings: Mapping[str, Any]) -> Attack:
    """Plausible messages on all topics from a session that has no right to any."""
    stamp = stamper(time.time)
    return Attack(
        name,
        {"connect/endpoints": [drive.endpoint], **settings},
        tuple(TOPICS),
        lambda key: (to_cdr(message_of(TOPICS[key])), stamp()),
    )


def foreign(drive: AttackedDrive) -> Iterator[Attack]:
    """Attackers without a certificate of the car."""
    assert drive.keys is not None
    stranger = drive.settings("controller", drive.keys.parent / "foreign")
    yield forge_messages(drive, "certificate of another authority", stranger)
    knows = stranger["transport/link/tls"] | {"root_ca_certificate": str(certificate(drive.keys, "ca"))}
    yield forge_messages(
        drive, "certificate of another authority, trusts the car's", {**stranger, "transport/link/tls": knows}
    )
    bare = {"root_ca_certificate": str(certificate(drive.keys, "ca")), "verify_name_on_connect": True}
    yield forge_messages(drive, "TLS without a certificate", {"transport/link/tls": bare})
    plain = drive.endpoint.replace("tls/", "tcp/")
    yield forge_messages(drive, "TCP without TLS", {"connect/endpoints": [plain]})


def wrong_roles(drive: AttackedDrive) -> Iterator[Attack]:
    """A process of the car, taken over, that publishes what others may."""
    for role in ("cv", OBSERVER, LAUNCHER):
        yield forge_messages(drive, f"wrong topics for the role {role}", drive.settings(role))


def broken_messages(drive: AttackedDrive, rng: np.random.Generator) -> Iterator[Attack]:
    """Bytes of the right role that are not valid messages, or old messages."""
    controller, stamp = drive.settings("controller"), stamper(time.time)
    whole = to_cdr(message_of(COMMAND))
    shapes: dict[str, Callable[[str], bytes]] = {
        "random bytes as a command": lambda _: rng.bytes(int(rng.integers(0, 200))),
        "a command cut short": lambda _: whole[: int(rng.integers(0, len(whole)))],
        "another type as a command": lambda _: to_cdr(message_of(DECISION)),
    }
    for name, shape in shapes.items():
        yield Attack(name, controller, (COMMAND.key,), lambda key, shape=shape: (shape(key), stamp()))  # type: ignore[misc]
    huge = bytes(OVERSIZE_BYTES)
    yield Attack(
        "oversized command",
        controller,
        (COMMAND.key,),
        lambda _: (huge if rng.random() < 0.02 else huge[: 2**19], stamp()),
    )
    yield Attack(
        "replayed command", controller, (COMMAND.key,), lambda _: (whole, _replayable_attachment(drive))
    )


def _replayable_attachment(drive: AttackedDrive) -> bytes:
    """The attachment of the newest command that the vehicle took, as a listener on the network receives it."""
    taken: Stamp = drive.consumers[COMMAND.key].stamp
    attachment = bytearray(stamper(time.time)())
    attachment[:8] = taken.sequence.to_bytes(8, "little")
    attachment[8:16] = nanoseconds(taken.published_s).to_bytes(8, "little")
    attachment[17:] = taken.publisher
    assert stamp_of(bytes(attachment)) == taken
    return bytes(attachment)
