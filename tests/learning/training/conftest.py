"""A data set of one drive, for trainings that begin with the same frames."""

import pytest
from drive_rig import made_dataset, write_tub

from learning.dataset.dataset import Dataset


@pytest.fixture(scope="session")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drive")
    return made_dataset(folder / "set", write_tub(folder / "tub", 360))
