"""A recording for Foxglove, read back by other software: every message decodes by the definition in the file."""

import json
import math
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from foxglove_schemas_protobuf import ImageAnnotations_pb2, PointsAnnotation_pb2, TextAnnotation_pb2
from google.protobuf import json_format
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from recorded_rig import record_drive
from scipy.spatial.transform import Rotation

from cockpit.foxglove import convert, ros
from cockpit.foxglove.shapes import CORNER_PX, camera_transform
from sim_harness.scenarios.scenario import load_scenario
from trepid.car.camera import Camera
from trepid.cli import main
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.recording.reader import read_recording
from trepid.topics import DECISION

pytestmark = pytest.mark.long
LAYOUT = Path(convert.__file__).with_name("layout.json")
COLOURS = {"outline_color", "fill_color", "text_color", "background_color"}


def export_drive(drive: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr("sys.argv", ["trepid", "export", str(drive), str(out)])
    assert main() == 0
    return out


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    scenario = load_scenario("cut_in", {"duration_s": "6"})
    return record_drive(path, scenario)


@pytest.fixture(scope="module")
def viewable(drive: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as monkeypatch:
        return export_drive(drive, tmp_path_factory.mktemp("view") / "view.mcap", monkeypatch)


@pytest.fixture(scope="module")
def messages(viewable: Path) -> dict[str, list[Any]]:
    """Every message of the file by topic, decoded by another CDR reader."""
    found = defaultdict(list)
    with viewable.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages():
            found[channel.topic].append(message)
    return found


def plain(message: Any) -> Any:
    """A decoded message as JSON of the published schema: names as there, stamps as text."""
    if isinstance(message, list | tuple):
        return [plain(item) for item in message]
    if not hasattr(message, "__slots__"):
        return message
    fields = {name: plain(getattr(message, name)) for name in message.__slots__}
    if set(fields) == {"sec", "nanosec"}:
        return f"{np.datetime64(fields['sec'], 's')}.{fields['nanosec']:09d}Z"
    return fields


def test_every_message_decodes_and_no_message_of_the_drive_is_lost(
    drive: Path, messages: dict[str, list[Any]]
) -> None:
    decisions = read_recording(drive, DECISION.key).of(DECISION)
    with_frame = sum(decision.t_s is not None for _, decision in decisions)
    assert with_frame > 100
    assert {f"/{key}" for key in ros.TYPES} <= set(messages)
    assert len(messages["/supervisor/decision"]) == len(decisions) == len(messages["/viewer/markers"])
    assert len(messages["/viewer/annotations"]) == len(messages["/viewer/camera_info"]) == with_frame
    assert len(messages["/camera/image/compressed"]) > 50


def test_the_annotations_are_valid_by_the_published_schema(messages: dict[str, list[Any]]) -> None:
    kinds = set()
    for message in messages["/viewer/annotations"]:
        fields = plain(message)
        valid = json_format.ParseDict(
            fields, ImageAnnotations_pb2.ImageAnnotations()
        )  # raises for any other field
        kinds |= {line.type for line in valid.points}
        assert valid.texts[0].text.split()[1] == "fear"
    published = PointsAnnotation_pb2.PointsAnnotation
    assert kinds == {published.LINE_LOOP, published.LINE_STRIP}


@pytest.mark.parametrize(
    ("name", "published"),
    [
        ("PointsAnnotation", PointsAnnotation_pb2.PointsAnnotation),
        ("TextAnnotation", TextAnnotation_pb2.TextAnnotation),
        ("ImageAnnotations", ImageAnnotations_pb2.ImageAnnotations),
    ],
)
def test_the_fields_are_those_of_the_published_schema(name: str, published: Any) -> None:
    own = re.findall(r"^\S+ (\w+)$", ros._FOXGLOVE[name], re.MULTILINE)
    assert set(own) <= set(published.DESCRIPTOR.fields_by_name)
    further = set(published.DESCRIPTOR.fields_by_name) - set(own)
    assert further <= {"metadata", "timestamp"}  # added later, and not required


def test_lane_path_and_leader_are_drawn(messages: dict[str, list[Any]]) -> None:
    most = max(messages["/viewer/annotations"], key=lambda message: len(message.points))
    strips = [line for line in most.points if line.type == ros.LINE_STRIP]
    loops = [line for line in most.points if line.type == ros.LINE_LOOP]
    assert len(strips) == 4 and len(loops) == 2  # both sides of two estimates; path and leader
    assert len({tuple(plain(line.outline_color).values()) for line in strips}) == 2
    names = {marker.ns for message in messages["/viewer/markers"] for marker in message.markers}
    assert {"path", "cv", "cnn", "car", "lead", "text"} <= names


def test_the_markers_lie_in_the_picture_where_the_annotations_are(messages: dict[str, list[Any]]) -> None:
    annotated = {
        (one.texts[0].timestamp.sec, one.texts[0].timestamp.nanosec): one
        for one in messages["/viewer/annotations"]
    }
    info, compared = messages["/viewer/camera_info"][0], 0
    for scene, transforms in zip(messages["/viewer/markers"], messages["/tf"], strict=True):
        stamp = scene.markers[0].header.stamp
        (path,) = [marker for marker in scene.markers if marker.ns == "path"] or [None]
        (mounted,) = [one for one in transforms.transforms if one.child_frame_id == "camera_optical"]
        picture = annotated.get((stamp.sec, stamp.nanosec))
        if path is None or picture is None:
            continue
        turn, move = mounted.transform.rotation, mounted.transform.translation
        into = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).inv()
        points = np.array([[p.x, p.y, p.z] for p in path.points]) - [move.x, move.y, move.z]
        ahead = into.apply(points)
        u, v, depth = np.array(info.k).reshape(3, 3) @ ahead[ahead[:, 2] > 4.0].T
        loop = next(line for line in picture.points if line.type == ros.LINE_LOOP)
        outline = np.array([[p.x, p.y] for p in loop.points], np.float32)
        for x, y in zip(u / depth + CORNER_PX, v / depth + CORNER_PX, strict=True):
            compared += 1
            assert cv2.pointPolygonTest(outline, (float(x), float(y)), measureDist=True) > -1.0
    assert compared > 500


@pytest.mark.parametrize(("pitch", "yaw"), [(0.0, 0.0), (0.2, 0.0), (0.1, -0.4), (-0.3, 1.0)])
def test_the_turn_of_the_camera_is_that_of_its_axes(pitch: float, yaw: float) -> None:
    camera = load(CONFIG_DIR / "camera.yaml", Camera).model_copy(
        update={"pitch_down_rad": pitch, "yaw_rad": yaw}
    )
    place, turn = camera_transform(camera)
    assert np.allclose(Rotation.from_quat(turn).as_matrix(), camera.optical_from_vehicle.T, atol=1e-12)
    assert place == (camera.x_m, camera.y_m, camera.height_m) and math.isclose(np.linalg.norm(turn), 1.0)


def test_the_car_is_where_the_simulator_has_it(messages: dict[str, list[Any]]) -> None:
    last = [one for one in messages["/tf"][-1].transforms if one.child_frame_id == "rear_axle"]
    truth = messages["/sim/truth"][-1]
    assert last[0].header.frame_id == "map"
    assert (
        math.hypot(last[0].transform.translation.x - truth.x_m, last[0].transform.translation.y - truth.y_m)
        < 1
    )
    assert len(messages["/viewer/driven"][-1].poses) > 10


def test_the_export_is_still_a_recording_and_exporting_it_again_changes_nothing(
    drive: Path, viewable: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one, other = read_recording(drive, DECISION.key), read_recording(viewable, DECISION.key)
    assert one.of(DECISION) == other.of(DECISION) and one.notes == other.notes and one.files == other.files
    again = export_drive(viewable, tmp_path / "again.mcap", monkeypatch)

    def bare(path: Path) -> list[tuple[str, int, bytes]]:
        with path.open("rb") as file:
            found = make_reader(file).iter_messages()
            return [(channel.topic, message.log_time, message.data) for _, channel, message in found]

    assert bare(again) == bare(viewable)


def test_the_layout_shows_topics_and_fields_that_exist(messages: dict[str, list[Any]]) -> None:
    text = LAYOUT.read_text(encoding="utf-8")
    layout = json.loads(text)
    panels: set[str] = set()

    def walk(node: Any) -> None:
        if isinstance(node, str):
            panels.add(node)
        else:
            walk(node["first"])
            walk(node["second"])

    walk(layout["layout"])
    assert panels == set(layout["configById"])
    paths = set(re.findall(r'"(/[a-z_/]+(?:\.[a-z_.\[\]0-9]+)?)"', text))
    assert len(paths) > 8
    for path in paths:
        topic, _, field = path.partition(".")
        assert topic in messages, path
        value = messages[topic][-1]
        for name in filter(None, field.split(".")):
            assert hasattr(value, name), path
            value = getattr(value, name)


def test_a_layout_and_a_page_are_named_in_the_documentation() -> None:
    page = (ROOT / "docs" / "page.md").read_text(encoding="utf-8")
    assert LAYOUT.relative_to(ROOT).as_posix() in page
    assert all(f"/{key}" in page for key in ros.TYPES)
