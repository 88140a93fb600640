"""The frames for the training of the network, and about `trepid train-lane` without torch."""

import importlib.util
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import learning.rendered
from learning.drawn_frames import road_samples
from learning.lane.frames import (
    MOUNTS,
    Mounts,
    TrainingShot,
    change_mount,
    circuit_frames,
    mounted_frames,
    random_frames,
)
from learning.lane.scores import LabelledFrames
from learning.lane.train import train
from learning.rendered import FIRST_ROAD, ROADS_PER_SEED
from perception.net.canonical import CanonicalView, crop_camera, lane_of_row
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CANONICAL = crop_camera(CAMERA, top_px=82, bottom_px=202, width_px=200, height_px=66)
SHOT = TrainingShot(CAMERA, CANONICAL, lookahead_m=10.0, frames_per_road=2)


def silent(text: str) -> None:
    """Progress output that is discarded."""


@pytest.fixture
def in_this_process(monkeypatch):
    """Render without a pool, whose processes would import everything anew; what it is given must be picklable."""
    monkeypatch.setattr(
        learning.rendered, "imap", lambda work, tasks, jobs: map(pickle.loads(pickle.dumps(work)), tasks)
    )


def frames(folder: Path, count: int, *, split: str = "train", reuse: bool = False) -> LabelledFrames:
    return random_frames(SHOT, split, count, seed=1, folder=folder, reuse=reuse, report=silent)


@pytest.mark.usefixtures("in_this_process")
def test_frames_depend_on_the_split_and_more_frames_go_on_where_fewer_ended(tmp_path):
    few = frames(tmp_path / "here", 2)
    files = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("*.npz")}
    more = frames(tmp_path / "here", 4, reuse=True)
    again = frames(tmp_path / "there", 2)
    other = frames(tmp_path / "there", 2, split="test")
    assert more.images.shape == (4, 66, 200, 3)
    assert np.array_equal(few.images, more.images[:2]) and np.array_equal(few.lanes, more.lanes[:2])
    assert all(path.stat().st_mtime_ns == then for path, then in files.items())
    assert np.array_equal(few.images, again.images) and np.array_equal(few.lanes, again.lanes)
    assert not np.array_equal(few.lanes, other.lanes)


def test_no_road_belongs_to_two_splits_or_seeds():
    starts = [seed * ROADS_PER_SEED + first for seed in (0, 1) for first in sorted(FIRST_ROAD.values())]
    assert starts == sorted(starts) and min(np.diff(starts)) >= 100_000


def test_the_labels_are_those_of_the_rendered_frame():
    samples = list(road_samples(7, CAMERA, frames=2))
    data = SHOT.label_frames(samples)
    for lane, sample in zip(data.lanes, samples, strict=True):
        rate = (lane[3] - lane[2]) / SHOT.lookahead_m
        assert lane[:3] == pytest.approx(sample.lane[:3], abs=1e-6)
        assert rate == pytest.approx(sample.lane.curvature_rate_1pm2, abs=1e-6)
        assert lane[4] == pytest.approx(sample.lane_width_m)


def test_the_labels_from_a_higher_camera_are_those_of_a_smaller_world():
    high = CAMERA.model_copy(update=dict(height_m=1.5 * CAMERA.height_m))
    samples = list(road_samples(7, CAMERA, frames=2, ahead_m=15.0))
    view = CanonicalView(high, CANONICAL)
    for row, sample in zip(
        TrainingShot(high, CANONICAL, 10.0, 2).label_frames(samples).lanes, samples, strict=True
    ):
        lane, width_m = lane_of_row(row, 10.0)
        assert view.lane(lane)[:4] == pytest.approx(sample.lane[:4], abs=1e-5)
        assert 1.5 * width_m == pytest.approx(sample.lane_width_m, rel=1e-5)


def test_roads_by_random_mounts_have_lanes_of_one_world_as_each_camera_shows_it():
    """The same road by a fixed camera has the same first pose; the height is that of the ratio of both widths."""
    mounts = Mounts(height=1.6, focal=1.4)
    ratios = []
    for seed in range(3):
        one = SHOT.part(seed)["lanes"][0]
        other = replace(SHOT, mounts=mounts).part(seed)["lanes"][0]
        ratios.append(float(one[4] / other[4]))
        camera = change_mount(CAMERA, height=ratios[-1], focal=1.0)
        here, there = (CanonicalView(c, CANONICAL) for c in (CAMERA, camera))
        lanes = here.lane(lane_of_row(one, 10.0)[0]), there.lane(lane_of_row(other, 10.0)[0])
        assert lanes[1][:3] == pytest.approx(lanes[0][:3], abs=1e-4)
    assert all(1 / 1.6 <= ratio <= 1.6 for ratio in ratios)
    assert max(ratios) / min(ratios) > 1.1


@pytest.mark.usefixtures("in_this_process")
def test_frames_of_other_mounts_come_with_the_scale_of_their_world(tmp_path, monkeypatch):
    monkeypatch.setattr("learning.lane.frames.MOUNTED_FRAMES", 2)
    found = mounted_frames(SHOT, seed=1, folder=tmp_path, reuse=False, report=silent)
    assert {name: scale for name, (_, scale) in found.items()} == {
        name: factors["height"] for name, factors in MOUNTS.items()
    }
    widths_m = {name: frames.lanes[0, 4] * scale for name, (frames, scale) in found.items()}
    assert list(widths_m.values()) == pytest.approx([widths_m["high camera"]] * len(MOUNTS), rel=1e-5)


def test_the_frames_of_the_circuit_cover_it_section_by_section():
    sections = circuit_frames(SHOT, "circuit", seed=1, step_m=45.0)
    assert set(sections) == {section.name for section in load_road("circuit").sections}
    lanes = np.concatenate([data.lanes for data in sections.values()])
    assert lanes[:, 0].std() == pytest.approx(0.3, rel=0.4)


@pytest.mark.skipif(importlib.util.find_spec("torch") is not None, reason="torch is installed here")
def test_without_torch_the_verb_names_the_package_to_install(tmp_path):
    with pytest.raises(InputError, match=r"pip install -e '\.\[train\]'"):
        train(out=tmp_path, weights=tmp_path)


def test_a_teacher_without_drives_is_refused():
    with pytest.raises(InputError, match="--teacher segments: there is no --unlabelled drive"):
        train(teacher="segments")
