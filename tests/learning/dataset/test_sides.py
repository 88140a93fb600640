"""Left and right cameras: labels that lead back, one split for the frames of a moment, and no score."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
from drive_rig import made_dataset, run, write_pictures, write_table, write_tub, write_udacity
from driving_network_rig import write_network
from hypothesis import given
from hypothesis import strategies as st

from learning.dataset.dataset import Dataset, Rows, middle_rows, sha256_of
from learning.dataset.join import join_datasets
from learning.dataset.sides import BEYOND, NO_IMAGE, NOT_JUDGED, WITH_MIDDLE, returning_rad
from perception.lane.settings import steering_settings

SIDE_M, WHEELBASE_M, LOCK_DEG = 0.4, 2.6, 25.0
FRAMES = 300  # 15 s
OPTIONS = ("--side-camera-m", f"{SIDE_M}", "--wheelbase-m", f"{WHEELBASE_M}")


@pytest.fixture(scope="module")
def sides(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("sides")
    return made_dataset(folder / "set", write_udacity(folder / "log", FRAMES, sides=True), options=OPTIONS)


def of_camera(rows: Rows, left_m: float) -> Rows:
    return rows[rows["camera_left_m"] == left_m]


@given(
    radius_m=st.floats(20.0, 500.0),
    side=st.sampled_from((-1.0, 1.0)),
    left_m=st.floats(-1.0, 1.0),
    ahead_m=st.floats(4.0, 15.0),
)
def test_the_arc_from_beside_meets_the_recorded_one_at_the_look_ahead(radius_m, side, left_m, ahead_m):
    label_rad = math.atan(side * WHEELBASE_M / radius_m)
    way = {"ahead_m": ahead_m, "wheelbase_m": WHEELBASE_M}
    back_1pm = math.tan(returning_rad(label_rad, left_m, 0.0, **way)) / WHEELBASE_M
    recorded_m = side * ahead_m**2 / (2 * radius_m)  # to the left, for small angles
    assert left_m + back_1pm * ahead_m**2 / 2 == pytest.approx(recorded_m, abs=1e-9)


def test_on_the_path_the_angle_is_the_recorded_one_and_the_mirrored_world_mirrors_it():
    way = {"ahead_m": 8.0, "wheelbase_m": WHEELBASE_M}
    assert returning_rad(0.1, 0.0, 0.0, **way) == pytest.approx(0.1)
    assert returning_rad(0.1, 0.5, 0.02, **way) == pytest.approx(-returning_rad(-0.1, -0.5, -0.02, **way))
    assert returning_rad(0.0, 0.5, 0.0, **way) < 0 < returning_rad(0.0, 0.0, -0.02, **way)
    assert math.isnan(returning_rad(math.nan, 0.5, 0.0, **way))


def test_a_car_that_steers_by_these_angles_comes_back_to_a_straight_path():
    x_m, left_m, turned_rad, step_m = 0.0, 0.8, 0.0, 0.05
    while x_m < 40.0:
        angle_rad = returning_rad(0.0, left_m, turned_rad, ahead_m=8.0, wheelbase_m=WHEELBASE_M)
        turned_rad += step_m * math.tan(angle_rad) / WHEELBASE_M
        x_m, left_m = x_m + step_m * math.cos(turned_rad), left_m + step_m * math.sin(turned_rad)
    assert abs(left_m) < 0.02 and abs(turned_rad) < 0.01


def test_every_row_says_of_which_camera_it_is_and_side_rows_steer_to_the_middle(sides: Dataset):
    rows = sides.rows()
    assert sorted(set(rows["camera_left_m"])) == [-SIDE_M, 0.0, SIDE_M] and len(rows) == 3 * FRAMES
    middle, left, right = (of_camera(rows, one) for one in (0.0, SIDE_M, -SIDE_M))
    assert (left["t_s"] == middle["t_s"]).all() and (right["t_s"] == middle["t_s"]).all()
    assert "left_" in left["image"][0] and "right_" in right["image"][0]
    curvature = {
        name: np.tan(some["road_wheel_rad"]) / WHEELBASE_M
        for name, some in {"middle": middle, "left": left, "right": right}.items()
    }
    change = 2 * SIDE_M / steering_settings().lookahead_m ** 2
    assert curvature["left"] == pytest.approx(curvature["middle"] - change)
    assert curvature["right"] == pytest.approx(curvature["middle"] + change)


def test_the_frames_of_a_moment_train_together_and_no_side_camera_is_judged(sides: Dataset):
    rows = sides.rows()
    middle = of_camera(rows, 0.0)
    for left_m in (SIDE_M, -SIDE_M):
        side = of_camera(rows, left_m)
        assert ((side["split"] == "train") == (middle["split"] == "train")).all()
        judged = np.isin(middle["split"], ("validation", "test"))
        assert (side["why"][judged] == NOT_JUDGED).all()
        assert (side["why"][middle["split"] == "none"] == WITH_MIDDLE).all()


def test_the_splits_of_the_middle_camera_are_those_without_side_cameras(sides: Dataset, tmp_path: Path):
    log = sides.file.sources[0].path.parent
    alone = made_dataset(tmp_path / "alone", log, options=OPTIONS[2:])
    middle = middle_rows(sides.rows())
    for name in ("t_s", "split", "why", "road_wheel_rad", "light", "change"):
        assert np.array_equal(alone.rows()[name], middle[name], equal_nan=name not in ("split", "why"))


def test_evaluate_and_the_baselines_see_recorded_labels_alone(sides: Dataset, tmp_path: Path, capsys):
    network = write_network(tmp_path / "turn.onnx", gain_rad=3.0)
    for split in ("train", "test"):
        assert run("evaluate", str(network), "--data", str(sides.folder), "--split", split, "--json") == 0
        row = json.loads(capsys.readouterr().out)
        judged = middle_rows(sides.rows(split))
        assert row["frames"] == len(judged)
        straight = row["baselines"]["always_straight"]["mae_deg"]
        assert straight == pytest.approx(np.degrees(np.abs(judged["road_wheel_rad"])).mean())


def test_a_missing_image_of_a_side_and_a_way_back_beyond_lock_are_left_out_with_their_reason(tmp_path: Path):
    log = write_udacity(tmp_path / "log", FRAMES, sides=True)
    lines = (log / "driving_log.csv").read_text().splitlines()
    center, _, right, *rest = lines[20].split(",")
    lines[20] = ",".join([center, "", right, *rest])
    (log / "driving_log.csv").write_text("\n".join(lines))
    made = made_dataset(tmp_path / "set", log, options=(*OPTIONS, "--lock-deg", "3"))
    rows = made.rows()
    assert of_camera(rows, SIDE_M)["why"][20] == NO_IMAGE
    beyond = rows[rows["why"] == BEYOND]
    assert len(beyond) and (beyond["camera_left_m"] != 0).all() and np.isnan(beyond["road_wheel_rad"]).all()
    assert np.abs(made.rows("train")["road_wheel_rad"]).max() <= math.radians(3.0)


def test_a_table_with_columns_of_side_images_is_read_too(tmp_path: Path):
    names = {side: [f"{side}{n}.jpg" for n in range(90)] for side in ("image", "left", "right")}
    for side in names.values():
        write_pictures(tmp_path / "log", side, np.zeros(90))
    columns = {"t_s": (0.05 * np.arange(90)).tolist(), "road_wheel_angle_rad": [0.01] * 90}
    path = write_table(tmp_path / "log", {**names, **columns})
    made = made_dataset(tmp_path / "set", path, options=(*OPTIONS, "--gap-s", "0.1"))
    assert len(of_camera(made.rows(), SIDE_M)) == len(of_camera(made.rows(), -SIDE_M)) == 90


@pytest.mark.parametrize(
    ("options", "fault"),
    [
        (("--side-camera-m", "0.4"), "needs the wheelbase: give --wheelbase-m or --car"),
        (("--column", "left=left", "--fps", "20"), "--column left: needs --side-camera-m"),
    ],
)
def test_what_side_cameras_need_is_said_in_one_line(tmp_path: Path, capsys, options, fault):
    log = write_udacity(tmp_path / "log", 30, header=True, sides=True)
    assert run("dataset", "build", str(tmp_path / "set"), str(log), *options) == 2
    err = capsys.readouterr().err
    assert fault in err and err.count("\n") == 1


def test_without_images_of_side_cameras_their_distance_is_refused(tmp_path: Path, capsys):
    assert run("dataset", "build", str(tmp_path / "set"), str(write_tub(tmp_path / "tub", 60)), *OPTIONS) == 2
    assert "no table names images of a left or a right camera" in capsys.readouterr().err


def test_side_cameras_that_are_not_used_are_said(tmp_path: Path, capsys):
    made_dataset(tmp_path / "set", write_udacity(tmp_path / "log", 60, sides=True))
    assert "those of left and right need --side-camera-m" in capsys.readouterr().out


def test_the_card_describes_the_recorded_drive(sides: Dataset, capsys):
    run("dataset", "show", str(sides.folder), "--json")
    card = json.loads(capsys.readouterr().out)
    assert card["side_frames"] == 2 * card["splits"]["train"] // 3
    assert card["duration_s"] == pytest.approx((FRAMES - 1) * 0.05, abs=0.1) and len(card["routes"]) == 1


def test_side_cameras_of_an_added_data_set_are_for_training_alone(sides: Dataset, tmp_path: Path):
    base = made_dataset(tmp_path / "base", write_tub(tmp_path / "tub", 300), options=("--lock-deg", "25"))
    both = join_datasets(tmp_path / "both", base, [sides], "")
    sides = both.rows()[both.rows()["camera_left_m"] != 0.0]
    assert len(sides) and set(sides["split"]) <= {"train", "none"}


def test_the_hash_knows_the_cameras_and_is_that_of_before_without_any(sides: Dataset):
    rows = sides.rows().copy()
    rows["camera_left_m"][-1] += 0.1
    assert sha256_of(rows) != sides.sha256
