"""Messages to and from ROS 2 CDR: ROS 2 and MCAP tools read the topics; Trepid needs no ROS.

Frames, Command and Diagnostic travel as the standard types of the field; every other message of
:mod:`trepid.messages` becomes ``trepid_msgs/msg/<Name>``, derived from its dataclass:

=====================  ==========================================================
Python field           .msg field
=====================  ==========================================================
``t_s: float``         ``std_msgs/Header header`` (stamp; a zero stamp is None)
``float``              ``float64``
``float | None``       ``float64``, NaN = absent
``int``                ``int32``
``bool``               ``bool``
``bool | None``        ``int8``, -1 = absent
``str``, ``StrEnum``   ``string``
``tuple[float, ...]``  ``float64[]``; of ``float | None``: NaN = absent
``tuple[str, ...]``    ``string[]``
``PixelPath``          ``float64[]``, x0 y0 x1 y1 …
=====================  ==========================================================
"""

import math
from collections.abc import Callable
from dataclasses import MISSING, Field, fields
from enum import StrEnum
from typing import Any, NamedTuple, TypeVar, get_args, get_origin

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore

from trepid.clock import NANO, nanoseconds, seconds
from trepid.messages import (
    Command,
    CompressedFrame,
    Derived,
    Diagnostic,
    Frame,
    Health,
    ImageStatistics,
    Message,
    Odometry,
    PixelPath,
    SimTruth,
)
from trepid.types import Array

M = TypeVar("M")
DERIVED: tuple[type, ...] = get_args(Derived)
_OF_SPEED, _OF_YAW_RATE = 0, 35  # variances of x and of the rotation about z in the covariance of a twist
VEHICLE_FRAME = "rear_axle"
"""Frame of the vehicle: origin below the rear axle, x forward, y left, z up (REP 103)."""
CAMERA_FRAME = "camera_optical"
"""Frame of images: z ahead, x right, y down (REP 103)."""
ROAD_FRAME = "map"
HEALTH_LEVELS = {Health.OK: 0, Health.WARN: 1, Health.ERROR: 2}
MAX_PLAIN_BYTES = 2**18
MAX_BYTES: dict[type, int] = {Frame: 2**26, CompressedFrame: 2**24}
"""Longest CDR of a message [B]; decoding a longer one would only take time. Images may be long."""
COMMAND_FIELDS = {
    "steering_angle": "road_wheel_angle_rad",
    "steering_angle_velocity": "road_wheel_rate_radps",
    "speed": "speed_mps",
    "acceleration": "accel_mps2",
    "jerk": "jerk_mps3",
}
"""Field of ackermann_msgs/AckermannDrive -> field of Command. Topics of Trepid carry the signed demand as
acceleration; ``vehicle/actuators/ackermann.py`` sends it to a car as a magnitude."""


class WireError(Exception):
    """Bytes that are not a message of the type of their topic."""


class FieldCodec(NamedTuple):
    """ROS 2 representation of one Python field type."""

    ros_type: str
    encode: Callable[[Any], Any]
    decode: Callable[[Any], Any]


def _absent_as_nan(value: float | None) -> float:
    return math.nan if value is None else value


def _nan_as_absent(value: float) -> float | None:
    return None if math.isnan(value) else value


def _absent_as_minus_one(value: bool | None) -> int:
    return -1 if value is None else int(value)


def _minus_one_as_absent(value: int) -> bool | None:
    return None if value < 0 else bool(value)


def _flat(values: tuple[Any, ...]) -> Array:
    return np.array(values, np.float64).ravel()  # None becomes NaN


CODECS: dict[Any, FieldCodec] = {
    float: FieldCodec("float64", float, float),
    float | None: FieldCodec("float64", _absent_as_nan, _nan_as_absent),
    int: FieldCodec("int32", int, int),
    bool: FieldCodec("bool", bool, bool),
    bool | None: FieldCodec("int8", _absent_as_minus_one, _minus_one_as_absent),
    str: FieldCodec("string", str, str),
    tuple[float, ...]: FieldCodec("float64[]", _flat, lambda v: tuple(v.tolist())),
    tuple[float | None, ...]: FieldCodec(
        "float64[]", _flat, lambda v: tuple(map(_nan_as_absent, v.tolist()))
    ),
    tuple[str, ...]: FieldCodec("string[]", list, tuple),
    PixelPath: FieldCodec("float64[]", _flat, lambda v: tuple(map(tuple, v.reshape(-1, 2).tolist()))),
}


def _codec(annotation: Any) -> FieldCodec:
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return FieldCodec("string", str, annotation)
    return CODECS[annotation]


class MessageCodec(NamedTuple):
    """ROS 2 representation of one class of messages: its fields but for the time stamp."""

    ros_name: str
    encode: Callable[[Any], dict[str, Any]]
    decode: Callable[[Any], dict[str, Any]]


def _from_frame(frame: Frame) -> dict[str, Any]:
    height, width, channels = frame.image.shape
    data = np.ascontiguousarray(frame.image).reshape(-1)
    size = dict(height=height, width=width, step=width * channels)
    return dict(**size, encoding="bgr8", is_bigendian=0, data=data)


def _to_frame(ros: Any) -> dict[str, Any]:
    if ros.encoding != "bgr8":
        raise WireError(f"camera image is encoded {ros.encoding!r}, expected 'bgr8'")
    return dict(image=ros.data.reshape(ros.height, ros.width, 3))


def _from_compressed(frame: CompressedFrame) -> dict[str, Any]:
    return dict(format="jpeg", data=np.frombuffer(frame.jpeg, np.uint8))


def _to_compressed(ros: Any) -> dict[str, Any]:
    return dict(jpeg=ros.data.tobytes())


def _from_command(command: Command) -> dict[str, Any]:
    values = {field: getattr(command, name) for field, name in COMMAND_FIELDS.items()}
    return dict(drive=ROS["ackermann_msgs/msg/AckermannDrive"](**values))


def _to_command(ros: Any) -> dict[str, Any]:
    return {name: getattr(ros.drive, field) for field, name in COMMAND_FIELDS.items()}


def _from_odometry(odometry: Odometry) -> dict[str, Any]:
    zero, unknown = ROS["geometry_msgs/msg/Vector3"], np.zeros(36)
    place = ROS["geometry_msgs/msg/Pose"](
        position=ROS["geometry_msgs/msg/Point"](x=0.0, y=0.0, z=0.0),
        orientation=ROS["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
    )
    motion = ROS["geometry_msgs/msg/Twist"](
        linear=zero(x=odometry.speed_mps, y=0.0, z=0.0), angular=zero(x=0.0, y=0.0, z=odometry.yaw_rate_radps)
    )
    return dict(
        child_frame_id=VEHICLE_FRAME,
        pose=ROS["geometry_msgs/msg/PoseWithCovariance"](pose=place, covariance=unknown),
        twist=ROS["geometry_msgs/msg/TwistWithCovariance"](twist=motion, covariance=unknown),
    )


def _to_odometry(ros: Any) -> dict[str, Any]:
    """Speed and yaw rate; NaN where the variance is negative, with which drivers mark what they do not measure."""
    twist, covariance = ros.twist.twist, ros.twist.covariance
    return dict(
        speed_mps=twist.linear.x if covariance[_OF_SPEED] >= 0.0 else math.nan,
        yaw_rate_radps=twist.angular.z if covariance[_OF_YAW_RATE] >= 0.0 else math.nan,
    )


def _from_diagnostic(diagnostic: Diagnostic) -> dict[str, Any]:
    pair = ROS["diagnostic_msgs/msg/KeyValue"]
    status = ROS["diagnostic_msgs/msg/DiagnosticStatus"](
        level=HEALTH_LEVELS[diagnostic.health],
        name=diagnostic.process,
        message=diagnostic.message,
        hardware_id="",
        values=[pair(key=key, value=value) for key, value in diagnostic.values],
    )
    return dict(status=[status])


def _to_diagnostic(ros: Any) -> dict[str, Any]:
    (status,) = ros.status
    health = {level: health for health, level in HEALTH_LEVELS.items()}[status.level]
    values = tuple((pair.key, pair.value) for pair in status.values)
    return dict(process=status.name, health=health, message=status.message, values=values)


def _derive_codec(message_type: type) -> MessageCodec:
    """The codec of a message type that is derived from its dataclass."""
    known = {f.name: (_codec(f.type), f) for f in fields(message_type) if f.name != "t_s"}

    def encode(message: Any) -> dict[str, Any]:
        return {name: codec.encode(getattr(message, name)) for name, (codec, _) in known.items()}

    def decode(ros: Any) -> dict[str, Any]:
        return {
            name: codec.decode(getattr(ros, name)) if hasattr(ros, name) else _absent(field)
            for name, (codec, field) in known.items()
        }

    return MessageCodec(f"trepid_msgs/msg/{message_type.__name__}", encode, decode)


def check_fields(message_type: type, store: Any) -> None:
    """Raise WireError when the definition of ``message_type`` in ``store`` lacks a field that must have a value."""
    held = {field.name for field in fields(store.types[ros_name(message_type)])}
    if "header" not in held:
        raise WireError("it has no field header")
    for field in fields(message_type):
        if field.name != "t_s" and field.name not in held:
            _absent(field)


def _absent(field: Field[Any]) -> Any:
    """The value of a missing field. Raises WireError when the field must have a value."""
    if field.default is not MISSING:
        return field.default
    if type(None) in get_args(field.type):
        return None
    if get_origin(field.type) is tuple:
        return ()
    raise WireError(f"it has no field {field.name}")


MESSAGES: dict[type, MessageCodec] = {
    Frame: MessageCodec("sensor_msgs/msg/Image", _from_frame, _to_frame),
    CompressedFrame: MessageCodec("sensor_msgs/msg/CompressedImage", _from_compressed, _to_compressed),
    Command: MessageCodec("ackermann_msgs/msg/AckermannDriveStamped", _from_command, _to_command),
    Odometry: MessageCodec("nav_msgs/msg/Odometry", _from_odometry, _to_odometry),
    Diagnostic: MessageCodec("diagnostic_msgs/msg/DiagnosticArray", _from_diagnostic, _to_diagnostic),
    **{message_type: _derive_codec(message_type) for message_type in DERIVED},
}


FRAMES: dict[type, str] = {
    Frame: CAMERA_FRAME,
    CompressedFrame: CAMERA_FRAME,
    ImageStatistics: CAMERA_FRAME,
    SimTruth: ROAD_FRAME,
    Odometry: "odom",
    Diagnostic: "",
}
"""``frame_id`` of the messages that are not in the frame of the vehicle."""


def ros_name(message_type: type) -> str:
    """ROS 2 type name of a message class."""
    return MESSAGES[message_type].ros_name


def msg_text(message_type: type) -> str:
    """The ``.msg`` definition of a derived message type, for a ROS 2 build."""
    head = "# Derived from trepid.messages. SI units, ISO 8855 signs (left positive); NaN = absent.\n"
    return head + "".join(f"{kind} {name}\n" for name, kind in _ros_fields(message_type))


def _ros_fields(message_type: type) -> list[tuple[str, str]]:
    """Name and ROS 2 type of the fields of a derived message type."""
    header = ("header", "std_msgs/Header")
    return [header if f.name == "t_s" else (f.name, _codec(f.type).ros_type) for f in fields(message_type)]


def definition(message_type: type) -> str:
    """The ROS 2 definition of a message class with all types that it contains, for recordings."""
    text, _ = STORE.generate_msgdef(ros_name(message_type), ros_version=2)
    return str(text)


def _typestore() -> Any:
    """The types of ROS 2 and those of Trepid.

    The latter are not parsed from their text, which would take a tenth of the start of every process.
    """
    types = {ros_name(one): _ros_fields(one) for one in DERIVED}
    types["ackermann_msgs/msg/AckermannDrive"] = [(name, "float32") for name in COMMAND_FIELDS]
    types[ros_name(Command)] = [("header", "std_msgs/Header"), ("drive", "ackermann_msgs/AckermannDrive")]
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register({name: ([], [(one, _node(kind)) for one, kind in pairs]) for name, pairs in types.items()})
    return store


def _node(ros_type: str) -> Any:
    """A type as the parser of rosbags gives it."""
    name, bracket, _ = ros_type.replace("/", "/msg/").partition("[")
    one = (Nodetype.NAME, name) if "/" in name else (Nodetype.BASE, (name, 0))
    return (Nodetype.SEQUENCE, (one, 0)) if bracket else one


STORE = _typestore()
ROS = STORE.types


def to_cdr(message: Message) -> bytes:
    """ROS 2 CDR bytes of a message."""
    name, encode, _ = MESSAGES[type(message)]
    stamp_ns = 0 if message.t_s is None else nanoseconds(message.t_s)
    stamp = ROS["builtin_interfaces/msg/Time"](sec=stamp_ns // NANO, nanosec=stamp_ns % NANO)
    header = ROS["std_msgs/msg/Header"](stamp=stamp, frame_id=FRAMES.get(type(message), VEHICLE_FRAME))
    return bytes(STORE.serialize_cdr(ROS[name](header=header, **encode(message)), name))


def from_cdr(data: bytes, message_type: type[M], store: Any = STORE) -> M:
    """The message of class ``message_type`` in CDR bytes. Raises WireError when they do not hold one.

    ``store``: the definitions of another version of Trepid; fields that they lack are absent.
    """
    name, _, decode = MESSAGES[message_type]
    if len(data) > MAX_BYTES.get(message_type, MAX_PLAIN_BYTES):
        raise WireError(f"not a {name}: {len(data)} bytes are too many")
    try:
        ros = store.deserialize_cdr(data, name)
        stamp_ns = ros.header.stamp.sec * NANO + ros.header.stamp.nanosec
        t_s = seconds(stamp_ns) if stamp_ns else None
        kind: Any = message_type
        if t_s is None and kind.__annotations__["t_s"] is float:
            raise WireError("message has no time stamp")
        return kind(t_s=t_s, **decode(ros))
    except WireError:
        raise
    except Exception as error:  # rosbags does not catch the exceptions of numpy and struct for foreign bytes
        raise WireError(f"not a {name}: {type(error).__name__}: {error}") from error
