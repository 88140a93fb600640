"""The card of a data set: what its labels and images are, and which labels contradict the motion."""

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from drive_rig import made_dataset, run, steering_of, write_pictures, write_table, write_tub

from learning.dataset.card import card_of
from learning.dataset.dataset import Dataset, Rows
from learning.dataset.motion import delay_of, suspicious
from learning.training.labels import weights


@pytest.fixture(scope="module")
def made_set(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drives")
    return made_dataset(folder / "set", write_tub(folder / "tub", 400, pause_after=100))


@pytest.fixture(scope="module")
def card(made_set: Dataset) -> dict[str, Any]:
    return card_of(made_set)


def turning(made: Dataset, delay: int) -> Rows:
    """Rows whose car turns ``delay`` frames after the label, as a gyroscope measures it."""
    rows = made.rows().copy()
    rows["yaw_rate_radps"] = np.roll(rows["road_wheel_rad"], delay)
    rows["yaw_rate_radps"] += np.random.default_rng(0).normal(0.0, 0.002, len(rows))
    return rows


@pytest.mark.parametrize("delay", [-3, 0, 4])
def test_the_delay_of_the_motion_after_the_label_is_found(made_set: Dataset, delay: int) -> None:
    found = delay_of(turning(made_set, delay))
    assert found.by == "yaw rate" and found.correlation is not None and found.correlation > 0.9
    assert found.delay_s == pytest.approx(0.05 * delay, abs=0.02)


def test_the_delay_is_sought_within_the_rows_whatever_their_rate(made_set: Dataset) -> None:
    rows = turning(made_set, 2)
    rows["t_s"] = 50e-6 * np.arange(len(rows))
    rows["stretch"] = 0
    assert delay_of(rows).delay_s == pytest.approx(100e-6, abs=20e-6)


def test_the_card_names_a_rate_that_no_camera_has(tmp_path: Path) -> None:
    names = [f"{n}.jpg" for n in range(40)]
    write_pictures(tmp_path, names, steering_of(40))
    columns = {"image": names, "timestamp_ns": (50_000 * np.arange(40)).tolist(), "steering": [0.1] * 40}
    built = made_dataset(tmp_path / "set", write_table(tmp_path, columns), options=("--gap-s", "0"))
    found = card_of(built)["findings"]
    assert {"finding": "20000 frames a second", "remedy": "check the unit of the times"} in found


def test_reversed_labels_have_a_negative_correlation(made_set: Dataset) -> None:
    rows = turning(made_set, 2)
    rows["road_wheel_rad"] *= -1
    correlation = delay_of(rows).correlation
    assert correlation is not None and correlation < -0.9


def test_a_label_that_contradicts_the_motion_is_suspicious(made_set: Dataset) -> None:
    rows = turning(made_set, 2)
    at = int(np.argmax(rows["road_wheel_rad"]))
    assert not suspicious(rows)[at]
    rows["road_wheel_rad"][at] *= -1
    assert suspicious(rows)[at]


def test_labels_without_any_motion_are_not_judged(made_set: Dataset) -> None:
    rows = made_set.rows().copy()
    rows["shift"] = np.nan
    assert delay_of(rows).delay_s is None
    assert not suspicious(rows).any()


def test_the_card_counts_stretches_and_frames(card: dict[str, Any]) -> None:
    assert (card["frames"], card["stretches"], card["size"]) == (400, 2, [64, 48])
    assert card["rate_hz"] == pytest.approx(20.0, abs=0.1)
    assert sum(card["angle"]["counts"]) == 400 - card["splits"]["none"]
    assert any("lock angle is assumed" in entry["finding"] for entry in card["findings"])


def test_the_verb_prints_json_and_draws_a_picture(
    made_set: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    picture = tmp_path / "card.png"
    assert run("dataset", "show", str(made_set.folder), "--json", "--picture", str(picture)) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 400
    image = cv2.imread(str(picture))
    assert image is not None and image.std() > 20


def test_weights_favour_rare_angles_within_their_bound() -> None:
    angles = np.concatenate([np.zeros(1000), np.full(10, 0.3)])
    found = weights(angles, power=1.0, largest=10.0)
    assert found.mean() == pytest.approx(1.0)
    assert found[-1] == pytest.approx(10.0 * found[0])
    assert weights(angles, power=0.0) == pytest.approx(1.0)


def test_the_card_names_the_kinds_of_road(card: dict[str, Any]) -> None:
    road = card["road"]
    assert road.keys() == {"lane lines", "edges alone", "neither"} and sum(road.values()) == pytest.approx(
        1.0
    )
