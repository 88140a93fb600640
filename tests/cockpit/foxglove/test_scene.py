"""What the viewers draw of the people ahead: on the road where their ground points are, and in the picture."""

import math
from typing import Any

import numpy as np
import pytest
from message_rig import SHUTTLE, decision
from rosbags.typesys import Stores, get_typestore

from cockpit.foxglove import ros
from cockpit.foxglove.scene import FRESH_S, Scene
from cockpit.foxglove.shapes import CORNER_PX, LIFETIME_S
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import RoadUsers
from trepid.topics import DECISION, ROAD_USERS
from trepid.wire import to_cdr

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
NOSE_M = SHUTTLE.wheelbase_m + SHUTTLE.front_overhang_m
T_S = 3.0
USERS = RoadUsers(
    t_s=T_S,
    kinds=("person", "animal"),
    x_m=(12.0, 20.0),
    y_m=(-1.5, 2.0),
    x_mps=(0.5, math.nan),
    y_mps=(1.2, math.nan),
    confidences=(0.9, 0.8),
    detects=("person", "animal"),
)


def draw_users(users: RoadUsers, *, late_s: float = 0.0) -> dict[str, Any]:
    """The messages of the viewers for a decision ``late_s`` after the road users, by topic."""
    scene = Scene(CAMERA, SHUTTLE)
    assert list(scene.step(ROAD_USERS.key, to_cdr(users))) == []
    made = dict(scene.step(DECISION.key, to_cdr(decision(T_S + late_s, cause="person"))))
    store = get_typestore(Stores.ROS2_JAZZY)
    markers = store.deserialize_cdr(made[ros.MARKERS], ros.TYPES[ros.MARKERS])
    annotations = ros._STORE.deserialize_cdr(made[ros.ANNOTATIONS], ros.TYPES[ros.ANNOTATIONS])
    return {"markers": markers.markers, "annotations": annotations}


def markers_of(made: dict[str, Any], name: str) -> list[Any]:
    return [one for one in made["markers"] if one.ns == name]


def test_every_road_user_stands_on_its_ground_point_with_its_kind_and_distance() -> None:
    made = draw_users(USERS)
    bodies, texts = markers_of(made, "people"), markers_of(made, "people_text")
    assert [(one.pose.position.x, one.pose.position.y) for one in bodies] == [(12.0, -1.5), (20.0, 2.0)]
    for one in bodies:
        assert one.pose.position.z == pytest.approx(one.scale.z / 2)  # the feet are on the road
    assert bodies[0].scale.z > bodies[1].scale.z  # a person is taller than a dog
    assert texts[0].text == f"person {12.0 - NOSE_M:.0f} m  1.3 m/s"
    assert texts[1].text == f"animal {20.0 - NOSE_M:.0f} m"  # its speed is not known


def test_the_way_of_a_walker_shows_where_it_is_after_a_second_and_is_absent_without_a_speed() -> None:
    (way,) = markers_of(draw_users(USERS), "people_way")
    start, end = way.points
    assert (end.x - start.x, end.y - start.y) == pytest.approx((0.5, 1.2))


def test_the_boxes_in_the_picture_stand_where_the_markers_are() -> None:
    made = draw_users(USERS)
    loops = [one for one in made["annotations"].points if one.type == ros.LINE_LOOP]
    texts = {one.text for one in made["annotations"].texts}
    feet = sorted(
        np.mean([[p.x - CORNER_PX, p.y - CORNER_PX] for p in one.points[2:]], axis=0).tolist()
        for one in loops[-2:]
    )
    grounds = sorted(CAMERA.pixel_from_road([[12.0, -1.5], [20.0, 2.0]]).tolist())
    assert np.allclose(feet, grounds, atol=0.1)
    assert {f"person {12.0 - NOSE_M:.0f} m", f"animal {20.0 - NOSE_M:.0f} m"} < texts
    assert any(text.endswith("person") for text in texts)  # the cause of the decision


@pytest.mark.parametrize("x_m", [math.nan, math.inf])
def test_a_place_that_is_not_finite_is_not_drawn(x_m: float) -> None:
    made = draw_users(
        RoadUsers(t_s=T_S, kinds=("person",), x_m=(x_m,), y_m=(0.0,), x_mps=(0.0,), y_mps=(0.0,))
    )
    assert markers_of(made, "people") == markers_of(made, "people_text") == []


def test_road_users_of_an_old_frame_are_not_drawn() -> None:
    assert markers_of(draw_users(USERS, late_s=FRESH_S - 0.01), "people")
    assert not markers_of(draw_users(USERS, late_s=FRESH_S + 0.01), "people")
    assert LIFETIME_S <= FRESH_S  # a marker without a following one goes as early
