"""The messages that the viewers draw, in ROS 2 CDR: types of ROS 2, and ``foxglove_msgs/ImageAnnotations``.

The fields of ``foxglove_msgs`` are those of the published schemas (github.com/foxglove/foxglove-sdk, schemas/ros2).
A definition stands in every file, so that a viewer needs none of its own.
"""

from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from trepid.clock import NANO, nanoseconds
from trepid.types import Array

CAMERA_INFO, ANNOTATIONS, MARKERS = "viewer/camera_info", "viewer/annotations", "viewer/markers"
DRIVEN, TRANSFORMS = "viewer/driven", "tf"
TYPES = {
    CAMERA_INFO: "sensor_msgs/msg/CameraInfo",
    ANNOTATIONS: "foxglove_msgs/msg/ImageAnnotations",
    MARKERS: "visualization_msgs/msg/MarkerArray",
    DRIVEN: "nav_msgs/msg/Path",
    TRANSFORMS: "tf2_msgs/msg/TFMessage",
}
"""Key of a topic -> its type."""
POINTS, LINE_LOOP, LINE_STRIP = 1, 2, 3  # types of a PointsAnnotation
_FOXGLOVE = {
    "Point2": "float64 x\nfloat64 y\n",
    "Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n",
    "CircleAnnotation": """\
builtin_interfaces/Time timestamp
foxglove_msgs/Point2 position
float64 diameter
float64 thickness
foxglove_msgs/Color fill_color
foxglove_msgs/Color outline_color
""",
    "PointsAnnotation": """\
builtin_interfaces/Time timestamp
uint8 UNKNOWN=0
uint8 POINTS=1
uint8 LINE_LOOP=2
uint8 LINE_STRIP=3
uint8 LINE_LIST=4
uint8 type
foxglove_msgs/Point2[] points
foxglove_msgs/Color outline_color
foxglove_msgs/Color[] outline_colors
foxglove_msgs/Color fill_color
float64 thickness
""",
    "TextAnnotation": """\
builtin_interfaces/Time timestamp
foxglove_msgs/Point2 position
string text
float64 font_size
foxglove_msgs/Color text_color
foxglove_msgs/Color background_color
""",
    "ImageAnnotations": """\
foxglove_msgs/CircleAnnotation[] circles
foxglove_msgs/PointsAnnotation[] points
foxglove_msgs/TextAnnotation[] texts
""",
}


def _store() -> Any:
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _FOXGLOVE.items():
        store.register(get_types_from_msg(text, f"foxglove_msgs/msg/{name}"))
    return store


_STORE = _store()


def new(name: str, **fields: Any) -> Any:
    """A message of the type ``name``, such as ``geometry_msgs/Point``."""
    return _STORE.types[name.replace("/", "/msg/")](**fields)


def encode(key: str, message: Any) -> bytes:
    """The CDR bytes of a message of the topic ``key``."""
    return bytes(_STORE.serialize_cdr(message, TYPES[key]))


def definition(key: str) -> str:
    """The ROS 2 definition of the messages of the topic ``key``, with all types that it contains."""
    text, _ = _STORE.generate_msgdef(TYPES[key], ros_version=2)
    return str(text)


def stamp(t_s: float) -> Any:
    """``t_s`` as ``builtin_interfaces/Time``."""
    whole_ns = nanoseconds(t_s)
    return new("builtin_interfaces/Time", sec=whole_ns // NANO, nanosec=whole_ns % NANO)


def header(t_s: float, frame: str) -> Any:
    """A ``std_msgs/Header``."""
    return new("std_msgs/Header", stamp=stamp(t_s), frame_id=frame)


def point(x: float, y: float, z: float = 0.0) -> Any:
    """A ``geometry_msgs/Point`` [m]."""
    return new("geometry_msgs/Point", x=float(x), y=float(y), z=float(z))


def pose(at: Any, turn: Array) -> Any:
    """A ``geometry_msgs/Pose`` at the point ``at``, turned by the quaternion ``turn`` (x, y, z, w)."""
    return new("geometry_msgs/Pose", position=at, orientation=quaternion(turn))


def quaternion(turn: Array) -> Any:
    """A ``geometry_msgs/Quaternion`` of (x, y, z, w)."""
    return new("geometry_msgs/Quaternion", **dict(zip("xyzw", map(float, turn), strict=True)))
