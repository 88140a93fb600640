"""``trepid evaluate`` on a small drive, whose bright line leans to the side of the steering."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from drive_rig import made_dataset, run, write_tub
from driving_network_rig import write_network

from learning.dataset.dataset import Dataset
from learning.judging.evaluate import Bench, light_names
from learning.judging.predictions import JudgedModel
from learning.judging.sheet import occlusion
from perception.net.driver import DriverNetwork

DESIGNED = [
    "model",
    "frames",
    "mae_deg",
    "rmse_deg",
    "mean_error_deg",
    "std_deg",
    "r2",
    "slope",
    "latency_ms",
    "baselines",
]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drive")
    return made_dataset(folder / "d", write_tub(folder / "tub"), options=("--lock-deg", "25"))


@pytest.fixture(scope="module")
def turn(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_network(tmp_path_factory.mktemp("net") / "turn.onnx", gain_rad=3.0)


def rows_of(capsys: pytest.CaptureFixture[str]) -> list[dict]:
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_the_json_has_the_designed_fields_beside_baselines_on_the_same_frames(data, turn, capsys):
    assert run("evaluate", str(turn), "--data", str(data.folder), "--json") == 0
    (row,) = rows_of(capsys)
    assert set(DESIGNED) <= set(row) and row["model"] == "turn"
    true = np.degrees(data.rows("test")["road_wheel_rad"])
    assert row["frames"] == len(true)
    assert row["baselines"]["always_straight"]["mae_deg"] == pytest.approx(np.abs(true).mean())
    mean = np.degrees(data.rows("train")["road_wheel_rad"].mean())
    assert row["baselines"]["mean"]["mae_deg"] == pytest.approx(np.abs(true - mean).mean())
    ago = np.degrees(data.rows()["road_wheel_rad"])  # one route at 20 Hz without pauses
    first = int(data.rows("test")["frame"][0])
    expected = np.abs(ago[first:] - ago[first - 4 : -4]).mean()
    assert row["baselines"]["previous_200ms"]["mae_deg"] == pytest.approx(expected)


def test_the_errors_are_those_of_the_network_on_the_images_of_the_split(data, turn, capsys):
    run("evaluate", str(turn), "--data", str(data.folder), "--split", "validation", "--json")
    (row,) = rows_of(capsys)
    rows, network = data.rows("validation"), DriverNetwork(turn)
    predicted = [network(image, None).road_wheel_rad for image in data.images(rows)]
    error = np.degrees(np.array(predicted) - rows["road_wheel_rad"])
    assert row["mae_deg"] == pytest.approx(np.abs(error).mean())
    assert row["rmse_deg"] == pytest.approx(math.sqrt(np.mean(error**2)))
    assert row["slope"] > 0.3
    rate = math.sqrt(np.mean((np.diff(error) / np.diff(rows["t_s"])) ** 2))
    assert row["rate_error_rms_degps"] == pytest.approx(rate)
    assert rate >= abs(row["rate_rms_degps"] - row["recorded_rate_rms_degps"])
    share = (np.abs(error) <= math.degrees(1.645 * 0.01)).mean()
    assert row["uncertainty"]["coverage_90"] == pytest.approx(share)


def test_a_steering_ratio_multiplies_all_degrees_and_moves_no_bin(data, turn, capsys):
    run("evaluate", str(turn), "--data", str(data.folder), "--json")
    (plain,) = rows_of(capsys)
    run("evaluate", str(turn), "--data", str(data.folder), "--ratio", "16", "--json")
    (wheel,) = rows_of(capsys)
    assert wheel["mae_deg"] == pytest.approx(16 * plain["mae_deg"])
    assert wheel["r2"] == pytest.approx(plain["r2"])
    assert [one["frames"] for one in wheel["bins"]] == [one["frames"] for one in plain["bins"]]
    assert wheel["uncertainty"]["within_tolerance"] == plain["uncertainty"]["within_tolerance"]


def test_many_models_make_one_table_with_the_baselines_below(data, turn, capsys):
    other = write_network(turn.parent / "other.onnx", memory=True)
    assert run("evaluate", str(turn), str(other), "--data", str(data.folder)) == 0
    names = [line.split()[0] for line in capsys.readouterr().out.splitlines() if line.strip()]
    assert names[:6] == ["model", "turn", "other", "always_straight", "mean", "previous_200ms"]
    assert {*names[6:]} == {"turn:", "other:"}, "a conclusion, and perhaps findings, of each model"


def test_a_network_that_leans_with_the_line_is_said_to_beat_a_constant_angle(data, turn, capsys):
    run("evaluate", str(turn), "--data", str(data.folder), "--json")
    (row,) = rows_of(capsys)
    assert row["mae_deg"] < row["baselines"]["always_straight"]["mae_deg"]
    assert "no_better_than_constant" not in {one["finding"] for one in row["findings"]}
    assert row["conclusion"].startswith("The images count")


def test_a_network_that_always_steers_straight_has_learned_nothing(data, turn, capsys):
    dull = write_network(turn.parent / "dull.onnx", gain_rad=0.0)
    assert run("evaluate", str(dull), "--data", str(data.folder)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-1].startswith("dull: Nothing was learned")
    assert any(line.startswith("dull: finding: straight ahead at all times") for line in lines)


def test_a_straight_drive_is_said_to_show_nothing_about_learning(turn, tmp_path, capsys):
    flat = made_dataset(
        tmp_path / "d", write_tub(tmp_path / "tub", 300, gain=0.001), options=("--lock-deg", "25")
    )
    capsys.readouterr()
    run("evaluate", str(turn), "--data", str(flat.folder), "--json")
    (row,) = rows_of(capsys)
    assert "no_variance" in {one["finding"] for one in row["findings"]}
    assert "cannot show whether anything was learned" in row["conclusion"]


def test_a_lane_estimator_is_scored_on_the_frames_that_it_answers(data, capsys):
    camera = Path("config/camera.yaml").resolve()
    command = ("evaluate", "cnn", "--data", str(data.folder), "--camera", str(camera), "--json")
    assert run(*command) == 0
    (row,) = rows_of(capsys)
    assert row["frames"] == round(row["answered"] * len(data.rows("test")))
    assert (row["mae_deg"] is None) == (row["frames"] == 0)


def test_a_recurrent_network_is_judged_with_its_memory(data, tmp_path):
    model = JudgedModel(str(write_network(tmp_path / "mem.onnx", memory=True, gain_rad=3.0)))
    rows = data.rows("test")
    angle_rad = model.predict(data, rows).angle_rad
    now = JudgedModel(str(write_network(tmp_path / "now.onnx", gain_rad=3.0))).predict(data, rows).angle_rad
    expected = [now[0] / 2]
    for value in now[1:]:
        expected.append((expected[-1] + value) / 2)
    assert angle_rad == pytest.approx(expected, abs=1e-5)


def test_the_worst_frames_are_apart_and_sorted_by_error(data, turn):
    bench, model = Bench(data, "test"), JudgedModel(str(turn))
    found = model.predict(data, bench.rows)
    worst = bench.worst(found)
    error = np.abs(np.degrees(found.angle_rad) - bench.true_deg)
    assert worst[0] == int(error.argmax()) and sorted(error[worst], reverse=True) == [*error[worst]]
    assert np.diff(np.sort(bench.rows["t_s"][worst])).min() >= 1.0


def test_the_picture_shows_the_course_above_the_worst_frames_with_their_occlusion(data, turn, tmp_path):
    sheet = tmp_path / "angles.png"
    run("evaluate", str(turn), "--data", str(data.folder), "--picture", str(sheet), "--json")
    drawn = cv2.imread(str(sheet))
    assert drawn.shape[1] == 1280 and drawn.shape[0] > 480 + 300
    assert (drawn[:5] == 255).all()  # paper, above the frames


def test_occlusion_finds_the_cells_that_move_the_angle(turn):
    image = np.full((96, 128, 3), 60, np.uint8)
    image[24:36, 16:32] = 255
    weights = occlusion(DriverNetwork(turn), image, grid=(8, 8))
    assert np.unravel_index(weights.argmax(), weights.shape) == (2, 1)
    assert weights[6, 6] < 0.1 * weights[2, 1]


def test_light_is_named_by_the_mean_grey():
    assert [*light_names(np.array([0.05, 0.3, 0.5, 0.9, np.nan]))] == [
        "dark",
        "dim",
        "day",
        "bright",
        "unknown",
    ]


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["nowhere.onnx"], "nowhere.onnx: no such file"),
        (["cvv"], "no estimator 'cvv'"),
        (["TURN", "--split", "tests"], "--split tests: expected train, validation, test"),
        (["TURN", "cv", "--picture", "a.png"], "shows one model"),
        (["TURN", "--picture", "no/a.png"], "there is no folder no"),
        (["TURN", "--data", "nothing"], "no data set"),
    ],
)
def test_bad_input_is_one_line_with_exit_code_2(data, turn, words, fault, capsys):
    given = [str(turn) if word == "TURN" else word for word in words]
    given += [] if "--data" in given else ["--data", str(data.folder)]
    assert run("evaluate", *given) == 2
    err = capsys.readouterr().err
    assert fault in err and err.count("\n") == 1
