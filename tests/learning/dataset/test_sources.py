"""Readers of logs: what each format says, and which rows and logs are refused."""

import json
import math
import re
import unicodedata
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_rig import picture, steering_of, write_pictures, write_table, write_tub, write_tub_1, write_udacity
from foreign_ros_rig import damage_chunk

from learning.dataset.build import read_log
from learning.dataset.pictures import PictureReader
from learning.dataset.sources.log import Faults, Log, SteeringUnit
from learning.dataset.sources.table import TableOptions
from learning.dataset.sources.written_paths import ImageFolder
from learning.dataset.wheel import WheelOptions, road_wheel_rad, wheel_of
from trepid.config import InputError, use_car
from trepid.messages import CompressedFrame, VehicleState
from trepid.recording.csv_file import MPS_PER_MPH
from trepid.recording.writer import Recording
from trepid.topics import CAMERA_COMPRESSED, VEHICLE_STATE
from trepid.wire import to_cdr


def read(path: Path, options: TableOptions | None = None) -> tuple[Log, Faults]:
    faults = Faults(strict=False)
    return read_log(path, faults, options or TableOptions()), faults


def test_tub_2_honours_deleted_records_and_leaves_out_the_pilot(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 30, deleted=(3, 4))
    catalog = tub / "catalog_0.catalog"
    lines = catalog.read_text().splitlines()
    lines[8] = lines[8].replace('"user/mode": "user"', '"user/mode": "local_angle"')
    catalog.write_text("\n".join(lines))
    log, faults = read(tub)
    assert [n for n, why in enumerate(log.why) if why == "deleted in the tub"] == [3, 4]
    assert [n for n, why in enumerate(log.why) if why == "driven by a pilot"] == [8]
    assert log.steering == pytest.approx(steering_of(30)) and log.unit == SteeringUnit.LOCK
    assert np.diff(log.t_s) == pytest.approx(0.05, abs=1e-6)
    assert faults.count == 0


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ('{"_index": 5, "cam', "catalog_0.catalog:6: not a record"),
        ("[1, 2]", "catalog_0.catalog:6: not a record: expected names and values"),
        ('{"_index": 5, "user/angle": 0.1}', "catalog_0.catalog:6: no cam/image_array"),
        (
            '{"cam/image_array": "5_cam_image_array_.jpg", "user/angle": "left"}',
            "expected a number, got 'left'",
        ),
    ],
)
def test_a_broken_line_of_a_catalog_is_named_and_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    tub = write_tub(tmp_path / "tub", 30)
    catalog = tub / "catalog_0.catalog"
    lines = catalog.read_text().splitlines()
    catalog.write_text("\n".join([*lines[:5], text, *lines[6:]]))
    log, faults = read(tub)
    assert (len(log), log.unread, faults.count) == (29, 1, 1)
    assert said in capsys.readouterr().err


def test_times_of_a_tub_that_many_records_share_are_refused(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    catalog = tub / "catalog_0.catalog"
    records = [json.loads(line) for line in catalog.read_text().splitlines()]
    whole = [json.dumps({**one, "_timestamp_ms": one["_timestamp_ms"] // 1000}) for one in records]
    catalog.write_text("\n".join(whole))
    with pytest.raises(InputError, match=r"_timestamp_ms: 60 rows have \d+ times?: rounded"):
        read(tub)


DAMAGES = {
    "short": (lambda lines: lines[:4], "manifest.json: 4 lines, expected 5"),
    "tail": (
        lambda lines: [*lines[:3], lines[3] + '"20-09-13_0"]}}', lines[4]],
        "manifest.json:4: '\"20-09-13_0\"]}}' after its value, as the end of an older, longer line; not used",
    ),
    "tail of the catalogs": (
        lambda lines: [*lines[:4], lines[4] + "7]}"],
        "manifest.json:5: '7]}' after its value",
    ),
    "unused": (lambda lines: [*lines[:2], "{", *lines[3:]], "manifest.json:3: not JSON"),
    "inputs": (lambda lines: ["[1", *lines[1:]], "manifest.json:1: not JSON"),
    "types": (lambda lines: [lines[0], '["float"]', *lines[2:]], "manifest.json:1: no names of inputs"),
    "empty": (lambda _: [], "manifest.json: 0 lines, expected 5"),
    "zeros": (lambda _: ["\0" * 300], "manifest.json:1:1: holds only zero bytes, as after a loss of power"),
    "another version": (lambda _: ['{"version": 3}'], "manifest.json: 1 lines, expected 5"),
}


@pytest.mark.parametrize("damage", DAMAGES)
def test_a_damaged_manifest_is_named_and_costs_no_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    tub = write_tub(tmp_path / "tub", 30)
    change, said = DAMAGES[damage]
    lines = (tub / "manifest.json").read_text().split("\n")[:5]
    (tub / "manifest.json").write_text("\n".join(change(lines)))
    log, faults = read(tub)
    assert (len(log), log.unread, faults.rows) == (30, 0, 0)
    assert faults.count == 1 and said in capsys.readouterr().err
    with pytest.raises(InputError, match=re.escape(said.partition(";")[0])):
        read_log(tub, Faults(strict=True), TableOptions())


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "meta.json:1: not JSON"),
        ('{"inputs": ["cam/image_array"], "types"', "meta.json:1: not JSON"),
        ("\0" * 80, "meta.json:1:1: holds only zero bytes, as after a loss of power"),
        ('{"inputs": [1], "types": ["float"]}', "meta.json:1: no names of inputs with their types"),
        ("[]", "meta.json:1: no names of inputs with their types"),
    ],
)
def test_a_damaged_index_of_a_tub_1_is_named_and_costs_no_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    tub = write_tub_1(tmp_path / "tub", 20)
    whole, none = read(tub)
    (tub / "meta.json").write_text(text)
    log, faults = read(tub)
    assert (log.image, log.steering.tolist()) == (whole.image, whole.steering.tolist())
    assert (none.count, faults.count, faults.rows) == (0, 1, 0)
    assert f"{said}" in (err := capsys.readouterr().err) and "the images are sought in the records" in err
    with pytest.raises(InputError, match=re.escape(said)):
        read_log(tub, Faults(strict=True), TableOptions())


def test_a_tub_without_manifest_is_read_by_its_catalogs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = write_tub(tmp_path / "tub", 30)
    (tub / "manifest.json").unlink()
    log, faults = read(tub)
    assert (log.kind, len(log), faults.count) == ("tub2", 30, 1)
    assert "manifest.json: is missing; the catalogs of the folder are read" in capsys.readouterr().err
    assert log.notes == ["the manifest is damaged: which records were deleted is not known"]


def test_deleted_records_stay_out_where_only_an_unused_line_of_the_manifest_is_damaged(
    tmp_path: Path,
) -> None:
    tub = write_tub(tmp_path / "tub", 30, deleted=(3,))
    lines = (tub / "manifest.json").read_text().split("\n")
    (tub / "manifest.json").write_text("\n".join([*lines[:3], "{", lines[4]]))
    assert [n for n, why in enumerate(read(tub)[0].why) if why] == [3]


def divided_tub(folder: Path) -> Path:
    """A tub of 30 records in three catalogs."""
    tub = write_tub(folder, 30)
    records = (tub / "catalog_0.catalog").read_text().splitlines(keepends=True)
    for number in range(3):
        (tub / f"catalog_{number}.catalog").write_text("".join(records[10 * number : 10 * number + 10]))
    lines = (tub / "manifest.json").read_text().splitlines()
    paths = {"paths": [f"catalog_{number}.catalog" for number in range(3)]}
    (tub / "manifest.json").write_text("\n".join([*lines[:4], json.dumps(json.loads(lines[4]) | paths)]))
    return tub


@pytest.mark.parametrize("loss", ["missing", "empty", "cut"])
def test_records_that_no_catalog_holds_are_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], loss: str
) -> None:
    tub = divided_tub(tmp_path / "tub")
    catalog = tub / "catalog_1.catalog"
    kept = {"missing": 0, "empty": 0, "cut": 4}[loss]
    lines = catalog.read_text().splitlines(keepends=True)
    catalog.write_text("".join(lines[:kept]))
    if loss == "missing":
        catalog.unlink()
    log, faults = read(tub)
    assert (len(log), log.unread, faults.rows) == (20 + kept, 10 - kept, 10 - kept)
    said = f"manifest.json:5: current_index is 30, and {10 - kept} records are in no catalog; lost"
    assert said in capsys.readouterr().err


def test_a_catalog_that_the_manifest_does_not_list_is_named_and_read_in_its_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = divided_tub(tmp_path / "tub")
    manifest = tub / "manifest.json"
    manifest.write_text(manifest.read_text().replace('"catalog_1.catalog", ', ""))
    log, faults = read(tub)
    assert (faults.count, log.unread) == (1, 0) and (np.diff(log.t_s) > 0.0).all() and len(log) == 30
    assert "catalog_1.catalog: is not in the manifest; read" in capsys.readouterr().err


def test_the_records_of_a_copied_catalog_count_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = divided_tub(tmp_path / "tub")
    before, _ = read(tub)
    (tub / "catalog_3.catalog").write_bytes((tub / "catalog_1.catalog").read_bytes())
    log, faults = read(tub)
    assert (log.image, log.t_s.tolist()) == (before.image, before.t_s.tolist())
    assert faults.rows == 10
    assert "catalog_3.catalog:1: 10 records from here on are read already" in capsys.readouterr().err


@pytest.mark.parametrize("folder", ["/home/pi/mycar/data/", "C:\\Users\\me\\mycar\\data\\", "data\\"])
def test_paths_of_the_machine_of_the_drive_lead_to_the_files_of_their_names(
    tmp_path: Path, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = divided_tub(tmp_path / "tub")
    before, _ = read(tub)
    for file in (tub / "manifest.json", *tub.glob("*.catalog")):
        named = json.dumps(folder)[1:-1]
        text = file.read_text().replace('"catalog_', f'"{named}catalog_')
        file.write_text(text.replace('"cam/image_array": "', f'"cam/image_array": "{named}'))
    log, faults = read(tub)
    assert (log.image, faults.count, capsys.readouterr().err) == (before.image, 0, "")


def test_images_beside_the_catalogs_are_found(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 5)
    for image in (tub / "images").iterdir():
        image.rename(tub / image.name)
    (tub / "images").rmdir()
    log, faults = read(tub)
    assert faults.count == 0 and all((log.root / name).is_file() for name in log.image)


def test_a_line_of_a_catalog_with_broken_bytes_costs_this_record_only(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 30)
    lines = (tub / "catalog_0.catalog").read_bytes().split(b"\n")
    lines[7] = lines[7].replace(b"user/mode", b"user/\xff\xfe")
    lines[9] = bytes(len(lines[9]))
    (tub / "catalog_0.catalog").write_bytes(b"\n".join(lines))
    log, faults = read(tub)
    assert (len(log), log.unread, faults.count) == (28, 2, 2)


def test_a_folder_with_another_manifest_and_no_catalog_is_refused(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"name": "a page"}')
    with pytest.raises(
        InputError, match=r"1 lines, expected 5, and there is no catalog_<n>\.catalog beside it"
    ):
        read(tmp_path)


@pytest.mark.parametrize("scale", [100.0, 25.0])
def test_steering_of_a_tub_that_is_no_share_of_full_steering_is_refused(tmp_path: Path, scale: float) -> None:
    tub = write_tub(tmp_path / "tub", 30)
    catalog = tub / "catalog_0.catalog"
    records = [json.loads(line) for line in catalog.read_text().splitlines()]
    catalog.write_text(
        "\n".join(json.dumps(one | {"user/angle": scale * one["user/angle"]}) for one in records)
    )
    with pytest.raises(InputError, match=r"user/angle exceeds ±1, so it is no share of full steering"):
        read(tub)


def test_tub_1_is_read_by_the_numbers_of_its_records(tmp_path: Path) -> None:
    log, _ = read(write_tub_1(tmp_path / "tub"))
    assert log.kind == "tub1"
    assert log.image[9] == "10_cam-image_array_.jpg"
    assert log.steering == pytest.approx(steering_of(60))
    assert log.t_s[10] == pytest.approx(0.5)


@pytest.mark.parametrize("header", [False, True])
def test_a_log_of_the_udacity_simulator_with_and_without_header(tmp_path: Path, header: bool) -> None:
    log, _ = read(write_udacity(tmp_path / "log", 90, header=header))
    assert log.kind == "udacity" and len(log) == 90
    assert np.diff(log.t_s) == pytest.approx(0.05, abs=1e-6)
    assert log.speed_mps == pytest.approx(15.0 * MPS_PER_MPH)
    assert (log.lock_rad, log.left_positive) == (math.radians(25.0), False)


# How a log may write IMG/a b-7.jpg: by other machines, tools and spellings of its name.
WRITTEN = {
    "drive of Windows": "C:\\Users\\me\\Desktop\\IMG\\a b-7.jpg",
    "share of Windows": "\\\\nas\\drives\\run 1\\IMG\\a b-7.jpg",
    "separators of Windows": "IMG\\a b-7.jpg",
    "both separators": "C:\\Users\\me/data/IMG/a b-7.jpg",
    "home of Linux": "/home/pi/mycar/data/IMG/a b-7.jpg",
    "folder of the log": "mycar/data/IMG/a b-7.jpg",
    "this folder": "./IMG/a b-7.jpg",
    "URL": "file:///home/pi/data/IMG/a%20b-7.jpg",
    "URL of Windows": "file:///C:/Users/me/IMG/a%20b-7.jpg",
    "address": "https://example.org/set/IMG/a%20b-7.jpg",
    "encoded": "IMG/a%20b%2D7.jpg",
    "upper case": "img/A B-7.JPG",
    "upper case of another machine": "D:\\DATA\\img\\A B-7.JPG",
}


@pytest.mark.parametrize("written", WRITTEN.values(), ids=WRITTEN)
def test_an_image_is_found_by_a_path_of_another_machine_tool_or_spelling(
    tmp_path: Path, written: str
) -> None:
    (tmp_path / "IMG").mkdir()
    (tmp_path / "IMG" / "a b-7.jpg").touch()
    assert ImageFolder(tmp_path).find(written) == "IMG/a b-7.jpg"


def test_a_name_as_it_is_written_counts_before_its_decoded_form_and_other_spellings(tmp_path: Path) -> None:
    for name in ("a%20b.jpg", "a b.jpg", "A.jpg", "a.jpg"):
        (tmp_path / name).touch()
    find = ImageFolder(tmp_path).find
    assert [find(name) for name in ("a%20b.jpg", "A.jpg", "a.jpg")] == ["a%20b.jpg", "A.jpg", "a.jpg"]


def test_a_spelling_that_two_images_have_names_neither_of_them(tmp_path: Path) -> None:
    for name in ("ab.jpg", "aB.jpg"):
        (tmp_path / name).touch()
    assert ImageFolder(tmp_path).find("AB.JPG") == "AB.JPG"


def test_composed_and_decomposed_letters_name_one_image(tmp_path: Path) -> None:
    (tmp_path / unicodedata.normalize("NFD", "Stra\u00dfe \u00fcber.jpg")).touch()
    found = ImageFolder(tmp_path).find(unicodedata.normalize("NFC", "Stra\u00dfe \u00fcber.jpg"))
    assert (tmp_path / found).is_file()


@pytest.mark.parametrize(
    ("written", "named"),
    [
        ("IMG/none.jpg", "IMG/none.jpg"),
        ("C:\\data\\IMG\\none.jpg", "IMG/none.jpg"),
        ("/d/IMG/none.jpg", "IMG/none.jpg"),
    ],
)
def test_an_image_that_is_missing_keeps_the_end_of_its_path(tmp_path: Path, written: str, named: str) -> None:
    assert ImageFolder(tmp_path).find(written) == named


def test_side_cameras_whose_folders_are_missing_do_not_get_the_image_of_the_middle_one(
    tmp_path: Path,
) -> None:
    sides = {"left": [f"left/{n}.jpg" for n in range(20)], "right": [f"right/{n}.jpg" for n in range(20)]}
    path = table(tmp_path, steering=steering_of(20).tolist(), **sides)
    with pytest.raises(InputError, match=r":2: the left camera and the middle one have one image, 0\.jpg"):
        read(path, TableOptions(side_camera_m=0.2))


def test_images_by_paths_of_another_machine_are_found_beside_the_log(tmp_path: Path) -> None:
    folder = write_udacity(tmp_path / "log", 30)
    text = (folder / "driving_log.csv").read_text()
    (folder / "driving_log.csv").write_text(text.replace("IMG/", r"C:\Users\me\Desktop\IMG/"))
    log, _ = read(folder)
    assert PictureReader(log.root).read(log.image[3], -1).shape == (48, 64, 3)


def table(folder: Path, **columns: object) -> Path:
    steering = steering_of(20)
    names = [f"{n}.jpg" for n in range(20)]
    write_pictures(folder, names, steering)
    return write_table(folder, {"image": names, "t_s": (0.1 * np.arange(20)).tolist(), **columns})


def test_a_table_names_the_columns_that_were_chosen(tmp_path: Path) -> None:
    log, _ = read(table(tmp_path, user_angle=steering_of(20).tolist(), speed_kmh=[36.0] * 20))
    assert log.notes == ["columns: image = image, time = t_s, lock = user_angle, speed = speed_kmh"]
    assert log.speed_mps == pytest.approx(10.0)


def test_a_column_of_a_table_can_be_named(tmp_path: Path) -> None:
    path = table(tmp_path, hand=[90.0] * 20)
    log, _ = read(path, TableOptions({"steering_wheel_angle_deg": "hand"}))
    assert log.unit == SteeringUnit.WHEEL and log.left_positive
    assert log.steering == pytest.approx(math.pi / 2)


def test_a_named_column_counts_before_those_that_are_found(tmp_path: Path) -> None:
    steering = {"steering_wheel_angle_deg": [90.0] * 20, "cmd": [0.5] * 20}
    log, _ = read(table(tmp_path, **steering), TableOptions({"steering": "cmd"}))
    assert log.unit == SteeringUnit.LOCK and log.steering == pytest.approx(0.5)
    log, _ = read(table(tmp_path, **steering))
    assert log.unit == SteeringUnit.WHEEL


def test_a_column_that_is_named_for_the_image_is_no_number_of_a_frame(tmp_path: Path) -> None:
    names = [f"{n}.jpg" for n in range(3)]
    columns = {"t_s": [0.0, 0.1, 0.2], "frame": names, "road_wheel_angle_rad": [0.1] * 3}
    log, faults = read(write_table(tmp_path, columns), TableOptions({"image": "frame"}))
    assert log.image == names and faults.count == 0


@pytest.mark.parametrize("second", ["steer", "road_wheel_angle_rad"])
def test_two_columns_for_one_quantity_are_refused(tmp_path: Path, second: str) -> None:
    with pytest.raises(InputError, match="two columns for one quantity"):
        read(table(tmp_path, a=[0.1] * 20, b=[0.1] * 20), TableOptions({"steering": "a", second: "b"}))


@pytest.mark.parametrize(
    ("columns", "renamed", "said"),
    [
        ({"angle": [90.0] * 20}, {}, "exceeds ±1"),
        ({"torque": [0.0] * 20}, {}, "no column for the steering"),
        ({"angle": [0.0] * 20}, {"stearing": "angle"}, "did you mean 'steering'"),
        ({"angle": [0.0] * 20}, {"speed_mps": "v"}, "no column 'v'"),
    ],
)
def test_a_table_that_leaves_a_doubt_is_refused(
    tmp_path: Path, columns: dict[str, object], renamed: dict[str, str], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        read(table(tmp_path, **columns), TableOptions(renamed))


def test_rows_of_a_table_that_cannot_be_read_are_named_by_their_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = table(tmp_path, steering=["x", *[0.1] * 19])
    path.write_text(path.read_text() + "20.jpg\n")
    log, faults = read(path)
    assert (len(log), log.unread, faults.count) == (19, 2, 2)
    err = capsys.readouterr().err
    assert "log.csv:2: expected a number, got 'x'" in err
    assert "log.csv:22: expected 3 columns, got 1" in err


def test_rows_can_describe_the_frames_of_a_video(tmp_path: Path) -> None:
    video = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(video), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    for number in range(20):
        writer.write(picture(float(steering_of(20)[number]), number))
    writer.release()
    path = write_table(tmp_path, {"frame": [0, 5, 10], "t_s": [0.0, 0.5, 1.0], "steering": [0.0, 0.1, 0.2]})
    log, _ = read(path, TableOptions(video=video))
    pictures = PictureReader(log.root)
    for number in (10, 0, 5):  # forwards and back
        read_back = pictures.read("drive.avi", number)
        assert np.abs(read_back.astype(int) - picture(float(steering_of(20)[number]), number)).mean() < 12
    with pytest.raises(InputError, match="has no frame 30: 20 can be read"):
        pictures.read("drive.avi", 30)


def test_a_row_that_cannot_be_read_keeps_its_frame_of_the_video_and_its_time(tmp_path: Path) -> None:
    (tmp_path / "drive.avi").touch()
    path = write_table(tmp_path, {"steering": [0.0, 0.1, "abc", 0.3], "speed_mps": [1.0] * 4})
    path.write_text(path.read_text().replace("0.1,", "\n0.1,", 1))  # a blank line is no row
    log, faults = read(path, TableOptions(fps=10.0, video=tmp_path / "drive.avi"))
    assert faults.count == 1 and log.steering.tolist() == [0.0, 0.1, 0.3]
    assert log.item.tolist() == [0, 1, 3]
    assert log.t_s == pytest.approx([0.0, 0.1, 0.3])


def test_a_record_that_cannot_be_read_keeps_its_time_in_a_tub_without_times(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 5)
    catalog = tub / "catalog_0.catalog"
    records = [json.loads(line) for line in catalog.read_text().splitlines()]
    records = [{**record, "_timestamp_ms": None} for record in records]
    records[2]["user/angle"] = "left"
    catalog.write_text("\n".join(map(json.dumps, records)))
    assert read(tub)[0].t_s == pytest.approx([0.0, 0.05, 0.15, 0.2])


def test_dates_are_times_of_a_table(tmp_path: Path) -> None:
    times = [f"2026-05-01T12:00:{n / 20:06.3f}Z" for n in range(20)]
    columns = {"timestamp_s": times, "image": ["0.jpg"] * 20, "road_wheel_angle_rad": steering_of(20)}
    log, faults = read(write_table(tmp_path, columns))
    assert np.diff(log.t_s) == pytest.approx(0.05, abs=1e-6) and faults.count == 0


def test_two_columns_of_the_name_that_is_used_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text("t_s,image,angle,angle\n0,0.jpg,0.1,0\n1,1.jpg,0.2,0\n")
    with pytest.raises(InputError, match=r"log\.csv:1: 2 columns 'angle': which one holds the values"):
        read(path)


def record_bend(path: Path, frames: int = 40, *, angle_rad: float = 0.1, speed_mps: float = 8.0) -> Path:
    """A recording at 10 images/s with the vehicle state at 50 Hz, whose angle rises until 1 s."""
    with Recording(path) as file:
        file.began(100.0)
        for tick in range(5 * frames):
            t_s = 100.0 + tick / 50.0
            state = VehicleState(
                t_s=t_s,
                speed_mps=speed_mps,
                road_wheel_angle_rad=angle_rad * min(1.0, t_s - 100.0),
                yaw_rate_radps=None,
                driver_override=False,
            )
            file.add(VEHICLE_STATE.key, to_cdr(state), at_s=t_s)
            if tick % 5 == 0:
                image = cv2.imencode(".jpg", picture(0.0, tick))[1].tobytes()
                frame = CompressedFrame(t_s=t_s + 0.01, jpeg=image)
                file.add(CAMERA_COMPRESSED.key, to_cdr(frame), at_s=t_s + 0.01)
    return path


@pytest.fixture
def no_car() -> Iterator[None]:
    use_car(None)
    yield
    use_car(None)


def test_the_angle_of_a_recording_is_that_at_the_capture_time(tmp_path: Path) -> None:
    log, _ = read(record_bend(tmp_path / "drive.mcap"))
    assert log.steering[5] == pytest.approx(0.1 * 0.51)
    assert log.unit == SteeringUnit.ROAD and log.left_positive
    assert (
        np.abs(PictureReader(log.root, log.topic).read("drive.mcap", 3).astype(int) - picture(0.0, 15)).mean()
        < 12
    )


def test_the_label_of_a_recording_is_free_of_understeer(tmp_path: Path, no_car: None) -> None:
    log, _ = read(record_bend(tmp_path / "drive.mcap"))
    wheel = wheel_of([log], WheelOptions())
    label = road_wheel_rad(log, wheel)[20]
    assert wheel.k_us > 0 and wheel.wheelbase_m is not None
    curvature_1pm = math.tan(label) / wheel.wheelbase_m
    assert label + wheel.k_us * curvature_1pm * 8.0**2 == pytest.approx(0.1)
    assert label < 0.1


def test_a_corrupted_chunk_of_a_recording_costs_its_images_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = record_bend(tmp_path / "drive.mcap", 100)
    whole, _ = read(path)
    good = PictureReader(whole.root, whole.topic).read(path.name, len(whole) - 1)
    damage_chunk(path, 2)
    log, faults = read(path)
    lost = len(whole) - len(log)
    assert 0 < lost < 50 and log.t_s[-1] == whole.t_s[-1]
    assert (faults.count, faults.rows) == (1, lost)
    assert f" messages in them lost, {lost} images among them" in capsys.readouterr().err
    assert (PictureReader(log.root, log.topic).read(path.name, len(log) - 1) == good).all()
    assert f"1 corrupted parts are left out, with {lost} images" in log.notes
    with pytest.raises(InputError, match=r"drive\.mcap: the \d+ bytes from byte \d+ on are corrupted"):
        read_log(path, Faults(strict=True), TableOptions())


def test_a_recording_cut_short_by_a_crash_is_read_to_its_end_without_a_fault(tmp_path: Path) -> None:
    path = record_bend(tmp_path / "drive.mcap", 100)
    whole, _ = read(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    log, faults = read(path)
    assert 0 < len(log) < len(whole) and faults.count == 0
    assert "cut short; read up to its last whole chunk" in log.notes


def test_a_recording_without_images_or_states_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "drive.mcap"
    with Recording(path) as file:
        file.began(100.0)
    with pytest.raises(InputError, match="no topic with images"):
        read(path)
    path = tmp_path / "other.mcap"
    path.write_bytes(b"nothing")
    with pytest.raises(InputError, match="not a recording"):
        read(path)


def segment(folder: Path, frames: int = 40) -> Path:
    """A segment of comma2k19 at 20 Hz whose steering wheel stands at 16.88°, with images instead of the video."""
    t_s = 0.05 * np.arange(frames)
    for name, values in {
        "global_pose/frame_times": t_s,
        "processed_log/CAN/speed/t": t_s,
        "processed_log/CAN/speed/value": np.full((frames, 1), 19.0),
        "processed_log/CAN/steering_angle/t": t_s,
        "processed_log/CAN/steering_angle/value": np.full(frames, 16.88),
    }.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        with path.open("wb") as file:
            np.save(file, values)
    write_pictures(folder / "frames", [f"{n}.jpg" for n in range(frames)], steering_of(frames))
    return folder


def test_segments_of_comma2k19_are_one_route(tmp_path: Path) -> None:
    for number in (2, 10):
        segment(tmp_path / "route" / str(number))
    log, _ = read(tmp_path / "route")
    assert set(log.route) == {"route"} and len(log) == 80
    assert log.image[40] == "10/frames/0.jpg"
    label = road_wheel_rad(log, wheel_of([log], WheelOptions(ratio=16.88)))
    assert np.degrees(label) == pytest.approx(1.0)


def test_a_segment_without_images_is_refused_with_one_line(tmp_path: Path) -> None:
    segment(tmp_path / "4")
    for image in (tmp_path / "4" / "frames").iterdir():
        image.unlink()
    with pytest.raises(InputError, match=r"no video\.hevc and no folder frames"):
        read(tmp_path / "4")


def test_the_ratio_of_the_steering_wheel_must_be_known(tmp_path: Path, no_car: None) -> None:
    log, _ = read(segment(tmp_path / "4"))
    with pytest.raises(InputError, match="--steering-ratio or --car"):
        wheel_of([log], WheelOptions())


def test_an_unknown_lock_angle_is_fitted_to_yaw_rate_and_speed(tmp_path: Path, no_car: None) -> None:
    frames, lock_rad, wheelbase_m = 400, math.radians(18.0), 0.26
    steering = steering_of(frames)
    random = np.random.default_rng(1)
    yaw = 1.5 / wheelbase_m * np.tan(-lock_rad * steering) + random.normal(0.0, 0.02, frames)
    columns = {
        "image": ["0.jpg"] * frames,
        "t_s": (0.05 * np.arange(frames)).tolist(),
        "steering": steering.tolist(),
        "speed_mps": [1.5] * frames,
        "yaw_rate_radps": (yaw + 0.01).tolist(),
    }
    log, _ = read(write_table(tmp_path, columns))
    wheel = wheel_of([log], WheelOptions(wheelbase_m=wheelbase_m))
    assert wheel.lock_rad == pytest.approx(lock_rad, rel=0.02)
    assert wheel.how.startswith("fitted: to yaw rate and speed of 400 rows")
    assert wheel_of([log], WheelOptions()).how.startswith("assumed 25°")
    assert wheel_of([log], WheelOptions(lock_deg=30.0)).lock_rad == pytest.approx(math.radians(30.0))


@pytest.mark.parametrize("text", ["", "nan", "inf"])
def test_a_row_without_time_is_left_out(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str
) -> None:
    path = table(tmp_path, steering=[0.1] * 20)
    lines = path.read_text().splitlines()
    at = lines[0].split(",").index("t_s")
    cells = lines[4].split(",")
    cells[at] = text
    path.write_text("\n".join([*lines[:4], ",".join(cells), *lines[5:]]))
    log, faults = read(path)
    assert (len(log), faults.count) == (19, 1) and np.isfinite(log.t_s).all()
    assert "log.csv:5: " in capsys.readouterr().err


def test_a_record_without_time_among_others_is_left_out_and_a_tub_without_any_has_20_hz(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = write_tub(tmp_path / "tub", 20)
    catalog = tub / "catalog_0.catalog"
    lines = [json.loads(line) for line in catalog.read_text().splitlines()]
    del lines[4]["_timestamp_ms"]
    catalog.write_text("\n".join(map(json.dumps, lines)))
    log, _ = read(tub)
    assert len(log) == 19 and not log.notes
    assert "catalog_0.catalog:5: no time" in capsys.readouterr().err
    catalog.write_text("\n".join(json.dumps({**line, "_timestamp_ms": None}) for line in lines))
    log, _ = read(tub)
    assert np.diff(log.t_s) == pytest.approx(0.05) and "20 Hz assumed" in log.notes[0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"deleted_indexes": ["x"]}, "manifest.json:5: deleted_indexes: expected numbers"),
        ({"deleted_indexes": 5}, "manifest.json:5: deleted_indexes: expected numbers"),
        ({"paths": [5]}, "manifest.json:5: no names of catalogs"),
    ],
)
def test_a_wrong_value_in_a_manifest_is_named_with_its_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict, said: str
) -> None:
    tub = write_tub(tmp_path / "tub", 5)
    lines = (tub / "manifest.json").read_text().splitlines()
    lines[4] = json.dumps(json.loads(lines[4]) | change)
    (tub / "manifest.json").write_text("\n".join(lines))
    log, faults = read(tub)
    assert (len(log), faults.count) == (5, 1)
    assert said in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("processed_log/CAN/speed/value", np.ones(39)),
        ("processed_log/CAN/speed/value", np.array(["fast"] * 40)),
        ("processed_log/CAN/steering_angle/t", np.ones((40, 2))),
        ("global_pose/frame_times", np.full(40, np.nan)),
    ],
)
def test_a_segment_of_other_shapes_is_refused(tmp_path: Path, name: str, values: np.ndarray) -> None:
    with (segment(tmp_path / "4") / name).open("wb") as file:
        np.save(file, values)
    with pytest.raises(InputError, match=name.rsplit("/", 1)[0].rsplit("/", maxsplit=1)[-1]):
        read(tmp_path / "4")


def test_the_side_of_positive_steering_is_that_of_the_car_unless_given(tmp_path: Path, no_car: None) -> None:
    car = tmp_path / "mycar"
    car.mkdir()
    (car / "vehicle.yaml").write_text("logged_positive: left\n")
    log, _ = read(write_tub(tmp_path / "tub", 20))
    assert wheel_of([log], WheelOptions()).sign == -1
    use_car(car)
    assert wheel_of([log], WheelOptions()).sign == 1
    assert wheel_of([log], WheelOptions(left_positive=False)).sign == -1


@pytest.mark.parametrize("version", [1, 2])
def test_a_tub_whose_steering_has_another_name_names_it_and_is_read_by_it(
    tmp_path: Path, version: int
) -> None:
    write = {1: write_tub_1, 2: write_tub}[version]
    usual = read_log(write(tmp_path / "usual", 30), Faults(strict=True), TableOptions())
    tub = write(tmp_path / "tub", 30)
    for file in (*tub.glob("*.catalog"), *tub.glob("record_*.json"), *tub.glob("manifest.json")):
        file.write_text(file.read_text().replace("user/angle", "user/steering"))
    with pytest.raises(
        InputError, match=r"no record has the field user/angle; `--column user/angle=user/steering`"
    ):
        read_log(tub, Faults(strict=True), TableOptions())
    found = read_log(tub, Faults(strict=True), TableOptions({"user/angle": "user/steering"}))
    assert np.array_equal(found.steering, usual.steering)
