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
from dataclasses import MISSING, Field, dataclass, fields
from enum import StrEnum
from typing import Any, TypeVar, cast, get_args, get_origin

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid.clock import NANO, nanoseconds, seconds
from trepid.messages import (
    Command,
    CompressedFrame,
    Decision,
    Diagnostic,
    Frame,
    Health,
    ImageStatistics,
    LeadVehicle,
    Message,
    PixelPath,
    SimTruth,
    SteeringEstimate,
    VehicleState,
)

M = TypeVar("M")
DERIVED: tuple[type, ...] = (
    ImageStatistics,
    SteeringEstimate,
    LeadVehicle,
    VehicleState,
    Decision,
    SimTruth,
)
FRAME_ID = "rear_axle"

ACKERMANN_DRIVE = """\
float32 steering_angle
float32 steering_angle_velocity
float32 speed
float32 acceleration
float32 jerk
"""
ACKERMANN_DRIVE_STAMPED = "std_msgs/Header header\nackermann_msgs/AckermannDrive drive\n"


class WireError(Exception):
    """Bytes that are not a message of the type of their topic."""


@dataclass(frozen=True, slots=True)
class FieldCodec:
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


FLOAT = FieldCodec("float64", float, float)
OPTIONAL_FLOAT = FieldCodec("float64", _absent_as_nan, _nan_as_absent)
FLOATS = FieldCodec("float64[]", lambda v: np.array(v, np.float64), lambda v: tuple(v.tolist()))
OPTIONAL_FLOATS = FieldCodec(
    "float64[]",
    lambda v: np.array(v, np.float64),  # None becomes NaN
    lambda v: tuple(map(_nan_as_absent, v.tolist())),
)
STRINGS = FieldCodec("string[]", list, tuple)
PIXEL_PATH = FieldCodec(
    "float64[]",
    lambda v: np.array(v, np.float64).ravel(),
    lambda v: tuple(map(tuple, v.reshape(-1, 2).tolist())),
)
CODECS: dict[Any, FieldCodec] = {
    float: FLOAT,
    float | None: OPTIONAL_FLOAT,
    int: FieldCodec("int32", int, int),
    bool: FieldCodec("bool", bool, bool),
    bool | None: FieldCodec("int8", _absent_as_minus_one, _minus_one_as_absent),
    str: FieldCodec("string", str, str),
    tuple[float, ...]: FLOATS,
    tuple[float | None, ...]: OPTIONAL_FLOATS,
    tuple[str, ...]: STRINGS,
    PixelPath: PIXEL_PATH,
}


def _codec(annotation: Any) -> FieldCodec:
    if isinstance(annotation, type) and issubclass(annotation, StrEnum):
        return FieldCodec("string", str, annotation)
    return CODECS[annotation]


def msg_text(message_type: type) -> str:
    """The ``.msg`` definition of a derived message type, for a ROS 2 build."""
    lines = ["# Derived from trepid.messages. SI units, ISO 8855 signs (left positive); NaN = absent."]
    for field in fields(message_type):
        if field.name == "t_s":
            lines.append("std_msgs/Header header")
        else:
            lines.append(f"{_codec(field.type).ros_type} {field.name}")
    return "\n".join(lines) + "\n"


def ros_name(message_type: type) -> str:
    """ROS 2 type name of a message class."""
    standard = {
        Frame: "sensor_msgs/msg/Image",
        CompressedFrame: "sensor_msgs/msg/CompressedImage",
        Command: "ackermann_msgs/msg/AckermannDriveStamped",
        Diagnostic: "diagnostic_msgs/msg/DiagnosticArray",
    }
    return standard.get(message_type, f"trepid_msgs/msg/{message_type.__name__}")


def definition(message_type: type) -> str:
    """The ROS 2 definition of a message class with all types that it contains, for recordings."""
    text, _ = STORE.generate_msgdef(ros_name(message_type), ros_version=2)
    return str(text)


def _typestore() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    store.register(get_types_from_msg(ACKERMANN_DRIVE, "ackermann_msgs/msg/AckermannDrive"))
    store.register(get_types_from_msg(ACKERMANN_DRIVE_STAMPED, "ackermann_msgs/msg/AckermannDriveStamped"))
    for message_type in DERIVED:
        store.register(get_types_from_msg(msg_text(message_type), ros_name(message_type)))
    return store


STORE = _typestore()
ROS = STORE.types


def _header(t_s: float | None) -> Any:
    stamp_ns = 0 if t_s is None else nanoseconds(t_s)
    stamp = ROS["builtin_interfaces/msg/Time"](sec=stamp_ns // NANO, nanosec=stamp_ns % NANO)
    return ROS["std_msgs/msg/Header"](stamp=stamp, frame_id=FRAME_ID)


def _stamp_s(header: Any) -> float | None:
    stamp_ns = header.stamp.sec * NANO + header.stamp.nanosec
    return seconds(stamp_ns) if stamp_ns else None


def _frame_to_ros(frame: Frame) -> Any:
    height, width, channels = frame.image.shape
    return ROS[ros_name(Frame)](
        header=_header(frame.t_s),
        height=height,
        width=width,
        encoding="bgr8",
        is_bigendian=0,
        step=width * channels,
        data=np.ascontiguousarray(frame.image).reshape(-1),
    )


def _frame_from_ros(ros: Any) -> Frame:
    if ros.encoding != "bgr8":
        raise WireError(f"camera image is encoded {ros.encoding!r}, expected 'bgr8'")
    return Frame(t_s=_required(_stamp_s(ros.header)), image=ros.data.reshape(ros.height, ros.width, 3))


def _compressed_to_ros(frame: CompressedFrame) -> Any:
    data = np.frombuffer(frame.jpeg, np.uint8)
    return ROS[ros_name(CompressedFrame)](header=_header(frame.t_s), format="jpeg", data=data)


def _compressed_from_ros(ros: Any) -> CompressedFrame:
    return CompressedFrame(t_s=_required(_stamp_s(ros.header)), jpeg=ros.data.tobytes())


def _command_to_ros(command: Command) -> Any:
    drive = ROS["ackermann_msgs/msg/AckermannDrive"](
        steering_angle=command.road_wheel_angle_rad,
        steering_angle_velocity=command.road_wheel_rate_radps,
        speed=command.speed_mps,
        acceleration=command.accel_mps2,
        jerk=command.jerk_mps3,
    )
    return ROS[ros_name(Command)](header=_header(command.t_s), drive=drive)


def _command_from_ros(ros: Any) -> Command:
    return Command(
        t_s=_stamp_s(ros.header),
        road_wheel_angle_rad=ros.drive.steering_angle,
        road_wheel_rate_radps=ros.drive.steering_angle_velocity,
        speed_mps=ros.drive.speed,
        accel_mps2=ros.drive.acceleration,
        jerk_mps3=ros.drive.jerk,
    )


LEVELS = {Health.OK: 0, Health.WARN: 1, Health.ERROR: 2}


def _diagnostic_to_ros(diagnostic: Diagnostic) -> Any:
    pair = ROS["diagnostic_msgs/msg/KeyValue"]
    status = ROS["diagnostic_msgs/msg/DiagnosticStatus"](
        level=LEVELS[diagnostic.health],
        name=diagnostic.process,
        message=diagnostic.message,
        hardware_id="",
        values=[pair(key=key, value=value) for key, value in diagnostic.values],
    )
    return ROS[ros_name(Diagnostic)](header=_header(diagnostic.t_s), status=[status])


def _diagnostic_from_ros(ros: Any) -> Diagnostic:
    (status,) = ros.status
    health = {level: health for health, level in LEVELS.items()}[status.level]
    return Diagnostic(
        t_s=_required(_stamp_s(ros.header)),
        process=status.name,
        health=health,
        message=status.message,
        values=tuple((pair.key, pair.value) for pair in status.values),
    )


def _derived_to_ros(message: Message) -> Any:
    values = {}
    for field in fields(message):
        if field.name == "t_s":
            values["header"] = _header(message.t_s)
        else:
            values[field.name] = _codec(field.type).encode(getattr(message, field.name))
    return ROS[ros_name(type(message))](**values)


def derived_from_ros(ros: Any, message_type: type[M]) -> M:
    """The message of a derived type in a ROS object, which may be of an older version: missing fields are absent.

    Raises WireError when a required field is missing.
    """
    values: dict[str, Any] = {}
    for field in fields(cast(Any, message_type)):
        if field.name == "t_s":
            t_s = _stamp_s(ros.header)
            values["t_s"] = t_s if field.type == float | None else _required(t_s)
        elif hasattr(ros, field.name):
            values[field.name] = _codec(field.type).decode(getattr(ros, field.name))
        else:
            values[field.name] = _absent(field)
    return message_type(**values)


def _absent(field: Field[Any]) -> Any:
    """The value of a missing field. Raises WireError when the field must have a value."""
    if field.default is not MISSING:
        return field.default
    if type(None) in get_args(field.type):
        return None
    if get_origin(field.type) is tuple:
        return ()
    raise WireError(f"it has no field {field.name}")


def _required(t_s: float | None) -> float:
    if t_s is None:
        raise WireError("message has no time stamp")
    return t_s


def to_cdr(message: Message) -> bytes:
    """ROS 2 CDR bytes of a message."""
    match message:
        case Frame():
            ros = _frame_to_ros(message)
        case CompressedFrame():
            ros = _compressed_to_ros(message)
        case Command():
            ros = _command_to_ros(message)
        case Diagnostic():
            ros = _diagnostic_to_ros(message)
        case _:
            ros = _derived_to_ros(message)
    return bytes(STORE.serialize_cdr(ros, ros_name(type(message))))


def from_cdr(data: bytes, message_type: type[M]) -> M:
    """The message of class ``message_type`` in CDR bytes. Raises WireError when they do not hold one."""
    from_ros: dict[type, Callable[[Any], Any]] = {
        Frame: _frame_from_ros,
        CompressedFrame: _compressed_from_ros,
        Command: _command_from_ros,
        Diagnostic: _diagnostic_from_ros,
    }
    try:
        ros = STORE.deserialize_cdr(data, ros_name(message_type))
        if message_type in from_ros:
            return cast(M, from_ros[message_type](ros))
        return derived_from_ros(ros, message_type)
    except WireError:
        raise
    except Exception as error:  # rosbags does not catch the exceptions of numpy and struct for foreign bytes
        raise WireError(f"not a {ros_name(message_type)}: {type(error).__name__}: {error}") from error
