"""Drives as a LeRobot data set, version 3: Parquet tables of numbers, MP4 videos, and their description.

    meta/info.json, meta/stats.json, meta/tasks.parquet, meta/episodes/chunk-000/file-000.parquet
    data/chunk-000/file-000.parquet
    videos/observation.images.front/chunk-000/file-000.mp4, file-001.mp4, …

An episode is a piece without pauses. The format has a constant rate: ``timestamp`` is frame_index/fps, and the
image of a frame is that of ``from_timestamp`` + ``timestamp`` in the video of its episode. ``capture_time_s`` is
the measured time. ``action`` is the road-wheel angle [rad], + = left. ``observation.state`` is the speed [m/s], if
it is known for every frame. The sides of the video are even numbers: an odd last row or column is left out.

Layout: LeRobotDatasetMetadata, DatasetWriter and compute_stats of lerobot 0.4 (codebase version 3.0).
"""

import json
from collections.abc import Iterable, Mapping
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from cockpit.export.frames import DrivenFrame
from trepid.config import InputError
from trepid.types import Image

VERSION = "v3.0"
VIDEO = "observation.images.front"
CODEC, CODEC_NAME = "mp4v", "mpeg4"  # VP9 of OpenCV, which browsers play too, takes 70 times as long
CHUNK_FILES, DATA_MB, VIDEO_MB = 1000, 100, 200
DATA_PATH = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES_PATH = "meta/episodes/chunk-000/file-000.parquet"
ROBOT = "trepid"
SAMPLES = 16  # pixels in each direction of an image that its statistics use
QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}
Place = tuple[int, int]  # of a file: chunk, number in it


class _Row(NamedTuple):
    """The numbers of a frame."""

    episode: int
    split: str
    t_s: float
    road_wheel_rad: float
    speed_mps: float


def write_lerobot(frames: Iterable[DrivenFrame], out: Path, *, rate_hz: float, task: str) -> int:
    """Write the data set into the new folder ``out``; return the number of its frames. Needs pyarrow.

    ``rate_hz`` is rounded to a whole number, as the format has it. Raises InputError for images of several sizes.
    """
    fps = max(1, round(rate_hz))
    films, rows, pixels = _Films(out, fps), [], []
    try:
        for frame in frames:
            films.add(frame)
            rows.append(_Row(frame.episode, frame.split, frame.t_s, frame.road_wheel_rad, frame.speed_mps))
            pixels.append(_sample_pixels(frame.image))
    finally:
        films.close()
    lengths = [len(list(group)) for _, group in groupby(rows, key=lambda row: row.episode)]
    columns = _columns(rows, lengths, fps)
    numbers = {VIDEO: np.array(pixels).reshape(-1, *pixels[0].shape), **columns} if rows else {}
    ends = np.cumsum([0, *lengths]).tolist()
    stats = [
        {name: _stats(values[a:b]) for name, values in numbers.items() if name != "task_index"}
        for a, b in pairwise(ends)
    ]
    _write_data(out / DATA_PATH.format(chunk_index=0, file_index=0), columns, ends)
    _write_episodes(out / EPISODES_PATH, films.episodes, ends, task, stats)
    _write_tasks(out / "meta" / "tasks.parquet", task)
    _write_json(out / "meta" / "stats.json", {name: _stats(values) for name, values in numbers.items()})
    starts = [rows[at].split for at in ends[:-1]]
    _write_json(out / "meta" / "info.json", _info(fps, ends, starts, columns, films.size))
    return len(rows)


class _Films:
    """The videos: episodes one after the other, and a new file where one becomes too large."""

    def __init__(self, out: Path, fps: int) -> None:
        self._out, self._fps = out, fps
        self.size: tuple[int, int] | None = None  # width, height of the video
        self.episodes: list[tuple[Place, float, float]] = []  # file, begin and end [s] in it
        self._writer: cv2.VideoWriter | None = None
        self._shape: tuple[int, ...] = ()
        self._number = self._frames = 0  # of the file; frames in it
        self._episode = -1

    def add(self, frame: DrivenFrame) -> None:
        """Append the image of ``frame``. Raises InputError."""
        if self.size is None:
            self._shape = frame.image.shape
            self.size = (self._shape[1] // 2 * 2, self._shape[0] // 2 * 2)
        if frame.image.shape != self._shape:
            raise InputError(
                f"image of {frame.t_s:.3f} s: {frame.image.shape[1]}×{frame.image.shape[0]} pixels, the first has"
                f" {self._shape[1]}×{self._shape[0]}; a LeRobot data set has one size"
            )
        if frame.episode != self._episode:
            self._begin(frame.episode)
        assert self._writer is not None
        self._writer.write(np.ascontiguousarray(frame.image[: self.size[1], : self.size[0]]))
        self._frames += 1
        place, begin_s, _ = self.episodes[-1]
        self.episodes[-1] = (place, begin_s, self._frames / self._fps)

    def _begin(self, episode: int) -> None:
        path = self._path()
        if self._writer is not None and path.stat().st_size > VIDEO_MB * 2**20:
            self.close()
            self._number, self._frames = self._number + 1, 0
            path = self._path()
        if self._writer is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            assert self.size is not None
            self._writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*CODEC), self._fps, self.size)
            if not self._writer.isOpened():
                raise InputError(f"{path}: cannot be written: this OpenCV has no encoder {CODEC_NAME}")
        at_s = self._frames / self._fps
        self._episode = episode
        self.episodes.append((divmod(self._number, CHUNK_FILES), at_s, at_s))

    def _path(self) -> Path:
        chunk, number = divmod(self._number, CHUNK_FILES)
        return self._out / VIDEO_PATH.format(video_key=VIDEO, chunk_index=chunk, file_index=number)

    def close(self) -> None:
        """Finish the video."""
        if self._writer is not None:
            self._writer.release()
            self._writer = None


def _sample_pixels(image: Image) -> Image:
    """Some pixels of an image, (n, 3) RGB."""
    down, right = (max(1, size // SAMPLES) for size in image.shape[:2])
    return image[::down, ::right, ::-1].reshape(-1, 3)


def _columns(rows: list[_Row], lengths: list[int], fps: int) -> dict[str, NDArray[Any]]:
    """Column of the data -> values (n,) or (n, size), in the types of :func:`_features`."""
    within = np.concatenate([np.arange(length) for length in lengths]) if lengths else np.empty(0, np.int64)
    speed_mps = np.array([row.speed_mps for row in rows], np.float32)
    state = {"observation.state": speed_mps} if rows and np.isfinite(speed_mps).all() else {}
    return {
        **state,
        "action": np.array([row.road_wheel_rad for row in rows], np.float32),
        "capture_time_s": np.array([row.t_s for row in rows], np.float64),
        "timestamp": (within / fps).astype(np.float32),
        "frame_index": within.astype(np.int64),
        "episode_index": np.repeat(np.arange(len(lengths)), lengths).astype(np.int64),
        "index": np.arange(len(rows), dtype=np.int64),
        "task_index": np.zeros(len(rows), np.int64),
    }


NAMES = {"observation.state": ["speed_mps"], "action": ["road_wheel_rad"]}


def _features(columns: Mapping[str, NDArray[Any]], size: tuple[int, int], fps: int) -> dict[str, Any]:
    """What info.json says about the columns."""
    width, height = size
    described = {"video.height": height, "video.width": width, "video.codec": CODEC_NAME}
    described |= {"video.pix_fmt": "yuv420p", "video.is_depth_map": False, "video.fps": fps}
    described |= {"video.channels": 3, "has_audio": False}
    video = {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"]}
    numbers = {
        name: {"dtype": str(values.dtype), "shape": [1], "names": NAMES.get(name)}
        for name, values in columns.items()
    }
    return {VIDEO: video | {"info": described}, **numbers}


def _info(
    fps: int,
    ends: list[int],
    splits: list[str],
    columns: Mapping[str, NDArray[Any]],
    size: tuple[int, int] | None,
) -> dict[str, Any]:
    episodes = len(splits)
    ranges = {name: [at for at, one in enumerate(splits) if one == name] for name in dict.fromkeys(splits)}
    return {
        "codebase_version": VERSION,
        "robot_type": ROBOT,
        "total_episodes": episodes,
        "total_frames": ends[-1],
        "total_tasks": 1,
        "chunks_size": CHUNK_FILES,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": fps,
        "splits": {name: f"{places[0]}:{places[-1] + 1}" for name, places in ranges.items()},
        "data_path": DATA_PATH,
        "video_path": VIDEO_PATH,
        "features": _features(columns, size or (0, 0), fps),
    }


def _stats(values: NDArray[Any]) -> dict[str, Any]:
    """Statistics of numbers (n,), or of pixels (n, m, 3) as shares of white in the shape (3, 1, 1)."""
    count = [len(values)]
    pixels = values.ndim == 3
    flat = values.reshape(-1, 3) / 255.0 if pixels else values[:, None].astype(np.float64)
    found = {"min": flat.min(0), "max": flat.max(0), "mean": flat.mean(0), "std": flat.std(0)}
    found |= {name: np.quantile(flat, share, axis=0) for name, share in QUANTILES.items()}
    shaped = {name: value.reshape(3, 1, 1) if pixels else value for name, value in found.items()}
    return {name: value.tolist() for name, value in shaped.items()} | {"count": count}


def _write_data(path: Path, columns: Mapping[str, NDArray[Any]], ends: list[int]) -> None:
    """One row group an episode."""
    import pyarrow as pa
    import pyarrow.parquet

    table = pa.table({name: pa.array(values) for name, values in columns.items()})
    path.parent.mkdir(parents=True)
    with pyarrow.parquet.ParquetWriter(path, table.schema) as writer:
        for begin, end in pairwise(ends):
            writer.write_table(table.slice(begin, end - begin))


def _write_episodes(
    path: Path,
    filmed: list[tuple[Place, float, float]],
    ends: list[int],
    task: str,
    stats: list[dict[str, dict[str, Any]]],
) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    rows = []
    for number, ((place, begin_s, end_s), of_columns) in enumerate(zip(filmed, stats, strict=True)):
        row: dict[str, Any] = {
            "episode_index": number,
            "tasks": [task],
            "length": ends[number + 1] - ends[number],
        }
        row |= {"data/chunk_index": 0, "data/file_index": 0}
        row |= {"dataset_from_index": ends[number], "dataset_to_index": ends[number + 1]}
        row |= {f"videos/{VIDEO}/chunk_index": place[0], f"videos/{VIDEO}/file_index": place[1]}
        row |= {f"videos/{VIDEO}/from_timestamp": begin_s, f"videos/{VIDEO}/to_timestamp": end_s}
        row |= {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
        row |= {
            f"stats/{name}/{kind}": value
            for name, found in of_columns.items()
            for kind, value in found.items()
        }
        rows.append(row)
    path.parent.mkdir(parents=True)
    pyarrow.parquet.write_table(pa.Table.from_pylist(rows), path)


def _write_tasks(path: Path, task: str) -> None:
    """The table of tasks, whose index is the text: pandas finds it by its own metadata."""
    import pyarrow as pa
    import pyarrow.parquet

    def describe_column(name: str, kind: str, stored: str) -> dict[str, Any]:
        return dict(name=name, field_name=name, pandas_type=kind, numpy_type=stored, metadata=None)

    about = {
        "index_columns": ["task"],
        "column_indexes": [describe_column("", "unicode", "object")],
        "columns": [
            describe_column("task_index", "int64", "int64"),
            describe_column("task", "unicode", "object"),
        ],
        "pandas_version": "2.0.0",
    }
    table = pa.table({"task_index": pa.array([0], pa.int64()), "task": [task]})
    pyarrow.parquet.write_table(table.replace_schema_metadata({"pandas": json.dumps(about)}), path)


def _write_json(path: Path, content: Mapping[str, Any]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content, indent=4, allow_nan=False), encoding="utf-8")
