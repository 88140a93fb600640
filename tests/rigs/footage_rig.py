"""Images of a drawn road in files."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_road_rig import road


@pytest.fixture(scope="session")
def picture() -> np.ndarray:
    return road((0.1, 0.0, 0.0, 0.0))


@pytest.fixture
def folder(tmp_path: Path, picture: np.ndarray) -> Path:
    for name in ("b.png", "a.jpg"):
        cv2.imwrite(str(tmp_path / name), picture)
    return tmp_path


@pytest.fixture
def clip(tmp_path: Path, picture: np.ndarray) -> Path:
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 25, (320, 240))
    for _ in range(12):
        writer.write(picture)
    writer.release()
    return path
