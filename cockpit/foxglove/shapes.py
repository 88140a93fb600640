"""The parts of the viewers' messages: lines and texts on pictures, markers, transforms, calibration."""

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from cockpit.foxglove import ros
from trepid.car.camera import Camera
from trepid.clothoid import Lane
from trepid.messages import Decision
from trepid.types import Array
from trepid.wire import CAMERA_FRAME, VEHICLE_FRAME

RGB = tuple[float, float, float]
CALM, AFRAID = (0.0, 0.62, 0.45), (0.78, 0.16, 0.16)
WHITE: RGB = (1.0, 1.0, 1.0)
STEPS = 20  # points of a lane
LIFETIME_S = 0.5  # of a marker without a following one
CORNER_PX = 0.5  # the origin of annotations is the corner of the first pixel; that of Trepid is its centre
FONT_PX = 10.0
LINE_STRIP, CUBE, TEXT, DELETE_ALL = 4, 1, 9, 3  # of visualization_msgs/Marker
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def camera_info(camera: Camera, t_s: float) -> Any:
    """The calibration as ``sensor_msgs/CameraInfo``; distortion k1 k2 p1 p2 k3 k4 k5 k6."""
    projection = np.column_stack([camera.intrinsics, np.zeros(3)])
    region = dict(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False)
    return ros.new(
        "sensor_msgs/CameraInfo",
        header=ros.header(t_s, CAMERA_FRAME),
        height=camera.height_px,
        width=camera.width_px,
        distortion_model="plumb_bob" if len(camera.lens) == 5 else "rational_polynomial",
        d=camera.lens,
        k=camera.intrinsics.ravel(),
        r=np.eye(3).ravel(),
        p=projection.ravel(),
        binning_x=0,
        binning_y=0,
        roi=ros.new("sensor_msgs/RegionOfInterest", **region),
    )


def camera_transform(camera: Camera) -> tuple[tuple[float, float, float], Array]:
    """Place [m] and quaternion (x, y, z, w) of the optical axes of the camera in the frame of the rear axle."""
    turn = cv2.Rodrigues(camera.optical_from_vehicle.T)[0].ravel()  # axis times angle
    angle_rad = float(np.linalg.norm(turn))
    axis = turn / angle_rad if angle_rad else np.zeros(3)
    return (camera.x_m, camera.y_m, camera.height_m), np.array(
        [*(math.sin(angle_rad / 2) * axis), math.cos(angle_rad / 2)]
    )


def transform(t_s: float, parent: str, child: str, place_m: tuple[float, float, float], turn: Array) -> Any:
    """A ``geometry_msgs/TransformStamped``."""
    move = ros.new("geometry_msgs/Vector3", **dict(zip("xyz", place_m, strict=True)))
    moved = ros.new("geometry_msgs/Transform", translation=move, rotation=ros.quaternion(turn))
    return ros.new(
        "geometry_msgs/TransformStamped",
        header=ros.header(t_s, parent),
        child_frame_id=child,
        transform=moved,
    )


def caption(decision: Decision) -> str:
    """The decision in a line."""
    return f"{decision.mode}  fear {decision.fear:.2f}  {decision.cause}"


def fear_colour(fear: float) -> RGB:
    """Green without fear, red at fear 1."""
    share = min(max(fear, 0.0), 1.0)
    red, green, blue = (
        (1 - share) * calm + share * afraid for calm, afraid in zip(CALM, AFRAID, strict=True)
    )
    return red, green, blue


def points_of(lane: Lane, far_m: float, aside_m: float = 0.0) -> list[Any]:
    """Points up to ``far_m`` ahead, ``aside_m`` left of the centre of ``lane``."""
    return [ros.point(x_m, lane.y_m(x_m) + aside_m) for x_m in np.linspace(0.0, far_m, STEPS).tolist()]


def note(t_s: float, text: str, at_px: Sequence[float] = (2.0 - CORNER_PX, FONT_PX + 2.0 - CORNER_PX)) -> Any:
    """``text`` on the picture, its lower left corner at ``at_px`` [px]; default: in the upper left corner."""
    x, y = at_px
    return ros.new(
        "foxglove_msgs/TextAnnotation",
        timestamp=ros.stamp(t_s),
        position=ros.new("foxglove_msgs/Point2", x=x + CORNER_PX, y=y + CORNER_PX),
        text=text,
        font_size=FONT_PX,
        text_color=annotation_colour(WHITE),
        background_color=annotation_colour((0.1, 0.1, 0.1), 0.7),
    )


def line(
    t_s: float, points: list[list[float]], colour: RGB, *, loop: bool = False, filled: float = 0.0
) -> Any:
    """A line on the picture through ``points`` [px]; ``filled``: opacity of its inside."""
    return ros.new(
        "foxglove_msgs/PointsAnnotation",
        timestamp=ros.stamp(t_s),
        type=ros.LINE_LOOP if loop else ros.LINE_STRIP,
        points=[ros.new("foxglove_msgs/Point2", x=x + CORNER_PX, y=y + CORNER_PX) for x, y in points],
        outline_color=annotation_colour(colour),
        outline_colors=[],
        fill_color=annotation_colour(colour, filled),
        thickness=2.0,
    )


def annotation_colour(colour: RGB, alpha: float = 1.0) -> Any:
    """A colour of an annotation."""
    red, green, blue = colour
    return ros.new("foxglove_msgs/Color", r=red, g=green, b=blue, a=alpha)


def strip(t_s: float, name: str, number: int, points: list[Any], width_m: float, colour: RGB) -> Any:
    """A line on the road."""
    size = (width_m, 0.0, 0.0)
    return marker(t_s, name, number, kind=LINE_STRIP, size=size, colour=colour, points=points)


def marker(
    t_s: float,
    name: str,
    number: int,
    *,
    action: int = 0,
    kind: int = 0,
    pose: Any = None,
    size: tuple[float, float, float] = (1.0, 1.0, 1.0),
    colour: RGB = WHITE,
    alpha: float = 1.0,
    points: list[Any] | None = None,
    text: str = "",
) -> Any:
    """A ``visualization_msgs/Marker`` in the frame of the rear axle."""
    red, green, blue = colour
    held_ns = round(LIFETIME_S * 1e9)
    none = ros.new("builtin_interfaces/Time", sec=0, nanosec=0)
    return ros.new(
        "visualization_msgs/Marker",
        header=ros.header(t_s, VEHICLE_FRAME),
        ns=name,
        id=number,
        type=kind,
        action=action,
        pose=pose or ros.pose(ros.point(0.0, 0.0), UPRIGHT),
        scale=ros.new("geometry_msgs/Vector3", **dict(zip("xyz", size, strict=True))),
        color=ros.new("std_msgs/ColorRGBA", r=red, g=green, b=blue, a=alpha),
        lifetime=ros.new("builtin_interfaces/Duration", sec=0, nanosec=held_ns),
        frame_locked=True,
        points=points or [],
        colors=[],
        texture_resource="",
        texture=ros.new(
            "sensor_msgs/CompressedImage",
            header=ros.new("std_msgs/Header", stamp=none, frame_id=""),
            format="",
            data=np.zeros(0, np.uint8),
        ),
        uv_coordinates=[],
        text=text,
        mesh_resource="",
        mesh_file=ros.new("visualization_msgs/MeshFile", filename="", data=np.zeros(0, np.uint8)),
        mesh_use_embedded_materials=False,
    )
