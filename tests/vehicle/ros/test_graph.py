"""Keys, tokens, hashes and names are those of rmw_zenoh; the reference values are those of ROS 2 Jazzy."""

from collections.abc import Callable

import numpy as np
import pytest

from trepid.car.camera import Camera
from trepid.config import CAR, CONFIG_DIR, InputError, load
from trepid.wire import STORE
from vehicle.ros.bridge import (
    TF_STATIC,
    RosSettings,
    ackermann_driver,
    camera_pose,
    load_settings,
    quaternion,
)
from vehicle.ros.graph import (
    PUBLISHER,
    SENSOR_QOS,
    RosTopic,
    dds_name,
    endpoint_token,
    node_token,
    ros_topic_name,
    topic_key,
)

CHATTER = RosTopic("/chatter", "std_msgs/msg/String")
STRING = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"  # of ROS 2 Jazzy


@pytest.fixture
def car(tmp_path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    monkeypatch.setenv(CAR, str(tmp_path))

    def make(**files: str) -> None:
        for name, text in files.items():
            (tmp_path / f"{name}.yaml").write_text(text)

    return make


def test_a_message_has_the_key_of_rmw_zenoh() -> None:
    assert topic_key(2, CHATTER) == f"2/chatter/std_msgs::msg::dds_::String_/{STRING}"
    assert dds_name("sensor_msgs/msg/Image") == "sensor_msgs::msg::dds_::Image_"


def test_nodes_and_publishers_declare_the_tokens_of_rmw_zenoh() -> None:
    assert node_token(2, "aac3", "talker") == "@ros2_lv/2/aac3/0/0/NN/%/%/talker"
    assert endpoint_token(2, "aac3", "talker", 10, PUBLISHER, CHATTER, "::,10:,:,:,,") == (
        f"@ros2_lv/2/aac3/0/10/MP/%/%/talker/%chatter/std_msgs::msg::dds_::String_/{STRING}/::,10:,:,:,,"
    )
    assert "/" not in SENSOR_QOS


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("camera/image", "/camera/image"),
        ("perception/my-net.2/estimate", "/perception/my_net_2/estimate"),
        ("3d", "/_3d"),
    ],
)
def test_a_name_of_a_topic_holds_only_what_ros_allows(name: str, expected: str) -> None:
    assert ros_topic_name(name) == expected


def test_the_default_settings_forward_commands_decisions_estimates_and_compressed_images() -> None:
    topics = load_settings().forwarded_topics("shuttle", ("cv",), None)
    assert topics["supervisor/decision"] == RosTopic(
        "/trepid/shuttle/supervisor/decision", "trepid_msgs/msg/Decision"
    )
    assert topics["diagnostics"].name == "/diagnostics"
    assert {"controller/command", "perception/cv/estimate", "camera/image/compressed"} < set(topics)
    assert "sim/truth" not in topics


def test_a_topic_that_is_not_one_of_a_drive_is_refused_with_the_nearest_name() -> None:
    settings = load_settings().model_copy(update={"exclude": ("camera/imagee",)})
    with pytest.raises(InputError, match=r"no topic 'camera/imagee' in a drive; .*camera/image"):
        settings.forwarded_topics("shuttle", (), None)


DRIVER = "actuator: ackermann\nackermann: {state: odometry, wheel_angle: commanded}\n"


def test_the_limited_command_has_the_name_that_the_driver_of_the_car_expects(car) -> None:
    car(actuator=DRIVER, ros="names: {actuator/command: /ackermann_cmd}\n")
    topics = load_settings().forwarded_topics("shuttle", (), ackermann_driver())
    assert topics["actuator/command"] == RosTopic(
        "/ackermann_cmd", "ackermann_msgs/msg/AckermannDriveStamped"
    )
    assert "actuator/state" not in topics


def test_without_an_ackermann_driver_no_limited_command_is_promised(car) -> None:
    car(ros="names: {actuator/command: /ackermann_cmd}\n")
    with pytest.raises(
        InputError, match=r"'actuator/command' in a drive.*limited command.*actuator: ackermann"
    ):
        load_settings().forwarded_topics("shuttle", (), ackermann_driver())


def test_a_state_from_the_graph_needs_an_ackermann_driver_and_a_drive_without_keys(car) -> None:
    car(ros="state: /odom\n")
    with pytest.raises(InputError, match="state: is that of a car with actuator: ackermann"):
        load_settings()
    car(actuator=DRIVER)
    assert load_settings().state == "/odom"
    car(security="keys: keys\n")
    with pytest.raises(InputError, match="state: comes in the clear"):
        load_settings()


def test_a_router_on_another_machine_is_refused(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "ros.yaml").write_text("router: tcp/192.168.1.10:7447\n")
    monkeypatch.setenv(CAR, str(tmp_path))
    assert isinstance(load(CONFIG_DIR / "ros.yaml", RosSettings), RosSettings)
    with pytest.raises(InputError, match="on another machine"):
        load_settings()


def matrix(w: float, x: float, y: float, z: float) -> np.ndarray:
    """Rotation matrix of a unit quaternion, by Hamilton's formula."""
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )


@pytest.mark.parametrize("q", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0.6, 0.8), (0.5, -0.5, 0.5, -0.5)])
def test_a_quaternion_gives_its_rotation_back_also_at_half_turns(q: tuple[float, ...]) -> None:
    assert matrix(*quaternion(matrix(*q))) == pytest.approx(matrix(*q), abs=1e-9)


def test_the_pose_of_the_camera_turns_its_axis_ahead_into_the_axis_of_the_vehicle() -> None:
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    (transform,) = STORE.deserialize_cdr(camera_pose(camera, 12.0), TF_STATIC.type).transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("rear_axle", "camera_optical")
    q = transform.transform.rotation
    ahead = matrix(q.w, q.x, q.y, q.z) @ [0, 0, 1]
    assert ahead[0] > 0.9  # forward
    assert ahead[2] == pytest.approx(-np.sin(camera.pitch_down_rad))
    assert transform.transform.translation.z == camera.height_m
