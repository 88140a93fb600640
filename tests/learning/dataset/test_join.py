"""Several data sets as one: drives that are repeated, and what no later split may share with the training."""

from pathlib import Path

import numpy as np
import pytest
from drive_rig import made_dataset, write_tub

from learning.dataset.dataset import NONE, Dataset
from learning.dataset.join import join_datasets
from learning.dataset.split import ALIKE_WHY, GAP

DRIVE_FRAMES, BASE_FRAMES = 800, 400  # at 20 Hz


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """The first 20 s of the drive."""
    folder = tmp_path_factory.mktemp("base")
    tub = write_tub(folder / "tub", BASE_FRAMES)
    return made_dataset(folder / "set", tub, options=("--lock-deg", "20"))


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """40 s of corrections without a split of their own, in two stretches."""
    folder = tmp_path_factory.mktemp("drive")
    tub = write_tub(folder / "tub", DRIVE_FRAMES, deleted=(450, 451))
    options = ("--lock-deg", "20", "--shares", "1,0,0", "--gap-s", "0")
    return made_dataset(folder / "set", tub, options=options)


@pytest.fixture(scope="module")
def both(base: Dataset, drive: Dataset, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """``base``, and the drive twice."""
    return join_datasets(tmp_path_factory.mktemp("both"), base, [drive, drive], command="join")


def test_joined_data_sets_keep_their_images_and_what_was_tested(
    base: Dataset, drive: Dataset, both: Dataset
) -> None:
    labelled = drive.rows("train")
    assert len(both) == len(base) + 2 * len(labelled)
    for split in ("validation", "test"):
        tested = both.rows(split)[both.rows(split)["source"] == 0]
        for name in ("frame", "t_s", "road_wheel_rad"):
            assert (tested[name] == base.rows(split)[name]).all()
    added = both.rows()[len(base) :]
    assert set(added["stretch"]).isdisjoint(base.rows()["stretch"])
    assert len(np.unique(added["stretch"])) == 4
    assert (both.image(added[500]) == drive.image(labelled[500])).all()


def test_the_same_part_of_a_drive_that_is_repeated_has_the_same_split(both: Dataset) -> None:
    first, second = (both.rows()[both.rows()["source"] == number] for number in (1, 2))
    assert (first["split"] == second["split"]).all() and (first["why"] == second["why"]).all()
    assert {"train", "validation"} == set(first["split"]) - {NONE}
    elapsed_s = first["t_s"] - first["t_s"][0]
    assert (first["split"][(elapsed_s > 21.0) & (elapsed_s < 29.0)] == "validation").all()


def test_frames_of_validation_are_apart_from_those_of_training_by_the_gap(
    base: Dataset, both: Dataset
) -> None:
    added = both.rows()[both.rows()["source"] > 0]
    validation, train = (added["t_s"][added["split"] == name] for name in ("validation", "train"))
    assert np.abs(validation[:, None] - train[None]).min() >= base.file.split.gap_s - 1e-6
    assert GAP in added["why"]


def test_no_joined_frame_of_training_looks_like_one_of_validation_or_test(both: Dataset) -> None:
    shown = {split: set(both.rows(split)["image"].tolist()) for split in ("train", "validation", "test")}
    assert (
        not shown["train"] & (shown["validation"] | shown["test"]) and not shown["validation"] & shown["test"]
    )
    left_out = both.rows()[both.rows()["why"] == ALIKE_WHY]
    assert len(left_out) and set(left_out["split"]) == {NONE}


def test_joining_again_gives_the_same_data_set(
    base: Dataset, drive: Dataset, both: Dataset, tmp_path: Path
) -> None:
    assert join_datasets(tmp_path / "again", base, [drive, drive], command="join").sha256 == both.sha256
