"""Lanes that a network gives to drives without labels."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from learning.lane.scores import Prediction, PursuitTask
from learning.lane.unlabelled import (
    UnlabelledFrames,
    label_by_network,
    label_by_teacher,
    mirror_camera,
    none_of,
    read_drives,
)
from perception.net.canonical import crop_camera
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

CANONICAL = crop_camera(
    load(CONFIG_DIR / "camera.yaml", Camera), top_px=82, bottom_px=202, width_px=200, height_px=66
)
TASK = PursuitTask(wheelbase_m=2.7, command_row=np.array([-2 / 64, 0.0, 0.0, 0.0]))
AGREE_RAD = math.radians(1.0)
STEP_M = 0.1  # of the offset for one grey level: 0.48 deg of the road wheels


def drive(*middles: int) -> np.ndarray:
    """Images in which the left half is as much brighter than the right one as ``middles`` say."""
    images = np.full((len(middles), 66, 200, 3), 100, np.uint8)
    for image, middle in zip(images, middles, strict=True):
        image[:, :100] += np.uint8(middle)
    return images


def network(images: np.ndarray, *, bias_m: float = 0.0, visible: float = 1.0) -> Prediction:
    """Reads the offset from :func:`drive`; the mirror image has the opposite one, but for the bias."""
    means = images.astype(float).mean(axis=(1, 3))
    offsets = STEP_M * (means[:, 0] - means[:, -1]) + bias_m
    lanes = np.zeros((len(images), 5), np.float32)
    lanes[:, 0], lanes[:, 4] = offsets, 3.3
    return Prediction(lanes, np.zeros(len(images)), np.full(len(images), visible))


def label_offsets(images: np.ndarray, drives: list[int], **changes: float) -> np.ndarray:
    """Offsets that are given."""
    frames = UnlabelledFrames(images, np.array(drives))
    found = label_by_network(lambda seen: network(seen, **changes), frames, TASK, agree_rad=AGREE_RAD)
    assert len(found.images) == len(found.lanes) == len(found.visible) and found.visible.all()
    return found.lanes[:, 0]


def test_a_steady_drive_has_the_lanes_of_the_network():
    assert label_offsets(drive(0, 1, 2, 2), [0, 0, 0, 0]) == pytest.approx([0, 0.1, 0.2, 0.2], abs=1e-6)


def test_a_frame_unlike_its_neighbour_in_the_drive_has_no_lane_and_neither_has_the_neighbour():
    assert label_offsets(drive(0, 0, 9, 9), [0, 0, 0, 0]) == pytest.approx([0, 0.9], abs=1e-6)
    assert label_offsets(drive(0, 0, 9, 9), [0, 0, 1, 1]) == pytest.approx([0, 0, 0.9, 0.9], abs=1e-6)


def test_a_lane_that_is_not_mirrored_in_the_mirror_image_does_not_count():
    assert len(label_offsets(drive(3, 3), [0, 0], bias_m=0.15)) == 0
    assert label_offsets(drive(3, 3), [0, 0], bias_m=0.05) == pytest.approx([0.3, 0.3], abs=1e-6)  # the mean


def test_a_road_has_to_be_visible_in_the_image_and_in_its_mirror_image():
    frames = UnlabelledFrames(drive(2, 2), np.array([0, 0]))
    for hidden in (0, 1):
        calls = iter([0, 1])

        def half_blind(images: np.ndarray, calls=calls, hidden=hidden) -> Prediction:
            return network(images, visible=0.4 if next(calls) == hidden else 1.0)

        assert len(label_by_network(half_blind, frames, TASK, agree_rad=AGREE_RAD)) == 0


def test_without_frames_there_are_no_labels():
    assert len(label_by_network(network, none_of(CANONICAL), TASK, agree_rad=AGREE_RAD)) == 0


def test_frames_of_folders_and_images_are_read_as_drives_of_their_own(tmp_path: Path):
    folder = tmp_path / "drive"
    folder.mkdir()
    for number in range(5):
        cv2.imwrite(str(folder / f"{number}.png"), np.full((120, 160, 3), 40 + number, np.uint8))
    one = tmp_path / "one.png"
    cv2.imwrite(str(one), np.full((240, 320, 3), 90, np.uint8))
    found = read_drives([folder, one], CANONICAL, most_frames=3)
    assert found.images.shape == (4, 66, 200, 3)
    assert found.drives.tolist() == [0, 0, 0, 1] and found.names == ("drive", "one.png")
    assert found.images[:, 30, 100].mean(axis=1).tolist() == [40, 41, 42, 90]
    assert found.digest != read_drives([folder], CANONICAL, most_frames=3).digest
    assert found.digest != UnlabelledFrames(found.images, np.array([0, 0, 1, 1])).digest
    cv2.imwrite(str(folder / "9.png"), np.full((60, 80, 3), 9, np.uint8))
    with pytest.raises(
        InputError, match=r"9\.png: 80 x 60 px, but the first image of the drive has 160 x 120 px"
    ):
        read_drives([folder], CANONICAL, most_frames=9)
    with pytest.raises(InputError, match="nowhere"):
        read_drives([tmp_path / "nowhere"], CANONICAL, most_frames=3)


def test_the_camera_of_the_mirror_image_shows_the_mirrored_road():
    camera = load(CONFIG_DIR / "camera.yaml", Camera).model_copy(
        update=dict(cx_px=150.0, y_m=0.3, yaw_rad=0.05, distortion=(0.1, -0.05, 0.002, 0.003, 0.01))
    )
    road_m = np.array([[5.0, 1.0], [12.0, -3.0], [30.0, 2.0]])
    mirrored = mirror_camera(camera)
    seen, other = camera.pixel_from_road(road_m), mirrored.pixel_from_road(road_m * (1, -1))
    assert other == pytest.approx(np.column_stack([camera.width_px - 1 - seen[:, 0], seen[:, 1]]))
    optical = np.array([[0.3, 0.1, 1.0], [-0.2, 0.4, 1.0]])
    bent, bent_other = (
        cv2.projectPoints(points, np.zeros(3), np.zeros(3), one.intrinsics, one.lens)[0][:, 0]
        for points, one in ((optical, camera), (optical * (-1, 1, 1), mirrored))
    )
    assert bent_other == pytest.approx(np.column_stack([camera.width_px - 1 - bent[:, 0], bent[:, 1]]))
    assert mirror_camera(mirrored) == camera


@pytest.fixture(scope="module")
def rendered_drive(tmp_path_factory) -> tuple[Path, list[float]]:
    """Images of a straight road from a car that moves to the left, and its offsets; the last shows no road."""
    folder = tmp_path_factory.mktemp("rendered") / "drive"
    folder.mkdir()
    road, offsets = load_road("straight"), np.linspace(0.10, 0.20, 12).tolist()
    renderer = Renderer(road, load(CONFIG_DIR / "camera.yaml", Camera), seed=0)
    for number, offset_m in enumerate(offsets):
        x_m, y_m = road.position(20.0 + number, offset_m)
        image = renderer.render(x_m, y_m, road.heading_at(20.0), t_s=0.0, station_m=20.0 + number)
        cv2.imwrite(str(folder / f"{number:02}.png"), image)
    cv2.imwrite(str(folder / "99.png"), np.full_like(image, 90))
    return folder, offsets


def test_frames_have_the_lanes_of_a_teacher_that_is_sure_in_both_directions(rendered_drive):
    folder, offsets = rendered_drive
    frames = read_drives([folder], CANONICAL, most_frames=99, teacher="cv", lookahead_m=10.0)
    assert len(frames) == len(offsets) + 1
    assert len(label_by_teacher(frames, TASK, agree_rad=0.0)) == 0
    found = label_by_teacher(frames, TASK, agree_rad=AGREE_RAD)
    assert 6 < len(found) <= len(offsets), "none in the image without a road"
    taken = [int(np.flatnonzero((frames.images == image).all(axis=(1, 2, 3)))[0]) for image in found.images]
    assert found.lanes[:, 0] == pytest.approx([offsets[number] for number in taken], abs=0.06)
    assert found.lanes[:, 4] == pytest.approx(load_road("straight").width_at(20.0), abs=0.3)
    assert frames.digest != read_drives([folder], CANONICAL, most_frames=99).digest


def test_an_unknown_teacher_is_named(tmp_path: Path):
    cv2.imwrite(str(tmp_path / "0.png"), np.full((120, 160, 3), 40, np.uint8))
    with pytest.raises(InputError, match="no_such_estimator"):
        read_drives([tmp_path], CANONICAL, most_frames=1, teacher="no_such_estimator")
