"""A recorded drive as table, video, figure and tub: the values are those of the recording, at the right times."""

import csv
import json
import math
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet
import pytest
from foreign_ros_rig import damage_chunk
from recorded_rig import record_drive

from cockpit.export.drive import STALE_S, Drive
from cockpit.export.film import draw_frame
from cockpit.export.frames import DrivenFrame, rate_of
from cockpit.export.table import Table, table, times
from cockpit.export.tub import write_tub
from learning.dataset.sources.log import Faults
from learning.dataset.sources.tub import BY_PILOT, is_tub, read_tub
from sim_harness.scenarios.scenario import load_scenario
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.cli import main
from trepid.clock import seconds
from trepid.config import CONFIG_DIR, load
from trepid.messages import CompressedFrame, RoadUsers, SteeringEstimate, VehicleState
from trepid.recording.foreign import in_order
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording
from trepid.topics import CAMERA_COMPRESSED, DECISION, ROAD_USERS, VEHICLE_STATE, estimate_topic
from trepid.wire import to_cdr

SCENARIO = load_scenario("straight", {"duration_s": "5"})
START_S = 2000.0


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("drive") / "drive.mcap"
    return record_drive(path, SCENARIO)


IMAGE = np.full((48, 64, 3), 90, np.uint8)


def jpeg() -> bytes:
    return cv2.imencode(".jpg", IMAGE)[1].tobytes()


def state(t_s: float, angle_rad: float | None, *, driver: bool = False) -> VehicleState:
    return VehicleState(
        t_s=t_s, speed_mps=2.0, road_wheel_angle_rad=angle_rad, yaw_rate_radps=None, driver_override=driver
    )


def write_messages(path: Path, states: Iterable[VehicleState], images_s: Iterable[float]) -> Path:
    """A recording of these messages, each of which arrives at its own time."""
    sent: list[tuple[Any, Any]] = [(VEHICLE_STATE, one) for one in states]
    sent += [(CAMERA_COMPRESSED, CompressedFrame(t_s=t_s, jpeg=jpeg())) for t_s in images_s]
    with Recording(path, {}, {"began_ns": str(round(START_S * 1e9))}) as out:
        for topic, message in sorted(sent, key=lambda entry: entry[1].t_s):
            out.add(topic.key, to_cdr(message), at_s=message.t_s)
    return path


def rows_of(path: Path) -> Table:
    opened = Drive(path)
    return table(opened, times(opened, None))


def run_export(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, *words: object) -> Any:
    """The exit code, standard output and standard error of ``trepid export``."""
    monkeypatch.setattr("sys.argv", ["trepid", "export", *map(str, words)])
    code = main()
    shown = capsys.readouterr()
    return code, shown.out, shown.err


@pytest.fixture
def export(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Any:
    return lambda *words: run_export(capsys, monkeypatch, *words)


def test_a_row_holds_the_last_message_before_it_and_no_later_one(drive: Path) -> None:
    rows, recorded = rows_of(drive), read_recording(drive, DECISION.key, VEHICLE_STATE.key)
    zero_s = recorded.began_s
    assert zero_s is not None and len(rows["t_s"]) > 100
    for topic, column in ((DECISION, "fear"), (VEHICLE_STATE, "speed_mps")):
        for t_s, value in zip(rows["t_s"], rows[column], strict=True):
            assert isinstance(t_s, float)
            before = [message for at_s, message in recorded.of(topic) if at_s - zero_s <= t_s + 1e-9]
            assert value == getattr(before[-1], column)


def test_a_recording_that_ends_earlier_gives_the_same_rows_up_to_its_end(drive: Path, tmp_path: Path) -> None:
    short, held = tmp_path / "short.mcap", read_recording(drive)
    until_s = held.first_s + 2.5
    with Recording(short, {}, held.notes) as out:
        for log_ns, key, data in in_order(drive):
            if seconds(log_ns) <= until_s:
                out.add(key, data, at_s=seconds(log_ns))
    whole, part = rows_of(drive), rows_of(short)
    count = len(part["t_s"])
    assert 50 < count < len(whole["t_s"])
    assert part == {name: values[:count] for name, values in whole.items()}


def test_there_is_one_row_for_every_frame_of_the_drive_although_fewer_images_are_recorded(
    drive: Path, tmp_path: Path
) -> None:
    sparse, images = tmp_path / "sparse.mcap", 0
    with Recording(sparse, {}, read_recording(drive).notes) as out:
        for log_ns, key, data in in_order(drive):
            images += key == CAMERA_COMPRESSED.key
            if key != CAMERA_COMPRESSED.key or images % 3 == 0:
                out.add(key, data, at_s=seconds(log_ns))
    opened, rows = Drive(sparse), rows_of(sparse)
    estimated = {one.t_s for _, one in opened.recorded.of(estimate_topic("cv"))}
    assert len(rows["t_s"]) >= len(estimated) > len(opened.image_s)
    assert rows["frame"] == list(range(len(rows["t_s"])))


def test_an_estimate_is_in_no_row_before_its_arrival(drive: Path) -> None:
    rows = rows_of(drive)
    ages = [
        now - then
        for now, then in zip(rows["t_s"], rows["cv_frame_t_s"], strict=True)
        if isinstance(now, float) and isinstance(then, float)
    ]
    assert len(ages) > 100 and min(ages) > 0  # a frame and its estimate never have the same time


def test_the_rows_at_a_rate_are_equally_spaced(drive: Path) -> None:
    opened = Drive(drive)
    t_s = np.diff(times(opened, 20.0))
    assert np.allclose(t_s, 0.05)
    assert times(opened, 20.0)[-1] <= opened.frames_s[-1] + 1e-6


def test_what_is_missing_or_old_is_empty(tmp_path: Path) -> None:
    at_s = [START_S + 0.1 * k for k in range(15)]
    path = write_messages(tmp_path / "d.mcap", [state(at_s[3], None)], at_s)
    rows = rows_of(path)
    fresh = [k for k, t_s in enumerate(at_s) if 0 <= t_s - at_s[3] <= STALE_S]
    assert [k for k, value in enumerate(rows["speed_mps"]) if value is not None] == fresh
    assert set(rows["road_wheel_angle_rad"]) == set(rows["fear"]) == {None}


@pytest.mark.parametrize("t_s", [5.0, START_S - 20.0, START_S + 20.0])
def test_a_message_with_an_impossible_capture_time_gives_no_frame_and_is_counted(
    tmp_path: Path, export: Any, t_s: float
) -> None:
    path, at_s = tmp_path / "d.mcap", [START_S + 0.1 * k for k in range(15)]
    cv = SteeringEstimate.nothing(0.0, estimator="cv", lookahead_m=8.0, reason="")
    with Recording(path, {}, {"began_ns": str(round(START_S * 1e9))}) as out:
        for number, one_s in enumerate(at_s):
            of_s = t_s if number == 7 else one_s
            out.add(estimate_topic("cv").key, to_cdr(replace(cv, t_s=of_s)), at_s=one_s + 0.02)
            out.add(CAMERA_COMPRESSED.key, to_cdr(CompressedFrame(t_s=of_s, jpeg=jpeg())), at_s=one_s + 0.03)
    rows = rows_of(path)
    assert rows["t_s"] == pytest.approx([one_s - START_S for one_s in at_s if one_s != at_s[7]])
    code, shown, err = export(path, tmp_path / "d.mp4", "--rate", 20, "--json")
    summary = json.loads(shown)
    assert code == 0 and (summary["rows"], summary["from_s"], summary["to_s"]) == (29, 0.0, 1.4)
    assert summary["impossible"] == {estimate_topic("cv").key: 1, CAMERA_COMPRESSED.key: 1}
    assert "perception/cv/estimate: 1 messages with an impossible capture time give no frame" in err


def test_a_recording_whose_capture_times_are_all_impossible_is_refused_in_one_line(
    tmp_path: Path, export: Any
) -> None:
    with Recording(tmp_path / "d.mcap") as out:
        out.add(CAMERA_COMPRESSED.key, to_cdr(CompressedFrame(t_s=5.0, jpeg=jpeg())), at_s=START_S)
    code, _, err = export(tmp_path / "d.mcap", tmp_path / "d.csv")
    assert code == 2 and err.count("\n") == 1 and "with a possible capture time" in err


def test_csv_and_parquet_hold_the_same_table(drive: Path, tmp_path: Path, export: Any) -> None:
    for name in ("d.csv", "d.parquet"):
        code, out, _ = export(drive, tmp_path / name, "--json")
        assert code == 0
        summary = json.loads(out)
        assert summary["rows"] == 126 and summary["complete"]
    stored = pyarrow.parquet.read_table(tmp_path / "d.parquet").to_pydict()
    with (tmp_path / "d.csv").open(newline="") as file:
        lines = list(csv.DictReader(file))
    assert list(stored) == list(lines[0]) == summary["columns"]
    for name, values in stored.items():
        for line, value in zip(lines, values, strict=True):
            assert line[name] == "" if value is None else type(value)(line[name]) == value
    assert stored["fear"][0] == 1.0 and stored["cv_confidence"][0] is None


def test_the_video_lasts_as_long_as_the_images_and_shows_what_was_decided(
    drive: Path, tmp_path: Path, export: Any
) -> None:
    code, out, _ = export(drive, tmp_path / "d.mp4", "--rate", 10, "--json")
    opened = Drive(drive)
    lasted_s = opened.image_s[-1] - opened.image_s[0]
    video = cv2.VideoCapture(str(tmp_path / "d.mp4"))
    assert code == 0
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) == json.loads(out)["rows"] == math.floor(lasted_s * 10) + 1
    assert video.get(cv2.CAP_PROP_FPS) == 10
    read = [video.read()[1] for _ in range(20)]
    plain = [image for _, image, _ in opened.images()]
    shown = cv2.resize(read[-1], plain[0].shape[1::-1])
    changed = np.abs(shown.astype(int) - plain[15].astype(int)).max(axis=2) > 60
    assert 0.01 < changed.mean() < 0.4  # lines, path and strip, and the rest is the image


def test_a_person_is_drawn_in_the_very_frame_where_the_detector_found_it(tmp_path: Path) -> None:
    path, times_s = tmp_path / "d.mcap", (START_S, START_S + 0.1)
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    place = dict(x_m=(12.0,), y_m=(-1.5,), x_mps=(0.0,), y_mps=(0.0,), confidences=(0.9,))
    with Recording(path, {}, {}) as out:
        for t_s in times_s:
            out.add(CAMERA_COMPRESSED.key, to_cdr(CompressedFrame(t_s=t_s, jpeg=jpeg())), at_s=t_s)
        users = RoadUsers(t_s=times_s[1], kinds=("person",), detects=("person",), **place)
        out.add(ROAD_USERS.key, to_cdr(users), at_s=times_s[1] + 0.05)
    opened = Drive(path)
    without, shown = (
        draw_frame(opened, t_s, np.full((240, 320, 3), 90, np.uint8), camera, vehicle) for t_s in times_s
    )
    rows, columns = np.nonzero((without != shown).any(axis=2))
    feet_px = 2 * camera.pixel_from_road([[12.0, -1.5]])[0]  # the film is twice as wide as the picture
    assert rows.max() == pytest.approx(feet_px[1], abs=4)
    yellow = (np.abs(shown - np.array([77.0, 225.0, 255.0])) < 70).all(axis=2)
    assert np.nonzero(yellow)[1].mean() == pytest.approx(feet_px[0], abs=2) and len(columns) > 200


def test_the_rate_of_a_video_is_the_usual_one_of_the_images() -> None:
    assert rate_of([0.0, 0.1, 0.2, 0.3, 5.3]) == pytest.approx(10.0)


def test_the_figure_is_a_picture_of_its_format(drive: Path, tmp_path: Path, export: Any) -> None:
    assert export(drive, tmp_path / "d.png")[0] == 0
    image = cv2.imread(str(tmp_path / "d.png"))
    assert image is not None and image.shape[0] > 800 and (image < 200).mean() > 0.005


def test_a_tub_is_read_back_with_right_as_positive_and_the_share_of_the_lock(
    tmp_path: Path, export: Any
) -> None:
    lock_rad = load(CONFIG_DIR / "vehicle.yaml", Vehicle).max_road_wheel_angle_rad
    at_s = [START_S + 0.1 * k for k in range(4)]
    angles = [0.5 * lock_rad, -0.25 * lock_rad, -2 * lock_rad, None]
    states = [state(t, angle, driver=k < 2) for k, (t, angle) in enumerate(zip(at_s, angles, strict=True))]
    path = write_messages(tmp_path / "d.mcap", states, at_s)
    code, out, _ = export(path, tmp_path / "tub", "--json")
    assert code == 0 and {"rows": 3, "left_out": 1}.items() <= json.loads(out).items()
    assert is_tub(tmp_path / "tub")
    log = read_tub(tmp_path / "tub", Faults(strict=True), {})
    assert not log.left_positive
    assert log.steering == pytest.approx([-0.5, 0.25, 1.0])
    assert log.t_s == pytest.approx(at_s[:3]) and log.speed_mps == pytest.approx([2.0, 2.0, 2.0])
    assert log.why == ["", "", BY_PILOT]
    assert [(log.root / name).read_bytes() for name in log.image] == [jpeg()] * 3


def test_the_throttle_of_a_tub_is_a_share_of_the_greatest_speed_also_backwards(tmp_path: Path) -> None:
    frames = [
        DrivenFrame(t_s=START_S + k, image=IMAGE, jpeg=jpeg(), road_wheel_rad=0.0, speed_mps=speed_mps)
        for k, speed_mps in enumerate((1.0, -4.0, math.nan))
    ]
    assert write_tub(frames, tmp_path / "tub", lock_rad=0.5) == 3
    lines = (tmp_path / "tub" / "catalog_0.catalog").read_text().splitlines()
    assert [json.loads(line).get("user/throttle") for line in lines] == [0.25, -1.0, None]


def test_a_lerobot_data_set_of_a_drive_without_a_scenario_has_a_task(tmp_path: Path, export: Any) -> None:
    path = tmp_path / "d.mcap"
    with Recording(path, {}, {"what": ""}) as out:
        for k in range(4):
            t_s = START_S + 0.1 * k
            out.add(VEHICLE_STATE.key, to_cdr(state(t_s, 0.01)), at_s=t_s)
            out.add(CAMERA_COMPRESSED.key, to_cdr(CompressedFrame(t_s=t_s, jpeg=jpeg())), at_s=t_s)
    assert export(path, tmp_path / "set", "--to", "lerobot")[0] == 0
    tasks = pyarrow.parquet.read_table(tmp_path / "set" / "meta" / "tasks.parquet").to_pylist()
    assert [row["task"] for row in tasks] == ["drive"]


def test_the_catalogs_of_a_tub_have_the_lengths_by_which_donkeycar_finds_a_record(
    tmp_path: Path, export: Any
) -> None:
    at_s = [START_S + 0.02 * k for k in range(1003)]
    path = write_messages(tmp_path / "d.mcap", [state(t_s, 0.01) for t_s in at_s], at_s)
    assert export(path, tmp_path / "tub")[0] == 0
    held = json.loads((tmp_path / "tub" / "manifest.json").read_text().splitlines()[4])
    assert held["paths"] == ["catalog_0.catalog", "catalog_1.catalog"] and held["current_index"] == 1003
    for name, start, count in zip(held["paths"], (0, 1000), (1000, 3), strict=True):
        about = json.loads((tmp_path / "tub" / f"{name}_manifest").read_text())
        data = (tmp_path / "tub" / name).read_bytes()
        assert about["start_index"] == start and about["path"] == f"{name}_manifest"
        assert len(about["line_lengths"]) == count and sum(about["line_lengths"]) == len(data)
        begin = sum(about["line_lengths"][:-1])
        assert json.loads(data[begin:])["_index"] == start + count - 1


def test_an_existing_output_is_kept(drive: Path, tmp_path: Path, export: Any) -> None:
    for out in (tmp_path / "d.csv", tmp_path / "tub"):
        out.mkdir() if out.suffix == "" else out.write_text("mine")
        code, _, err = export(drive, out)
        assert code == 2 and err.count("\n") == 1 and "exists already" in err
    assert (tmp_path / "d.csv").read_text() == "mine"


@pytest.mark.parametrize(
    ("content", "out", "what"),
    [
        (None, "d.csv", "cannot be read"),
        (b"no recording", "d.csv", "not a recording"),
        (b"no recording", "missing/d.csv", "no such folder"),
        (b"no recording", "d.xyz", "unknown suffix"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    tmp_path: Path, export: Any, content: bytes | None, out: str, what: str
) -> None:
    path = tmp_path / "d.mcap"
    if content is not None:
        path.write_bytes(content)
    code, shown, err = export(path, tmp_path / out)
    assert code == 2 and shown == "" and err.count("\n") == 1 and what in err
    assert [one.name for one in tmp_path.iterdir()] == ([] if content is None else ["d.mcap"])


@pytest.mark.parametrize("out", ["d.mp4", "tub"])
def test_a_recording_without_what_the_format_needs_is_one_line(
    drive: Path, tmp_path: Path, export: Any, out: str
) -> None:
    path, key = tmp_path / "d.mcap", estimate_topic("cv").key
    with Recording(path) as made:
        for log_ns, held, data in in_order(drive):
            if held == key:
                made.add(key, data, at_s=seconds(log_ns))
    code, _, err = export(path, tmp_path / out)
    assert code == 2 and "holds no camera image" in err
    assert not (tmp_path / out).exists()


def test_a_recording_that_is_cut_short_is_exported_and_reported(
    drive: Path, tmp_path: Path, export: Any
) -> None:
    path = tmp_path / "cut.mcap"
    path.write_bytes(drive.read_bytes()[: drive.stat().st_size * 3 // 4])
    code, out, err = export(path, tmp_path / "d.csv", "--json")
    summary = json.loads(out)
    assert code == 0 and not summary["complete"] and 20 < summary["rows"] < 125 and "cut short" in err


@pytest.mark.parametrize("out", ["d.csv", "tub"])
def test_a_recording_with_a_corrupted_chunk_is_exported_behind_it_with_the_number_of_lost_messages(
    drive: Path, tmp_path: Path, export: Any, out: str
) -> None:
    path = tmp_path / "damaged.mcap"
    path.write_bytes(drive.read_bytes())
    _, whole, _ = export(path, tmp_path / f"whole-{out}", "--json")
    damage_chunk(path, 3)
    code, text, err = export(path, tmp_path / out, "--json")
    summary, before = json.loads(text), json.loads(whole)
    assert code == 0 and summary["complete"] and before["lost"] == 0
    assert (summary["corrupted_parts"], summary["to_s"]) == (1, before["to_s"])
    assert 0 < summary["lost"] < 100 and 0 < before["rows"] - summary["rows"] < 10
    assert err.count("are corrupted") == 1
    assert f"{summary['lost']} messages of 1 corrupted parts are lost; exported without them" in err


def test_a_lerobot_data_set_holds_the_images_with_the_angles_at_their_capture(
    drive: Path, tmp_path: Path, export: Any
) -> None:
    out = tmp_path / "set"
    code, text, _ = export(drive, out, "--to", "lerobot", "--json")
    summary, opened = json.loads(text), Drive(drive)
    assert code == 0 and summary["format"] == "lerobot"
    info = json.loads((out / "meta" / "info.json").read_text())
    rows = pyarrow.parquet.read_table(out / info["data_path"].format(chunk_index=0, file_index=0)).to_pylist()
    assert (
        len(rows) == info["total_frames"] == summary["rows"] == len(opened.image_s) - summary["left_out"] > 40
    )
    assert info["fps"] == round(rate_of(opened.image_s)) and info["total_episodes"] == 1
    by_time = {round(t_s, 6): opened.newest(VEHICLE_STATE, t_s) for t_s in opened.image_s}
    for row in rows:
        known = by_time[round(row["capture_time_s"], 6)]
        assert known is not None
        assert row["action"] == pytest.approx(known.road_wheel_angle_rad, abs=1e-6)
    task = pyarrow.parquet.read_table(out / "meta" / "tasks.parquet").to_pylist()[0]["task"]
    assert task == "straight"


@pytest.mark.parametrize(("name", "words"), [("set", ["--to", "lerobot"]), ("v.mcap", []), ("tub", [])])
def test_a_rate_is_refused_where_the_recording_gives_the_times(
    drive: Path, tmp_path: Path, export: Any, name: str, words: list[str]
) -> None:
    code, _, err = export(drive, tmp_path / name, *words, "--rate", 10)
    assert code == 2 and "--rate is for tables and videos" in err and not (tmp_path / name).exists()
