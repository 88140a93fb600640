"""A data set: what its rows hold, how its images are read, and what is refused."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from drive_rig import made_dataset, picture, run, steering_of, write_tub
from ruamel.yaml import YAML

from learning.dataset.dataset import CARD, INDEX, Dataset, sha256_of
from trepid.config import InputError


@pytest.fixture(scope="module")
def made_set(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drives")
    return made_dataset(folder / "set", write_tub(folder / "tub", 400), options=("--lock-deg", "20"))


def test_labels_are_positive_to_the_left(made_set: Dataset) -> None:
    rows = made_set.rows()
    assert rows["road_wheel_rad"] == pytest.approx(-np.radians(20.0) * steering_of(400))
    assert made_set.wheel.sign == -1


def test_an_image_is_that_of_its_row(made_set: Dataset) -> None:
    row = made_set.rows("test")[0]
    drawn = picture(float(steering_of(400)[row["frame"]]), int(row["frame"]))
    read = made_set.image(row)
    assert read.shape == drawn.shape and read.dtype == np.uint8
    assert np.abs(read.astype(int) - drawn).mean() < 12  # JPEG


def test_splits_together_are_all_rows(made_set: Dataset) -> None:
    assert sum(len(made_set.rows(name)) for name in ("train", "validation", "test", "none")) == len(
        made_set.rows()
    )
    assert not np.isnan(made_set.rows("train")["road_wheel_rad"]).any()


def test_the_hash_is_that_of_the_labels(made_set: Dataset) -> None:
    rows = made_set.rows().copy()
    rows["road_wheel_rad"][3] += 1e-12
    assert sha256_of(rows) != made_set.sha256
    rows = made_set.rows().copy()
    rows["light"][3] = 0.5
    assert sha256_of(rows) == made_set.sha256


def test_the_same_sources_make_the_same_data_set(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    assert made_dataset(tmp_path / "a", tub).sha256 == made_dataset(tmp_path / "b", tub).sha256


def test_an_unknown_split_is_refused(made_set: Dataset) -> None:
    with pytest.raises(InputError, match="no split 'tests'"):
        made_set.rows("tests")


@pytest.mark.parametrize(
    ("options", "remedy"),
    [((), "with a longer drive, or with less than --gap-s 2"), (("--shares", "0.8,0.2,0"), "with --shares")],
)
def test_a_split_without_labelled_frames_is_refused_with_what_makes_some(
    tmp_path: Path, options: tuple[str, ...], remedy: str
) -> None:
    frames = 40 if not options else 200
    made = made_dataset(tmp_path / "set", write_tub(tmp_path / "tub", frames), options=options)
    with pytest.raises(InputError, match=rf"no labelled frame in the split 'test' \(train \d+, .*{remedy}"):
        made.labelled_rows("test")
    assert len(made.labelled_rows("train")) > 20


def test_a_folder_that_is_no_data_set_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no data set"):
        Dataset.open(tmp_path)


def test_a_data_set_of_another_version_is_refused(made_set: Dataset, tmp_path: Path) -> None:
    shutil.copytree(made_set.folder, tmp_path / "set")
    card = tmp_path / "set" / CARD
    card.write_text(card.read_text().replace("version: 1", "version: 2"))
    with pytest.raises(InputError, match="version 2, expected 1"):
        Dataset.open(tmp_path / "set")


def test_an_index_that_was_changed_or_cut_is_refused(made_set: Dataset, tmp_path: Path) -> None:
    folder = tmp_path / "set"
    shutil.copytree(made_set.folder, folder)
    index = folder / INDEX
    whole = index.read_bytes()
    index.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"index\.parquet: cannot be read"):
        Dataset.open(folder)
    made_dataset(tmp_path / "other", write_tub(tmp_path / "tub", 60))
    index.write_bytes((tmp_path / "other" / INDEX).read_bytes())
    with pytest.raises(InputError, match="was changed"):
        Dataset.open(folder)


def test_images_that_were_moved_are_missed_by_name(tmp_path: Path) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    made = made_dataset(tmp_path / "set", tub)
    tub.rename(tmp_path / "elsewhere")
    with pytest.raises(InputError, match="are not there any more"):
        made.image(made.rows()[0])


def test_a_build_that_is_interrupted_leaves_the_old_data_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    made_dataset(tmp_path / "set", tub)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("pyarrow.parquet.write_table", interrupt)
    before = (tmp_path / "set" / CARD).read_text()
    assert run("dataset", "build", str(tmp_path / "set"), str(tub)) == 130
    assert (tmp_path / "set" / CARD).read_text() == before
    Dataset.open(tmp_path / "set")


def test_a_folder_with_another_file_of_that_name_is_not_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    tub = write_tub(tmp_path / "tub", 60)
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / CARD).write_text("path: mine\nnames: [lane]\n")
    assert run("dataset", "build", str(tmp_path / "set"), str(tub)) == 2
    assert "nothing is written here" in capsys.readouterr().err
    assert (tmp_path / "set" / CARD).read_text() == "path: mine\nnames: [lane]\n"


def test_the_settings_of_a_data_set_name_log_and_hash(made_set: Dataset) -> None:
    data = YAML(typ="safe").load((made_set.folder / CARD).read_text())
    assert data["sources"][0]["kind"] == "tub2"
    assert len(data["sources"][0]["sha256"]) == 64
    assert data["wheel"]["how"] == "given"
