"""A LeRobot data set of a drive, read as lerobot reads it: by info.json, episodes and timestamps alone."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyarrow.parquet
import pytest

from cockpit.export import lerobot
from cockpit.export.frames import DrivenFrame
from cockpit.export.lerobot import VIDEO, write_lerobot
from trepid.config import InputError
from trepid.types import Image

RATE_HZ = 20.0
DEFAULT_COLUMNS = {  # DEFAULT_FEATURES of lerobot/utils/constants.py
    "timestamp": "float",
    "frame_index": "int64",
    "episode_index": "int64",
    "index": "int64",
    "task_index": "int64",
}


def grey(value: int, size: tuple[int, int] = (48, 64)) -> Image:
    """An image of one shade."""
    return np.full((*size, 3), value, np.uint8)


def episodes_of(
    lengths: tuple[int, ...], *, size: tuple[int, int] = (48, 64), **fields: Any
) -> Iterator[DrivenFrame]:
    """Episodes of the given lengths, each frame brighter than the one before it."""
    number = 0
    for episode, length in enumerate(lengths):
        for _ in range(length):
            number += 1
            frame: dict[str, Any] = dict(
                t_s=100.0 + episode + 0.05 * number,
                image=grey(shade(number - 1), size),
                jpeg=None,
                road_wheel_rad=0.001 * number,
                speed_mps=2.0,
                episode=episode,
            )
            yield DrivenFrame(**frame | fields)


def shade(number: int) -> int:
    """The brightness of a frame."""
    return 20 + 10 * (number % 20)


def rows_of(path: Path) -> list[dict[str, Any]]:
    """The rows of a Parquet file."""
    return pyarrow.parquet.read_table(path).to_pylist()


def frame_at(path: Path, at_s: float) -> Image:
    """The frame of a video whose time is ``at_s`` to 0.1 ms, the tolerance of lerobot."""
    video = cv2.VideoCapture(str(path))
    while video.grab():
        if abs(video.get(cv2.CAP_PROP_POS_MSEC) / 1e3 - at_s) < 1e-4:
            good, image = video.retrieve()
            assert good
            return np.asarray(image, np.uint8)
    raise AssertionError(f"no frame at {at_s} s")


def test_every_row_leads_to_its_own_image_through_episode_and_timestamp(tmp_path: Path) -> None:
    assert write_lerobot(episodes_of((7, 5)), tmp_path, rate_hz=RATE_HZ, task="drive") == 12
    info = json.loads((tmp_path / "meta" / "info.json").read_text())
    assert info["codebase_version"] == "v3.0" and info["fps"] == 20
    assert (info["total_episodes"], info["total_frames"]) == (2, 12) and info["splits"] == {"train": "0:2"}
    episodes = rows_of(tmp_path / "meta/episodes/chunk-000/file-000.parquet")
    assert [row["length"] for row in episodes] == [7, 5]
    assert [(row["dataset_from_index"], row["dataset_to_index"]) for row in episodes] == [(0, 7), (7, 12)]
    for number, row in enumerate(rows_of(tmp_path / info["data_path"].format(chunk_index=0, file_index=0))):
        episode = episodes[row["episode_index"]]
        place = {f"{part}_index": episode[f"videos/{VIDEO}/{part}_index"] for part in ("chunk", "file")}
        path = tmp_path / info["video_path"].format(video_key=VIDEO, **place)
        image = frame_at(path, episode[f"videos/{VIDEO}/from_timestamp"] + row["timestamp"])
        assert abs(float(image[:, :, 0].mean()) - shade(number)) < 6, "the shades are 10 apart"
        assert row["index"] == number == episode["dataset_from_index"] + row["frame_index"]
        assert row["action"] == pytest.approx(0.001 * (number + 1))
        assert row["task_index"] == 0


def test_the_columns_are_those_that_info_describes_in_their_types(tmp_path: Path) -> None:
    write_lerobot(episodes_of((4,)), tmp_path, rate_hz=RATE_HZ, task="drive")
    features = json.loads((tmp_path / "meta" / "info.json").read_text())["features"]
    schema = pyarrow.parquet.read_schema(tmp_path / "data/chunk-000/file-000.parquet")
    types = {"float": "float32", "double": "float64", "int64": "int64"}
    found = {name: types[str(schema.field(name).type)] for name in schema.names}
    assert found == {name: one["dtype"] for name, one in features.items() if one["dtype"] != "video"}
    assert {name: str(schema.field(name).type) for name in DEFAULT_COLUMNS} == DEFAULT_COLUMNS
    assert not any("/" in name for name in features), "lerobot refuses such a name"
    assert features[VIDEO]["shape"] == [48, 64, 3]
    assert all(one["shape"] == [1] for name, one in features.items() if name != VIDEO)


def test_the_text_of_a_task_is_the_index_of_its_table(tmp_path: Path) -> None:
    write_lerobot(episodes_of((2,)), tmp_path, rate_hz=RATE_HZ, task="keep the lane")
    table = pyarrow.parquet.read_table(tmp_path / "meta" / "tasks.parquet")
    assert table.schema.pandas_metadata["index_columns"] == ["task"]
    assert table.to_pylist() == [{"task_index": 0, "task": "keep the lane"}]


def test_statistics_are_of_the_numbers_and_of_red_green_and_blue_as_shares(tmp_path: Path) -> None:
    frames = list(episodes_of((3, 2), image=np.full((48, 64, 3), (100, 50, 0), np.uint8)))
    write_lerobot(iter(frames), tmp_path, rate_hz=RATE_HZ, task="drive")
    stats = json.loads((tmp_path / "meta" / "stats.json").read_text())
    assert stats[VIDEO]["mean"] == [[[0.0]], [[pytest.approx(50 / 255)]], [[pytest.approx(100 / 255)]]]
    assert stats["action"]["mean"] == [pytest.approx(0.003)] and stats["action"]["count"] == [5]
    first = rows_of(tmp_path / "meta/episodes/chunk-000/file-000.parquet")[0]
    assert first["stats/action/max"] == [pytest.approx(0.003)]
    assert np.shape(first[f"stats/{VIDEO}/std"]) == (3, 1, 1)


def test_an_unknown_speed_is_no_state(tmp_path: Path) -> None:
    write_lerobot(episodes_of((3,), speed_mps=math.nan), tmp_path / "none", rate_hz=RATE_HZ, task="drive")
    write_lerobot(episodes_of((3,)), tmp_path / "known", rate_hz=RATE_HZ, task="drive")
    has = [
        "observation.state" in (tmp_path / name / "meta/info.json").read_text() for name in ("none", "known")
    ]
    assert has == [False, True]


def test_a_full_video_is_followed_by_another_at_the_next_episode(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lerobot, "VIDEO_MB", -1)
    write_lerobot(episodes_of((3, 3)), tmp_path, rate_hz=RATE_HZ, task="drive")
    episodes = rows_of(tmp_path / "meta/episodes/chunk-000/file-000.parquet")
    assert [row[f"videos/{VIDEO}/file_index"] for row in episodes] == [0, 1]
    assert [row[f"videos/{VIDEO}/from_timestamp"] for row in episodes] == [0.0, 0.0]
    assert len(list(tmp_path.rglob("*.mp4"))) == 2


def test_an_odd_side_of_the_images_is_cut_and_another_size_refused(tmp_path: Path) -> None:
    write_lerobot(episodes_of((3,), size=(47, 61)), tmp_path / "odd", rate_hz=RATE_HZ, task="drive")
    features = json.loads((tmp_path / "odd/meta/info.json").read_text())["features"]
    assert features[VIDEO]["shape"] == [46, 60, 3]
    mixed = [*episodes_of((2,)), *episodes_of((2,), size=(24, 32))]
    with pytest.raises(InputError, match="has one size"):
        write_lerobot(iter(mixed), tmp_path / "mixed", rate_hz=RATE_HZ, task="drive")
