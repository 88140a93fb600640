import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_road_rig import CAMERA, look
from driving_network_rig import write_network

from cockpit.footage.frames import FrameResult
from cockpit.footage.lane_rows import _cells, as_row, estimate_fields
from cockpit.footage.sources import Clip, sources
from sim_harness.footage.estimate_cli import estimate
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import SteeringEstimate

FIELDS = [
    "file",
    "frame",
    "estimator",
    "lateral_offset_m",
    "heading_error_rad",
    "curvature_1pm",
    "road_wheel_angle_rad",
    "confidence",
    "lanes_detected",
    "lane_width_m",
    "latency_ms",
    "reason",
    "left_boundary_px",
    "right_boundary_px",
]


def lines(capsys: pytest.CaptureFixture[str]) -> list[dict]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_a_folder_gives_one_json_object_per_image_in_order_of_name(folder, capsys):
    estimate([folder], as_json=True)
    rows = lines(capsys)
    assert [Path(row["file"]).name for row in rows] == ["a.jpg", "b.png"]
    assert all(list(row) == FIELDS for row in rows)
    assert all(row["lanes_detected"] == 2 and row["latency_ms"] > 0 for row in rows)


def test_only_a_proposed_speed_is_a_further_field():
    found = SteeringEstimate(t_s=0.0, estimator="pilot", lookahead_m=8.0, confidence=0.9, reason="")
    silent, proposing = (estimate_fields(replace(found, speed_mps=v), 1.0) for v in (None, 2.5))
    assert list(silent) == FIELDS[2:]
    assert proposing == silent | {"speed_mps": 2.5}


def test_a_clip_gives_one_numbered_object_per_frame(clip, capsys):
    estimate([clip], as_json=True)
    assert [row["frame"] for row in lines(capsys)] == list(range(12))


def test_an_undetected_value_is_null(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / "dark.png"), np.zeros((240, 320, 3), np.uint8))
    estimate([tmp_path / "dark.png"], as_json=True)
    (row,) = lines(capsys)
    assert row["confidence"] == 0 and row["reason"]
    assert all(row[name] is None for name in ("lateral_offset_m", "lane_width_m", "left_boundary_px"))


def test_an_assumed_camera_is_reported_once_and_a_given_one_is_used(folder, capsys):
    estimate([folder], as_json=True)
    assert capsys.readouterr().err.count("assumed camera") == 1
    estimate([folder], camera=Path("config/camera.yaml"), as_json=True)
    out, err = capsys.readouterr()
    assert err == ""
    assert json.loads(out.splitlines()[1])["lateral_offset_m"] == pytest.approx(0.1, abs=0.06)


def test_results_before_an_unreadable_input_are_kept(folder, capsys):
    good, bad = folder / "a.jpg", folder / "missing.png"
    with pytest.raises(InputError, match=r"missing\.png"):
        estimate([good, bad], as_json=True)
    assert [row["file"] for row in lines(capsys)] == [str(good)]


def test_an_unknown_estimator_is_refused_with_the_command_that_lists_all(folder):
    with pytest.raises(InputError, match=r"'magic'.*--estimator list"):
        estimate([folder], estimator="magic")


def test_the_list_of_estimators_needs_no_input(capsys):
    estimate(estimator="list", as_json=True)
    assert "cv" in [row["estimator"] for row in lines(capsys)]


def test_without_json_there_is_a_line_per_frame(folder, capsys):
    estimate([folder])
    out = capsys.readouterr().out
    assert "a.jpg" in out and "b.png" in out and "offset" in out


def test_annotated_frames_go_to_a_picture_a_video_or_a_folder(folder, clip, tmp_path):
    estimate([folder / "a.jpg"], as_json=True, annotate=tmp_path / "one.png")
    assert cv2.imread(str(tmp_path / "one.png")).shape[1] == 640
    estimate([clip], as_json=True, annotate=tmp_path / "seen.mp4")
    (video,) = sources(tmp_path / "seen.mp4")
    assert isinstance(video, Clip) and len(list(video.read())) == 12
    estimate([folder / "a.jpg", folder / "b.png", clip], as_json=True, annotate=tmp_path / "all")
    assert sorted(path.name for path in (tmp_path / "all").iterdir()) == ["a.png", "b.png", "clip.mp4"]


def test_images_annotated_into_their_own_folder_are_left_as_they_are(folder, picture):
    cv2.imwrite(str(folder / "a.png"), picture)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(InputError, match=r"a\.png: is an input"):
        estimate([folder], as_json=True, annotate=folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_an_annotated_film_is_as_long_as_its_source(folder, picture, tmp_path):
    fast = tmp_path / "fast.avi"
    writer = cv2.VideoWriter(str(fast), cv2.VideoWriter.fourcc(*"MJPG"), 59.94, (320, 240))
    for _ in range(6):
        writer.write(picture)
    writer.release()
    estimate([fast], as_json=True, annotate=tmp_path / "seen.mp4")
    estimate([folder], drive=True, fps=8.0, as_json=True, annotate=tmp_path / "drive.mp4")
    rates = [source.fps for name in ("seen", "drive") for source in sources(tmp_path / f"{name}.mp4")]
    assert rates == pytest.approx([59.94, 8.0], abs=0.01)


def test_a_row_of_json_is_finite_and_rounded(picture):
    row = as_row(FrameResult(Path("x.png"), 0, 0.0, picture, CAMERA, look(picture), 1.0))
    json.dumps(row, allow_nan=False)
    assert all(round(x, 1) == x for x, _ in row["left_boundary_px"])


def test_the_lead_detector_lists_vehicles_with_places_and_boxes(folder, capsys, tmp_path):
    estimate([folder], estimator="lead", as_json=True, annotate=tmp_path / "leads")
    for row in lines(capsys):
        assert row["estimator"] == "lead"
        assert {"distance_m", "lateral_m", "speed_mps", "confidence", "detections", "latency_ms"} <= set(row)
        assert row["speed_mps"] is None, "without odometry there is no speed"
    assert sorted(path.name for path in (tmp_path / "leads").iterdir()) == ["a.png", "b.png"]


def test_a_detector_file_is_for_the_lead_estimator_only(folder):
    with pytest.raises(InputError, match="--detector"):
        estimate([folder], detector=Path("some.onnx"))


def test_a_missing_detector_file_is_named(folder, tmp_path):
    with pytest.raises(InputError, match=r"none\.tflite"):
        estimate([folder], estimator="lead", detector=tmp_path / "none.tflite")


def test_a_camera_that_the_network_is_not_made_for_gives_no_estimate_and_the_reason(folder, tmp_path, capsys):
    low = tmp_path / "low.yaml"
    low.write_text(Path("config/camera.yaml").read_text().replace("height_m: 1.45", "height_m: 0.6"))
    estimate([folder], estimator="cnn", camera=low, as_json=True)
    rows = lines(capsys)
    assert [(row["estimator"], row["confidence"], row["lateral_offset_m"]) for row in rows] == 2 * [
        ("cnn", 0, None)
    ]
    assert all("look like 7.97 m from 1.45 m" in row["reason"] for row in rows)


def test_unreadable_images_of_a_folder_are_named_and_left_out(folder, capsys):
    (folder / "aa.png").write_bytes((folder / "b.png").read_bytes()[:-200])
    (folder / "ab.jpg").write_text("no image")
    assert estimate([folder], camera=CONFIG_DIR / "camera.yaml", as_json=True) == 1
    printed = capsys.readouterr()
    assert [Path(json.loads(line)["file"]).name for line in printed.out.splitlines()] == ["a.jpg", "b.png"]
    assert [line.split(":")[0].rpartition("/")[2] for line in printed.err.splitlines()] == [
        "aa.png",
        "ab.jpg",
    ]


def test_an_image_of_any_shape_gives_a_result_among_the_others(folder, capsys):
    for name, height, width in (("tall", 3000, 20), ("wide", 20, 3000), ("point", 1, 1), ("row", 1, 3000)):
        cv2.imwrite(str(folder / f"{name}.png"), np.full((height, width, 3), 99, np.uint8))
    for estimator in ("cv", "cnn", "lead"):
        assert estimate([folder], estimator=estimator, as_json=True) == 0
        assert len(lines(capsys)) == 6


def test_strict_ends_at_the_first_unreadable_image(folder):
    (folder / "aa.png").write_text("no image")
    with pytest.raises(InputError, match=r"aa\.png"):
        estimate([folder], strict=True, as_json=True)


def test_an_unreadable_image_that_was_named_itself_is_refused(folder):
    (folder / "aa.png").write_text("no image")
    with pytest.raises(InputError, match=r"aa\.png"):
        estimate([folder / "aa.png"], as_json=True)


def test_the_images_of_a_drive_are_tracked_and_keep_their_places_in_time(folder, capsys):
    (folder / "aa.png").write_text("no image")
    assert estimate([folder], camera=CONFIG_DIR / "camera.yaml", drive=True, as_json=True) == 1
    assert [(Path(row["file"]).name, row["frame"]) for row in lines(capsys)] == [("a.jpg", 0), ("b.png", 2)]


def test_the_network_gets_boundaries_half_its_lane_width_from_its_lane_centre(folder, capsys):
    estimate([folder], estimator="cnn", camera=CONFIG_DIR / "camera.yaml", as_json=True)
    camera = load(CONFIG_DIR / "camera.yaml", Camera)
    for row in lines(capsys):
        left, right = (camera.road_from_pixel(row[f"{side}_boundary_px"])[0] for side in ("left", "right"))
        assert left[1] - right[1] == pytest.approx(row["lane_width_m"], abs=0.15)


def test_a_driving_network_gives_angles_alone_and_with_the_supervisor(folder, tmp_path, capsys):
    network = str(write_network(tmp_path / "turn.onnx"))
    estimate([folder], estimator=network, as_json=True)
    rows = lines(capsys)
    assert {row["estimator"] for row in rows} == {"turn"}
    assert all(abs(row["road_wheel_angle_rad"]) < 1 and row["lateral_offset_m"] is None for row in rows)
    estimate([folder], estimator=network, fear=True, speed=5.0, as_json=True)
    assert [list(row["estimates"]) for row in lines(capsys)] == [["cv", "cnn", "turn"]] * 2


def test_a_number_that_rounds_to_zero_is_printed_without_a_minus():
    nothing = SteeringEstimate.nothing(0.0, estimator="cv", lookahead_m=8.0, reason="")
    tiny = replace(nothing, lateral_offset_m=-0.0004, heading_error_rad=-1e-6, curvature_1pm=-1e-6)
    cells = _cells(FrameResult(Path("a.png"), 0, 0.0, np.zeros((9, 9, 3), np.uint8), CAMERA, tiny, 1.0))
    assert cells[2:5] == ["+0.00", "+0.00", "+0.0000"]


def test_an_image_of_another_size_than_the_first_of_a_drive_is_named_and_left_out(folder, picture, capsys):
    cv2.imwrite(str(folder / "c.png"), picture[:200, :300])
    assert estimate([folder], drive=True, as_json=True) == 1
    out, err = capsys.readouterr()
    assert [Path(json.loads(line)["file"]).name for line in out.splitlines()] == ["a.jpg", "b.png"]
    assert "c.png: 300 x 200 px, but the first image of the drive has 320 x 240 px; left out" in err
    with pytest.raises(InputError, match="300 x 200"):
        estimate([folder], drive=True, strict=True)
