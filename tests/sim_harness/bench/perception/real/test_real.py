"""Real sets are judged by their protocols: on made-up labels the scores are known."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim_harness.bench.perception.real import bench as real
from sim_harness.bench.perception.real.bench import SETS, bench_real, data_folder
from sim_harness.bench.perception.real.frames import Picture
from sim_harness.bench.perception.real.scores import (
    lane_overlap,
    lane_widths,
    road_overlap,
    steering,
    tusimple,
)
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, load
from trepid.messages import PixelPath, SteeringEstimate

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
NOTHING = SteeringEstimate.nothing(0.0, estimator="x", lookahead_m=8.0, reason="")


def upright(column: float, rows: tuple[int, int] = (0, 720)) -> PixelPath:
    return tuple((column, float(row)) for row in range(rows[1], rows[0] - 1, -10))


def picture(label: np.ndarray, path: Path) -> Picture:
    cv2.imwrite(str(path), label)
    return Picture("a", 0.0, np.zeros((1, 1, 3), np.uint8), CAMERA, label=path)


@pytest.mark.parametrize(
    ("left", "right", "accuracy", "false", "missed"),
    [
        (upright(400), upright(880), 100.0, 0.0, 0.0),
        (upright(415), upright(880), 100.0, 0.0, 0.0),
        (upright(430), upright(880), 50.0, 50.0, 50.0),
        ((), upright(880), 50.0, 0.0, 50.0),
    ],
)
def test_tusimple_counts_points_within_twenty_pixels_of_the_ego_lines(
    left: PixelPath, right: PixelPath, accuracy: float, false: float, missed: float, tmp_path: Path
) -> None:
    label = np.zeros((720, 1280), np.uint8)
    for value, column in ((20, 100), (70, 400), (120, 880), (170, 1200)):
        label[:, column - 2 : column + 3] = value
    estimate = replace(NOTHING, left_boundary_px=left, right_boundary_px=right)
    row = tusimple([(picture(label, tmp_path / "0.png"), estimate)])
    assert (row["accuracy_pct"], row["false_lines_pct"], row["missed_lines_pct"]) == (accuracy, false, missed)


def test_overlap_with_the_road_is_intersection_over_union_where_the_label_is_known(tmp_path: Path) -> None:
    label = np.zeros((100, 100), np.uint8)
    label[50:, 20:60] = 3
    label[:50] = 11  # void: not counted
    estimate = replace(
        NOTHING, left_boundary_px=upright(40, (0, 100)), right_boundary_px=upright(79, (0, 100))
    )
    row = road_overlap([(picture(label, tmp_path / "0.png"), estimate)])
    assert row["iou"] == pytest.approx(20 / 60)
    assert row["border_px_median"] == pytest.approx(20.0)


def test_overlap_with_the_ego_lane_is_by_its_magenta(tmp_path: Path) -> None:
    label = np.zeros((100, 100, 3), np.uint8)
    label[..., 2] = 255
    label[:, 20:60] = (255, 0, 255)
    estimate = replace(
        NOTHING, left_boundary_px=upright(20, (0, 100)), right_boundary_px=upright(59, (0, 100))
    )
    assert lane_overlap([(picture(label, tmp_path / "0.png"), estimate)])["iou"] == 1.0
    assert lane_overlap([(picture(label, tmp_path / "0.png"), NOTHING)]) == {
        "images": 1,
        "given_pct": 0.0,
        "iou": None,
    }


def test_steering_errors_are_reported_next_to_those_of_driving_straight() -> None:
    driven = [replace(picture_of_a_drive(), steering_rad=angle) for angle in np.radians([0, 10, -10, 5])]
    estimates = [replace(NOTHING, road_wheel_angle_rad=angle) for angle in [*np.radians([1, 11, -9]), None]]
    row = steering(list(zip(driven, estimates, strict=True)))
    assert row["given_pct"] == 75.0
    assert row["mae_deg"] == pytest.approx(1.0)
    assert row["mae_of_straight_deg"] == pytest.approx(20 / 3)
    assert row["correlation"] == pytest.approx(1.0)


def picture_of_a_drive() -> Picture:
    return Picture("drive", 0.0, np.zeros((1, 1, 3), np.uint8), CAMERA)


def test_widths_are_compared_with_a_lane_of_the_us() -> None:
    estimates = [replace(NOTHING, lane_width_m=width, lateral_offset_m=0.1) for width in (3.7, 3.885, None)]
    row = lane_widths([(picture_of_a_drive(), estimate) for estimate in estimates])
    assert row["given_pct"] == pytest.approx(200 / 3)
    assert row["width_error_pct_median"] == pytest.approx(2.5)
    assert row["offset_jump_m_p95"] == 0.0


def test_a_set_that_is_not_there_is_left_out_with_the_reason(tmp_path: Path) -> None:
    found = bench_real(["cv"], tmp_path, tmp_path, quick=True)
    assert set(found) == set(SETS)
    assert found["tusimple"] == {"left out": "no folder tusimple_lanenet in the data folder"}


def test_the_data_folder_is_the_given_one_the_environments_or_the_neighbour(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert data_folder(Path("here")) == Path("here")
    monkeypatch.setenv("TREPID_DATA", "/there")
    assert data_folder(None) == Path("/there")
    monkeypatch.delenv("TREPID_DATA")
    assert data_folder(None) == ROOT.parent / "shared" / "data"


def test_a_set_is_judged_once_for_the_same_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    judged = []

    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        judged.append(every)
        yield replace(picture_of_a_drive(), image=np.zeros((240, 320, 3), np.uint8), steering_rad=0.1)

    (tmp_path / "set").mkdir()
    monkeypatch.setattr(real, "SETS", {"made up": real.RealSet("set", pictures, steering)})
    first = bench_real(["cv"], tmp_path, tmp_path / "out", quick=False)
    assert bench_real(["cv"], tmp_path, tmp_path / "out", quick=False) == first
    assert judged == [1]
    assert first["made up"]["cv"]["given_pct"] == 0.0


@pytest.mark.skipif(
    not (data_folder(None) / "tusimple_lanenet").is_dir(),
    reason="the real sets are not beside the repository",
)
def test_the_default_estimator_finds_ego_lines_on_the_real_highway(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(real, "SETS", {"tusimple": SETS["tusimple"]})
    found = bench_real(["cv"], data_folder(None), tmp_path, quick=True)
    assert found["tusimple"]["cv"]["accuracy_pct"] > 85.0
