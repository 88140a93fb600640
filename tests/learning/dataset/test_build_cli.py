"""``trepid dataset build``: what is left out, what is refused, and the line that says so."""

import json
import shutil
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_rig import made_dataset, run, steering_of, write_pictures, write_table, write_tub, write_udacity


def refusal(capsys: pytest.CaptureFixture[str], *words: str | Path) -> str:
    """The line on standard error of a call that ends with exit code 2."""
    assert run("dataset", "build", *map(str, words)) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len([line for line in lines if line.startswith("trepid:")]) == 1
    return lines[-1]


def test_a_truncated_image_is_named_and_left_out_with_exit_code_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    image = tub / "images" / "7_cam_image_array_.jpg"
    image.write_bytes(image.read_bytes()[:300])
    (tub / "images" / "9_cam_image_array_.jpg").unlink()
    made = made_dataset(tmp_path / "set", tub, code=1)
    assert made.rows()["why"][7] == made.rows()["why"][9] == "image cannot be read"
    err = capsys.readouterr().err
    assert "7_cam_image_array_.jpg: image file is truncated; left out" in err
    assert "9_cam_image_array_.jpg: cannot be read" in err


def test_strict_refuses_the_first_image_that_cannot_be_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    (tub / "images" / "9_cam_image_array_.jpg").unlink()
    assert "9_cam_image_array_.jpg" in refusal(capsys, tmp_path / "set", tub, "--strict")
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize("frames", [18, 120, 260])
def test_a_drive_too_short_for_a_split_is_a_data_set_without_one_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], frames: int
) -> None:
    """Whether it is shorter than the gaps themselves, or its share of a split is shorter than its gap."""
    made = made_dataset(tmp_path / "set", write_tub(tmp_path / "tub", frames))
    assert set(made.rows()["split"]) == {"train"}
    err = capsys.readouterr().err
    assert "too short for gaps of 2 s between splits (--gap-s), which need 13.3 s; all frames are in" in err
    assert "a longer drive, or a smaller --gap-s, leaves some" in err
    divided = made_dataset(tmp_path / "other", tmp_path / "tub", options=("--gap-s", "0.05"))
    assert {"train", "validation", "test"} <= set(divided.rows()["split"])


def test_time_that_runs_back_in_a_drive_is_named_and_counted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = write_tub(tmp_path / "tub")
    catalog = tub / "catalog_0.catalog"
    records = [json.loads(line) for line in catalog.read_text().splitlines()]
    for number, record in enumerate(records):
        record["_timestamp_ms"] -= 3000 * (number >= 250) + 5000 * (number >= 300)
    catalog.write_text("\n".join(map(json.dumps, records)))
    made_dataset(tmp_path / "set", tub, code=1)
    said = "catalog_0.catalog:251: time runs back, and 1 × more: a clock that was set, or rows in another"
    assert said in capsys.readouterr().err
    assert said in refusal(capsys, tmp_path / "strict", tub, "--strict")


def test_an_image_of_another_size_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    cv2.imwrite(str(tub / "images" / "5_cam_image_array_.jpg"), np.full((20, 30, 3), 90, np.uint8))
    made = made_dataset(tmp_path / "set", tub, code=1)
    assert made.rows()["split"][5] == "none"
    assert "30×20 pixels, the others 64×48" in capsys.readouterr().err


def test_a_source_that_does_not_exist_or_is_unknown_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "no such file or folder" in refusal(capsys, tmp_path / "set", tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    assert "no known log" in refusal(capsys, tmp_path / "set", tmp_path / "empty")


@pytest.mark.parametrize(
    "options", [("--shares", "1,1"), ("--shares", "a,b,c"), ("--split", "random"), ("--sign", "up")]
)
def test_a_wrong_option_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, str]
) -> None:
    assert options[0] in refusal(capsys, tmp_path / "set", write_tub(tmp_path / "tub", 20), *options)


def test_two_drives_of_one_name_are_two_routes(tmp_path: Path) -> None:
    made = made_dataset(
        tmp_path / "set", write_udacity(tmp_path / "a" / "log", 60), write_udacity(tmp_path / "b" / "log", 60)
    )
    assert Counter(made.rows()["route"].tolist()) == {"log#0": 60, "log#1": 60}


def test_drives_in_different_units_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_pictures(tmp_path / "t", ["0.jpg", "1.jpg"], steering_of(2))
    table = write_table(
        tmp_path / "t", {"image": ["0.jpg", "1.jpg"], "t_s": [0, 0.1], "road_wheel_angle_rad": [0, 0.1]}
    )
    line = refusal(capsys, tmp_path / "set", write_tub(tmp_path / "tub", 20), table)
    assert "different units" in line


def test_the_summary_as_json_states_splits_and_wheel(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made_dataset(tmp_path / "set", write_udacity(tmp_path / "log", 300), options=("--json",))
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == 300
    assert summary["splits"]["train"] > summary["splits"]["test"] > 0
    assert summary["wheel"]["how"].startswith("assumed 25°")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--fps", "20"), "--fps: no source is a table"),
        (("--column", "t_s=when"), "--column: no source is a table"),
        (("--test-route", "a"), "--test-route: needs --split route"),
        (("--steering-ratio", "16"), "--steering-ratio: the logs hold no angles of a steering wheel"),
        (("--leave-out", "dull"), "--leave-out dull: expected frozen or suspicious"),
        (("--video", "none.mp4"), "--video: no source is a table"),
    ],
)
def test_an_option_without_effect_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: tuple[str, str], said: str
) -> None:
    assert said in refusal(capsys, tmp_path / "set", write_tub(tmp_path / "tub", 20), *options)


def test_frames_are_left_out_by_rule(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 300)
    for number in range(61, 90):
        shutil.copyfile(tub / "images/60_cam_image_array_.jpg", tub / f"images/{number}_cam_image_array_.jpg")
    made = made_dataset(tmp_path / "set", tub, options=("--leave-out", "frozen", "--leave-out", "dark"))
    rows = made.rows()
    assert made.file.leave_out == ("frozen", "dark")
    assert np.flatnonzero(rows["why"] == "rule frozen").tolist() == [*range(61, 90)]
    assert not (rows["why"] == "rule dark").any() and set(rows["split"][61:90]) == {"none"}
