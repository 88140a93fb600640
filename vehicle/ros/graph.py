"""Names, type hashes, liveliness tokens and attachments of a ROS 2 graph over Zenoh, as rmw_zenoh_cpp has them.

A message of a topic has the key ``<domain>/<topic>/<type>/<hash>``, where the type is ``pkg::msg::dds_::Name_`` and
the hash RIHS01 (REP 2016). Nodes, publishers and subscribers declare tokens, from which ``ros2 topic list`` has its
names:

    @ros2_lv/<domain>/<session>/<node>/<entity>/<kind>/<enclave>/<namespace>/<node name>
    … and for publishers and subscribers /<topic>/<type>/<hash>/<QoS>

with ``%`` for every ``/`` in names. Source: rmw_zenoh, docs/design.md and liveliness_utils.cpp (Jazzy and later).
"""

import os
import re
from collections.abc import Callable
from typing import NamedTuple

from trepid.bus import Graph
from trepid.clock import GID_BYTES, LAYOUT, nanoseconds
from trepid.wire import STORE

NOTHING = "%"  # no enclave, no namespace
NODE_ID = 0
PUBLISHER, SUBSCRIBER = "MP", "MS"  # kinds of entities
SENSOR_QOS = (
    "2::,1:,:,:,,"  # best effort, volatile, keep the last one; deadline, lifespan and liveliness by default
)
LATCHED_QOS = ":1:,1:,:,:,,"  # reliable, transient local, keep the last one

Publish = Callable[[bytes, float], None]
"""Publishes CDR bytes with the time of their first publication [s]."""


class RosTopic(NamedTuple):
    """A topic of the graph: name from the root, such as ``/tf_static``, and ROS 2 type."""

    name: str
    type: str

    @property
    def key(self) -> str:
        """Name, type and hash, as in keys and tokens."""
        return f"{dds_name(self.type)}/{STORE.hash_rihs01(self.type)}"


def ros_topic_name(name: str) -> str:
    """``name`` with every character that ROS 2 does not allow in a topic replaced by ``_``."""
    words = [re.sub(r"[^A-Za-z0-9_]", "_", word) for word in name.strip("/").split("/")]
    return "/" + "/".join(f"_{word}" if word[:1].isdigit() else word for word in words)


def dds_name(ros_type: str) -> str:
    """``pkg::msg::dds_::Name_`` of the ROS 2 type ``pkg/msg/Name``."""
    package, kind, name = ros_type.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def topic_key(domain: int, topic: RosTopic) -> str:
    """Key of the messages of ``topic``."""
    return f"{domain}/{topic.name.lstrip('/')}/{topic.key}"


def node_token(domain: int, session: str, node: str) -> str:
    """Token of a node in the root namespace."""
    return f"@ros2_lv/{domain}/{session}/{NODE_ID}/{NODE_ID}/NN/{NOTHING}/{NOTHING}/{node}"


def endpoint_token(
    domain: int, session: str, node: str, entity: int, kind: str, topic: RosTopic, qos: str
) -> str:
    """Token of a publisher or subscriber (``kind``) of ``topic``; ``entity``: number in the session."""
    mangled = topic.name.replace("/", "%")
    own = f"{NODE_ID}/{entity}/{kind}/{NOTHING}/{NOTHING}/{node}"
    return f"@ros2_lv/{domain}/{session}/{own}/{mangled}/{topic.key}/{qos}"


class RosNode:
    """One node with publishers and subscribers in the graph of ``domain``."""

    def __init__(self, graph: Graph, *, domain: int, name: str) -> None:
        self._graph, self._domain, self._name = graph, domain, name
        self._entities = NODE_ID
        graph.token(node_token(domain, graph.session_id, name))

    def publisher(self, topic: RosTopic, *, latched: bool = False) -> Publish:
        """A publisher of ``topic``; ``latched``: subscribers that come later get the last message too."""
        send = self._graph.publisher(topic_key(self._domain, topic), cached=latched)
        self._declare(PUBLISHER, topic, LATCHED_QOS if latched else SENSOR_QOS)
        gid, sequence = os.urandom(GID_BYTES), 0

        def publish(data: bytes, published_s: float) -> None:
            nonlocal sequence
            sequence += 1
            send(data, LAYOUT.pack(sequence, nanoseconds(published_s), GID_BYTES, gid))

        return publish

    def subscriber(self, topic: RosTopic) -> Callable[[], bytes | None]:
        """A function that gives the newest CDR bytes of ``topic`` since its last call; None when none arrived."""
        newest = self._graph.newest(topic_key(self._domain, topic))
        self._declare(SUBSCRIBER, topic, SENSOR_QOS)
        return newest

    def _declare(self, kind: str, topic: RosTopic, qos: str) -> None:
        """Declare the token of the next publisher or subscriber."""
        self._entities += 1
        session = self._graph.session_id
        self._graph.token(endpoint_token(self._domain, session, self._name, self._entities, kind, topic, qos))
