"""A data set in the layouts of others: the same frames and angles, or one line and nothing written."""

import json
from pathlib import Path

import cv2
import numpy as np
import pyarrow.parquet
import pytest
from drive_rig import made_dataset, run, write_tub
from image_file_rig import turned_jpeg

from learning.dataset.dataset import Dataset, sha256_of, write


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("export")
    return made_dataset(folder / "set", write_tub(folder / "tub", 300), options=("--lock-deg", "20"))


def test_a_tub_of_a_data_set_is_built_into_the_same_data_set(data: Dataset, tmp_path: Path) -> None:
    assert (
        run("dataset", "export", str(data.folder), str(tmp_path / "tub"), "--as", "tub", "--split", "train")
        == 0
    )
    again = made_dataset(
        tmp_path / "set", tmp_path / "tub", options=("--lock-deg", "20", "--shares", "1,0,0")
    )
    train = data.rows("train")
    assert again.rows()["road_wheel_rad"] == pytest.approx(train["road_wheel_rad"], abs=1e-9)
    assert again.rows()["t_s"] == pytest.approx(train["t_s"], abs=1e-3)
    assert (again.image(again.rows()[5]) == data.image(train[5])).all(), "the bytes of a JPEG are copied"
    assert len(np.unique(again.rows()["route"])) == len(np.unique(train["stretch"]))


def test_a_lerobot_data_set_has_its_splits_one_after_the_other(data: Dataset, tmp_path: Path) -> None:
    assert run("dataset", "export", str(data.folder), str(tmp_path / "le"), "--as", "lerobot") == 0
    info = json.loads((tmp_path / "le/meta/info.json").read_text())
    counts = {name: len(data.rows(name)) for name in ("train", "validation", "test")}
    assert info["total_frames"] == sum(counts.values()) and info["fps"] == 20
    table = pyarrow.parquet.read_table(tmp_path / "le/data/chunk-000/file-000.parquet").to_pydict()
    angles = np.concatenate([data.rows(name)["road_wheel_rad"] for name in counts])
    assert table["action"] == pytest.approx(angles, abs=1e-6)
    episodes = np.array(table["episode_index"])
    for name, count in counts.items():
        first, last = map(int, info["splits"][name].split(":"))
        assert ((episodes >= first) & (episodes < last)).sum() == count


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("--as", "zip"), "--as"),
        (("--as", "tub", "--split", "none"), "--split none: expected train or validation or test"),
    ],
)
def test_bad_options_are_refused_and_nothing_is_written(
    data: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str], words: tuple[str, ...], what: str
) -> None:
    assert run("dataset", "export", str(data.folder), str(tmp_path / "out"), *words) == 2
    assert what in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_an_existing_folder_is_kept(data: Dataset, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    assert run("dataset", "export", str(data.folder), str(tmp_path / "mine"), "--as", "tub") == 2
    assert list((tmp_path / "mine").iterdir()) == []


def test_a_tub_of_times_without_a_date_is_refused_with_the_time(
    data: Dataset, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = data.rows().copy()
    rows["t_s"] *= 1e9  # nanoseconds
    file = data.file.model_copy(update={"data_sha256": sha256_of(rows)})
    write(tmp_path / "set", file, rows)
    assert run("dataset", "export", str(tmp_path / "set"), str(tmp_path / "tub"), "--as", "tub") == 2
    assert "e+18 s has no date: check its unit" in capsys.readouterr().err
    assert not (tmp_path / "tub").exists()


@pytest.mark.parametrize("orientation", [1, 2, 3, 6])
def test_the_images_of_a_tub_are_upright_for_readers_that_ignore_exif(
    tmp_path: Path, orientation: int
) -> None:
    tub = write_tub(tmp_path / "tub", 12)
    for image in (tub / "images").iterdir():
        image.write_bytes(turned_jpeg(image.read_bytes(), orientation))
    data = made_dataset(tmp_path / "set", tub, options=("--lock-deg", "20", "--shares", "1,0,0"))
    assert run("dataset", "export", str(data.folder), str(tmp_path / "out"), "--as", "tub") == 0
    for number, row in enumerate(data.rows()):
        copy = tmp_path / "out" / "images" / f"{number}_cam_image_array_.jpg"
        stored = cv2.imread(str(copy), cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        shown = data.image(row)
        assert stored is not None and stored.shape == shown.shape
        assert np.abs(stored.astype(int) - shown).mean() < 2.0
        original = tub / "images" / str(row["image"])
        assert (copy.read_bytes() == original.read_bytes()) == (orientation == 1)
