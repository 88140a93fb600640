"""`trepid train` from a recorded tub to a network that drives."""

import json
import math
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import made_dataset, run, steering_of, write_tub  # noqa: E402

from learning.dataset.dataset import Dataset  # noqa: E402
from learning.models.catalogue import MODELS  # noqa: E402
from perception.net.driver import DriverNetwork, NetworkOutput  # noqa: E402
from trepid.types import Image  # noqa: E402

pytestmark = pytest.mark.long
SMALL = ("--set", "height_px=24", "--set", "width_px=32", "--set", "batch=32")


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drive")
    tub = write_tub(folder / "tub", 360)
    (folder / "MANIFEST.md").write_text("# a tub\nlicence: of the tests\n")
    return made_dataset(folder / "set", tub)


def train_network(data: Dataset, out: Path, model: str, *words: str) -> int:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the ONNX export in torch
        return run("train", "--data", str(data.folder), "--model", model, "--out", str(out), *SMALL, *words)


@pytest.fixture(scope="module")
def weights(data: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("weights") / "own.onnx"
    quick = (
        "stages=[{name: all, part: all, epochs: 16, learning_rate: 3.0e-3, schedule: cosine, patience: 16}]"
    )
    assert train_network(data, out, "steer", "--set", quick, "--set", "average=0.9") == 0
    return out


def steer(weights: Path, image: Image) -> NetworkOutput:
    network = DriverNetwork(weights)
    return network(image, network.initial_state)


def metadata(weights: Path) -> dict[str, object]:
    import onnx

    return json.loads(next(prop.value for prop in onnx.load(weights).metadata_props if prop.key == "trepid"))


def held_back(data: Dataset, count: int = 20) -> list[tuple[Image, float]]:
    rows = data.rows("test")[:: max(1, len(data.rows("test")) // count)]
    return [(data.image(row), float(row["road_wheel_rad"])) for row in rows]


def test_the_network_steers_frames_it_has_not_seen_better_than_straight(data, weights):
    pairs = held_back(data)
    errors = [abs(steer(weights, image).road_wheel_rad - label) for image, label in pairs]
    assert np.mean(errors) < 0.6 * np.mean([abs(label) for _, label in pairs])


def test_a_mirrored_frame_is_steered_to_the_other_side(data, weights):
    for image, label in held_back(data, 8):
        if abs(label) > math.radians(5):
            mirrored = np.ascontiguousarray(image[:, ::-1])
            assert steer(weights, mirrored).road_wheel_rad * steer(weights, image).road_wheel_rad < 0


@pytest.mark.parametrize("change", ["darker", "brighter", "bluer", "blurred", "noisy"])
def test_a_realistic_change_of_the_image_moves_the_angle_by_less_than_2_degrees(data, weights, change):
    changes = {
        "darker": lambda image: cv2.convertScaleAbs(image, alpha=0.75),
        "brighter": lambda image: cv2.convertScaleAbs(image, alpha=1.25),
        "bluer": lambda image: np.clip(image * np.array([1.1, 1.0, 0.9]), 0, 255).astype(np.uint8),
        "blurred": lambda image: cv2.GaussianBlur(image, (0, 0), 0.7),
        "noisy": lambda image: np.clip(
            image + np.random.default_rng(0).normal(0, 5, image.shape), 0, 255
        ).astype(np.uint8),
    }
    moved = [
        abs(steer(weights, changes[change](image)).road_wheel_rad - steer(weights, image).road_wheel_rad)
        for image, _ in held_back(data)
    ]
    assert math.degrees(float(np.mean(moved))) < 2.0


def test_an_image_of_noise_is_unlike_the_frames_of_training(data, weights):
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    assert steer(weights, noise).unlike > 1.0
    assert np.median([steer(weights, image).unlike for image, _ in held_back(data)]) < 1.5


def test_the_weights_state_what_they_are_and_what_they_learned_from(data, weights):
    found = metadata(weights)
    assert found["kind"] == "steering" and found["model"] == "steer"
    assert (found["height"], found["width"]) == (24, 32)
    assert found["data_sha256"] == data.sha256 and found["lock_rad"] == data.wheel.lock_rad
    assert found["trained_on"] == sorted(set(data.rows("train")["route"].tolist()))
    assert found["interval_90"] > 0 and found["scores"]["mae_deg"] > 0
    card = weights.with_suffix(".md").read_text()
    assert "trepid train" in card and data.sha256 in card and "## Limits" in card
    curve = (weights.parent / "own.onnx.train" / "curve.jsonl").read_text().splitlines()
    assert len(curve) == 16 and json.loads(curve[-1])["validation_mae_rad"] > 0
    assert (weights.parent / "own.onnx.train" / "curve.png").read_bytes()[:4] == b"\x89PNG"


def test_ninety_percent_of_the_validation_frames_lie_in_the_interval(data, weights):
    factor = metadata(weights)["interval_90"]
    inside = []
    for row in data.rows("validation"):
        found = steer(weights, data.image(row))
        inside.append(abs(found.road_wheel_rad - row["road_wheel_rad"]) <= factor * found.scale_rad * 1.001)
    assert np.mean(inside) >= 0.9


ONE_EPOCH = (
    "stages=[{name: all, part: all, epochs: 1, learning_rate: 1.0e-3, schedule: constant, patience: 1}]"
)


@pytest.mark.parametrize(
    "model, more",
    [
        ("cnn-lstm", "window=3"),
        ("jain", "height_px=8"),
        ("rausch", "head=gaussian"),
        ("steer-motion", "head=regression"),
        ("steer-lstm", "window=3"),
    ],
)
def test_other_networks_are_exported_as_torch_computes_them(data, tmp_path, model, more):
    sizes = ("--set", "width_px=16") if model == "jain" else ()
    assert train_network(data, tmp_path / "f.onnx", model, "--set", ONE_EPOCH, *sizes, "--set", more) == 0
    network = DriverNetwork(tmp_path / "f.onnx")  # refuses outputs that are not finite
    assert (network.initial_state is not None) == MODELS[model].recurrent


def test_two_stages_an_auto_encoder_and_matched_histograms_train(data, tmp_path):
    stages = (
        "stages=[{name: top, part: top, epochs: 1, learning_rate: 1.0e-3, schedule: constant, patience: 1},"
        " {name: fine, part: all, epochs: 1, learning_rate: 1.0e-4, schedule: cosine, patience: 1}]"
    )
    more = ("--set", "pretrain_epochs=1", "--set", "histogram=match", "--set", "balance=0.5")
    assert train_network(data, tmp_path / "f.onnx", "steer", "--set", stages, *more) == 0
    curve = (tmp_path / "f.onnx.train" / "curve.jsonl").read_text().splitlines()
    assert [json.loads(line)["stage"] for line in curve] == [0, 1]
    dark, bright = (np.full((48, 64, 3), grey, np.uint8) for grey in (40, 80))
    assert steer(tmp_path / "f.onnx", dark).road_wheel_rad == pytest.approx(
        steer(tmp_path / "f.onnx", bright).road_wheel_rad, abs=1e-5
    )


def test_a_loss_that_is_not_finite_ends_the_training_with_a_line(data, tmp_path, capfd):
    wild = ONE_EPOCH.replace("1.0e-3", "1.0e+30")
    assert train_network(data, tmp_path / "f.onnx", "rausch", "--set", wild, "--set", "optimiser=sgd") == 2
    assert "lower the learning rate of the stage 'all'" in capfd.readouterr().err
    assert not (tmp_path / "f.onnx").exists()


@pytest.mark.parametrize(
    "words, said",
    [
        (("--model", "steeer"), "did you mean 'steer'"),
        (("--model", "steer"), "needs --data DIR"),
        (("--model", "steer", "--data", "nowhere", "--out", "f.onnx"), "nowhere: no data set"),
        (("--model", "steer", "--data", "nowhere", "--out", "f.pt"), "ends with .onnx"),
        (("--model", "steer", "--data", "d", "--out", "f.onnx", "--set", "epoch=1"), "unknown field 'epoch'"),
    ],
)
def test_wrong_words_are_answered_with_a_line_and_exit_code_2(words, said, tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    assert run("train", *words) == 2
    lines = capfd.readouterr().err.splitlines()
    assert len(lines) == 1 and said in lines[0]


def test_the_list_names_every_network_with_its_weights(capfd):
    assert run("train", "--model", "list", "--json") == 0
    listed = {row["model"]: row for row in json.loads(capfd.readouterr().out)}
    assert listed.keys() == MODELS.keys() and listed["pilotnet"]["parameters"] == 252_219


def test_a_narrow_terminal_shows_every_figure_of_the_list_in_whole(monkeypatch, capfd):
    monkeypatch.setenv("COLUMNS", "80")
    assert run("train", "--model", "list") == 0
    printed = capfd.readouterr().out.split()
    for name, one in MODELS.items():
        assert {name, one.head, f"{one.parameters:,}"} <= set(printed)


def test_an_unfinished_training_is_continued_or_kept(data, tmp_path, monkeypatch, capfd):
    out = tmp_path / "f.onnx"

    def kill(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("learning.training.loop._status", kill)  # after the first epoch
        assert train_network(data, out, "steer", "--set", ONE_EPOCH) == 130
    assert train_network(data, out, "steer", "--set", ONE_EPOCH) == 2
    assert "--resume continues it" in capfd.readouterr().err
    assert train_network(data, out, "steer", "--set", ONE_EPOCH, "--resume") == 0


def test_an_auto_encoder_continues_after_its_last_epoch(data, tmp_path, monkeypatch, capfd):
    out, more = tmp_path / "f.onnx", ("--set", ONE_EPOCH, "--set", "pretrain_epochs=2")

    def kill(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("learning.training.loop.Trainer.run", kill)
        assert train_network(data, out, "steer", *more) == 130
    capfd.readouterr()
    assert train_network(data, out, "steer", *more, "--resume") == 0
    assert "auto-encoder: epoch" not in capfd.readouterr().err


def test_a_network_with_a_speed_drives_as_the_driver_and_is_judged_by_it(tmp_path, capfd):
    """The speed follows the brightness, and the encoder is silent in the first third."""
    steering = steering_of(360)
    speeds_mps = np.where(np.arange(360) < 120, np.nan, 2.0 - 2.0 * np.abs(steering))
    made = made_dataset(tmp_path / "set", write_tub(tmp_path / "tub", 360, speeds_mps=speeds_mps))
    out, judge = tmp_path / "pace.onnx", ("evaluate", "--data", str(made.folder), "--json")
    stages = (
        "stages=[{name: all, part: all, epochs: 8, learning_rate: 3.0e-3, schedule: cosine, patience: 8}]"
    )
    assert (
        train_network(made, out, "steer", "--set", stages, "--set", "speed=true", "--set", "average=0") == 0
    )
    scores = metadata(out)["scores"]
    assert (
        metadata(out)["speed"] is True
        and scores["speed_rmse_mps"] < 0.8 * scores["speed_mean_speed_rmse_mps"]
    )
    capfd.readouterr()
    assert run(*judge, str(out)) == 0
    speed = json.loads(capfd.readouterr().out)["speed"]
    assert 0 < speed["rmse_mps"] < 0.8 * speed["mean_speed_rmse_mps"]
    assert steer(out, made.image(made.rows("test")[0])).speed_mps == pytest.approx(1.2, abs=0.9)


@pytest.mark.parametrize("verb", ["train", "quantise"])
def test_no_other_file_is_overwritten(verb, data, weights, tmp_path, capfd):
    if verb == "train":
        (tmp_path / "README.md").write_text("mine")
        assert train_network(data, tmp_path / "README.onnx", "steer", "--set", ONE_EPOCH) == 2
        assert "is no model card" in capfd.readouterr().err and (tmp_path / "README.md").read_text() == "mine"
    else:
        before = weights.read_bytes()
        assert run("quantise", str(weights), "--data", str(data.folder), "--out", str(weights)) == 2
        assert "is the network itself" in capfd.readouterr().err and weights.read_bytes() == before
