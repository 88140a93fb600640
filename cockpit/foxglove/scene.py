"""What the viewers draw, from the messages of a drive: annotations of the picture, transforms, markers.

A picture is annotated when its decision arrives: the lanes of the estimates of that frame, the fused path, the
vehicle and the people ahead, and a line of text. The same decision gives the markers on the road, in the frame of
the rear axle, and the transforms from the road to the rear axle and to the camera. The pose is the true one of a
simulated car, else that of speed and yaw rate since the start.
"""

import math
from collections.abc import Iterator
from typing import Any, TypeVar

import numpy as np

from cockpit.foxglove import ros
from cockpit.foxglove.shapes import (
    CUBE,
    DELETE_ALL,
    LINE_STRIP,
    RGB,
    TEXT,
    UPRIGHT,
    WHITE,
    camera_info,
    camera_transform,
    caption,
    fear_colour,
    line,
    marker,
    note,
    points_of,
    strip,
    transform,
)
from cockpit.page.history import PathHistory
from cockpit.page.overlay import PATH_M, SIGHT, ahead_text, corners_px, overlay, size_m
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.clothoid import Lane
from trepid.messages import Decision, LeadVehicle, RoadUsers, SimTruth, SteeringEstimate, VehicleState
from trepid.topics import DECISION, LEAD_VEHICLE, ROAD_USERS, SIM_TRUTH, VEHICLE_STATE, Topic, topic_of
from trepid.wire import CAMERA_FRAME, ROAD_FRAME, VEHICLE_FRAME, WireError, from_cdr

LANES: tuple[RGB, ...] = ((0.24, 0.67, 1.0), (1.0, 0.67, 0.24), (1.0, 0.35, 1.0), (0.27, 0.78, 0.43))
LEAD: RGB = (0.9, 0.27, 0.27)
PEOPLE: RGB = (1.0, 0.88, 0.3)
AHEAD_S = 1.0  # an arrow ends where a road user is after this time
FRESH_S = 0.5  # an older estimate, leader, road user or state is not drawn
DRIVEN_PERIOD_S = 1.0
HEIGHT = 0.8  # of a drawn vehicle, relative to its track
READ = (DECISION.key, LEAD_VEHICLE.key, ROAD_USERS.key, SIM_TRUTH.key, VEHICLE_STATE.key)
"""Topics that are read beside the estimates."""
Ahead = TypeVar("Ahead", LeadVehicle, RoadUsers)
Message = tuple[str, bytes]
"""Key of a topic, and CDR bytes."""


class Scene:
    """Derives the messages of the viewers from those of a drive, one after the other."""

    def __init__(self, camera: Camera, vehicle: Vehicle) -> None:
        self._camera, self._vehicle = camera, vehicle
        self._estimates: dict[str, SteeringEstimate] = {}
        self._lead: LeadVehicle | None = None
        self._people: RoadUsers | None = None
        self._truth: SimTruth | None = None
        self._track = PathHistory(0.5 * vehicle.scale)
        self._driven_s = -math.inf
        self._mounting = camera_transform(camera)
        self._numbers: dict[str, int] = {}  # name of an estimator -> number of its colour

    def step(self, key: str, data: bytes) -> Iterator[Message]:
        """The messages that follow from the CDR bytes ``data`` on the topic ``key``; none for malformed bytes."""
        topic: Topic[Any] | None = topic_of(key)
        if topic is None or (key not in READ and topic.type is not SteeringEstimate):
            return
        try:
            message = from_cdr(data, topic.type)
        except WireError:
            return  # the processes of the drive count it
        match message:
            case SteeringEstimate():
                self._numbers.setdefault(message.estimator, len(self._numbers))
                self._estimates[message.estimator] = message
            case LeadVehicle():
                self._lead = message
            case RoadUsers():
                self._people = message
            case SimTruth():
                self._truth = message
            case VehicleState():
                self._track.add(message, self._truth, None)
            case Decision():
                yield from self._decision_messages(message)

    def _decision_messages(self, decision: Decision) -> Iterator[Message]:
        t_s = decision.decided_s if decision.t_s is None else decision.t_s
        estimates = [one for one in self._estimates.values() if 0.0 <= t_s - one.t_s <= FRESH_S]
        lead, people = _fresh(self._lead, t_s), _fresh(self._people, t_s)
        if decision.t_s is not None:
            yield ros.CAMERA_INFO, ros.encode(ros.CAMERA_INFO, camera_info(self._camera, t_s))
            same = [one for one in estimates if abs(t_s - one.t_s) < 1e-6]
            shapes = overlay(same, decision, lead, self._camera, self._vehicle, people)
            yield ros.ANNOTATIONS, ros.encode(ros.ANNOTATIONS, self._annotations(t_s, shapes, decision))
        yield ros.TRANSFORMS, ros.encode(ros.TRANSFORMS, self._transforms(t_s))
        yield ros.MARKERS, ros.encode(ros.MARKERS, self._markers(t_s, estimates, decision, lead, people))
        if t_s - self._driven_s >= DRIVEN_PERIOD_S:
            self._driven_s = t_s
            yield ros.DRIVEN, ros.encode(ros.DRIVEN, self._driven_path(t_s))

    def _colour(self, estimator: str) -> RGB:
        return LANES[self._numbers[estimator] % len(LANES)]

    def _annotations(self, t_s: float, shapes: dict[str, Any], decision: Decision) -> Any:
        lines, texts = [], [note(t_s, caption(decision))]
        if shapes["path"]:
            fear = fear_colour(decision.fear)
            lines.append(line(t_s, shapes["path"], fear, loop=True, filled=0.35))
        for name, lane in shapes["lanes"].items():
            lines += [line(t_s, lane[side], self._colour(name)) for side in ("left", "right") if lane[side]]
        if shapes["lead"]:
            lines.append(line(t_s, corners_px(shapes["lead"]), LEAD, loop=True))
        for one in shapes["people"]:
            corners = corners_px(one["box"])
            lines.append(line(t_s, corners, PEOPLE, loop=True))
            texts.append(note(t_s, ahead_text(one["kind"], one["distance"]), corners[0]))
        return ros.new("foxglove_msgs/ImageAnnotations", circles=[], points=lines, texts=texts)

    def _transforms(self, t_s: float) -> Any:
        found = [transform(t_s, VEHICLE_FRAME, CAMERA_FRAME, *self._mounting)]
        if self._track.pose is not None:
            x_m, y_m, yaw_rad = self._track.pose
            turn = np.array([0.0, 0.0, math.sin(yaw_rad / 2), math.cos(yaw_rad / 2)])
            found.insert(0, transform(t_s, ROAD_FRAME, VEHICLE_FRAME, (x_m, y_m, 0.0), turn))
        return ros.new("tf2_msgs/TFMessage", transforms=found)

    def _markers(
        self,
        t_s: float,
        estimates: list[SteeringEstimate],
        decision: Decision,
        lead: LeadVehicle | None,
        people: RoadUsers | None,
    ) -> Any:
        vehicle, far_m = self._vehicle, SIGHT * decision.lookahead_m
        made = [marker(t_s, "all", 0, action=DELETE_ALL)]
        path = Lane.of_message(decision)
        if path is not None:
            width_m = PATH_M * vehicle.scale
            made.append(strip(t_s, "path", 0, points_of(path, far_m), width_m, fear_colour(decision.fear)))
        for estimate in estimates:
            lane = Lane.of_message(estimate)
            if lane is None:
                continue
            half_m = (estimate.lane_width_m or vehicle.lane_width_m) / 2
            for number, side in enumerate((1.0, -1.0)):
                points = points_of(lane, far_m, side * half_m)
                colour = self._colour(estimate.estimator)
                made.append(strip(t_s, estimate.estimator, number, points, 0.1 * vehicle.scale, colour))
        length_m = vehicle.rear_overhang_m + vehicle.wheelbase_m + vehicle.front_overhang_m
        middle_m = length_m / 2 - vehicle.rear_overhang_m
        made.append(self._body(t_s, "car", middle_m, 0.0, fear_colour(decision.fear)))
        if lead is not None and lead.distance_m is not None and lead.lateral_m is not None:
            x_m = vehicle.wheelbase_m + vehicle.front_overhang_m + lead.distance_m + length_m / 2
            made.append(self._body(t_s, "lead", x_m, lead.lateral_m, LEAD))
        if people is not None:
            made += self._road_users(t_s, people)
        above = ros.pose(ros.point(middle_m, 0.0, 2 * HEIGHT * vehicle.track_m), UPRIGHT)
        size = (0.0, 0.0, 0.35 * vehicle.track_m)
        made.append(
            marker(t_s, "text", 0, kind=TEXT, pose=above, size=size, colour=WHITE, text=caption(decision))
        )
        return ros.new("visualization_msgs/MarkerArray", markers=made)

    def _body(self, t_s: float, name: str, x_m: float, y_m: float, colour: RGB) -> Any:
        """A vehicle as a box of the size of the own one."""
        vehicle = self._vehicle
        length_m = vehicle.rear_overhang_m + vehicle.wheelbase_m + vehicle.front_overhang_m
        height_m = HEIGHT * vehicle.track_m
        pose = ros.pose(ros.point(x_m, y_m, height_m / 2), UPRIGHT)
        size = (length_m, vehicle.track_m, height_m)
        return marker(t_s, name, 0, kind=CUBE, pose=pose, size=size, colour=colour, alpha=0.5)

    def _road_users(self, t_s: float, people: RoadUsers) -> Iterator[Any]:
        """A box on the ground point of every road user, its kind and distance, and its way in AHEAD_S."""
        nose_m = self._vehicle.wheelbase_m + self._vehicle.front_overhang_m
        columns = (people.kinds, people.x_m, people.y_m, people.x_mps, people.y_mps)
        for number, (kind, x_m, y_m, x_mps, y_mps) in enumerate(zip(*columns, strict=False)):
            if not math.isfinite(x_m + y_m):
                continue
            wide_m, high_m = size_m(kind, self._vehicle)
            pose = ros.pose(ros.point(x_m, y_m, high_m / 2), UPRIGHT)
            size = (wide_m, wide_m, high_m)
            yield marker(t_s, "people", number, kind=CUBE, pose=pose, size=size, colour=PEOPLE, alpha=0.7)
            text, speed_mps = ahead_text(kind, max(x_m - nose_m, 0.0)), math.hypot(x_mps, y_mps)
            if math.isfinite(speed_mps):
                text += f"  {speed_mps:z.1f} m/s"
                way = [
                    ros.point(x_m, y_m, high_m / 2),
                    ros.point(x_m + AHEAD_S * x_mps, y_m + AHEAD_S * y_mps, high_m / 2),
                ]
                size = (wide_m / 6, 0.0, 0.0)
                yield marker(t_s, "people_way", number, kind=LINE_STRIP, size=size, colour=PEOPLE, points=way)
            above = ros.pose(ros.point(x_m, y_m, 1.3 * high_m), UPRIGHT)
            size = (0.0, 0.0, 0.25 * self._vehicle.track_m)
            yield marker(
                t_s, "people_text", number, kind=TEXT, pose=above, size=size, colour=WHITE, text=text
            )

    def _driven_path(self, t_s: float) -> Any:
        top = ros.header(t_s, ROAD_FRAME)
        places = [
            ros.new("geometry_msgs/PoseStamped", header=top, pose=ros.pose(ros.point(x_m, y_m), UPRIGHT))
            for x_m, y_m, _ in self._track.since(self._track.thinned, 0)[1]
        ]
        return ros.new("nav_msgs/Path", header=top, poses=places)


def _fresh(message: Ahead | None, t_s: float) -> Ahead | None:
    """``message`` where it is of a frame at most FRESH_S from ``t_s``."""
    return message if message is not None and abs(t_s - message.t_s) <= FRESH_S else None
