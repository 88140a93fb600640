"""Labels of the real sets are read by their protocols: on made-up labels the counts are known."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from lab.bench.real.frames import Picture, stills
from lab.bench.real.labels import ROAD_CLASS, Labels, border_error_px, ego_lane, line_counts, road
from lab.bench.real.look import _answer
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load
from trepid.messages import PixelPath, SteeringEstimate

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
NOTHING = SteeringEstimate.nothing(0.0, estimator="x", lookahead_m=8.0, reason="")


def test_a_stretched_picture_is_compared_with_its_label_stretched_alike(tmp_path):
    label = np.zeros((36, 48, 3), np.uint8)
    label[18:, 24:] = ROAD_CLASS
    cv2.imwrite(str(tmp_path / "a.png"), label)
    cv2.imwrite(str(tmp_path / "a.jpg"), label)
    plain, wide = (
        next(stills(tmp_path, "*.jpg", tmp_path, ".png", width_px=width_px)) for width_px in (None, 64)
    )
    assert wide.image.shape == (36, 64, 3) and plain.image.shape == label.shape
    assert (wide.camera.width_px, wide.camera.height_px) == (64, 36) and wide.file == plain.file
    surface, known = road(wide)
    assert surface.shape == known.shape == (36, 64)
    assert surface[18:, 32:].all() and surface.sum() == 18 * 32


def upright(column: float, height: int) -> PixelPath:
    return tuple((column, float(row)) for row in range(height, -1, -10))


def between(left: PixelPath, right: PixelPath) -> SteeringEstimate:
    return replace(NOTHING, left_boundary_px=left, right_boundary_px=right)


def labelled_picture(label: np.ndarray, path: Path) -> Picture:
    cv2.imwrite(str(path), label)
    return Picture("a", 0.0, np.zeros((*label.shape[:2], 3), np.uint8), CAMERA, label=path)


@pytest.mark.parametrize(
    ("left", "right", "right_points", "false", "missed"),
    [
        (upright(400, 720), upright(880, 720), 90, 0, 0),
        (upright(415, 720), upright(880, 720), 90, 0, 0),
        (upright(430, 720), upright(880, 720), 45, 1, 1),
        ((), upright(880, 720), 45, 0, 1),
    ],
)
def test_tusimple_counts_points_within_twenty_pixels_of_the_ego_lines(
    left: PixelPath, right: PixelPath, right_points: int, false: int, missed: int, tmp_path: Path
) -> None:
    label = np.zeros((720, 1280), np.uint8)
    for value, column in ((20, 100), (70, 400), (120, 880), (170, 1200)):
        label[:, column - 2 : column + 3] = value
    counts = line_counts(labelled_picture(label, tmp_path / "0.png"), between(left, right))
    assert counts == {
        "points": 90,
        "right_points": right_points,
        "lines": 2,
        "false_lines": false,
        "missed_lines": missed,
    }


def test_a_lane_overlaps_with_the_road_where_the_label_is_known(tmp_path: Path) -> None:
    label = np.zeros((100, 100), np.uint8)
    label[50:, 20:60] = 3
    label[:50] = 11  # void: not counted
    picture = labelled_picture(label, tmp_path / "0.png")
    found = between(upright(40, 100), upright(79, 100))
    row = _answer(found, picture, Labels.ROAD, road(picture))
    assert (row["iou"], row["inside"]) == pytest.approx((20 / 60, 0.5))
    assert row["border_error_px"] == border_error_px(found, road(picture)[0]) == pytest.approx(20.0)


def test_a_border_at_the_edge_of_the_picture_has_no_error(tmp_path: Path) -> None:
    everywhere = np.ones((100, 100), bool)
    assert border_error_px(between(upright(40, 100), upright(79, 100)), everywhere) is None


def test_the_ego_lane_is_magenta_and_an_estimate_of_nothing_does_not_answer(tmp_path: Path) -> None:
    label = np.zeros((100, 100, 3), np.uint8)
    label[..., 2] = 255
    label[:, 20:60] = (255, 0, 255)
    picture = labelled_picture(label, tmp_path / "0.png")
    truth = ego_lane(picture)
    assert _answer(between(upright(20, 100), upright(59, 100)), picture, Labels.LANE, truth)["iou"] == 1.0
    assert not _answer(NOTHING, picture, Labels.LANE, truth)["answered"]
