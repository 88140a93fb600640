"""The frames for the training of the network, and about `trepid train-lane` without torch."""

import importlib.util
import pickle
from pathlib import Path

import numpy as np
import pytest

import learning.rendered
from learning.drawn_frames import road_samples
from learning.lane.frames import Shot, circuit_frames, random_frames
from learning.lane.scores import Labelled
from learning.lane.train import train
from learning.rendered import FIRST_ROAD, ROADS_PER_SEED
from perception.net.canonical import cropped
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CANONICAL = cropped(CAMERA, top_px=82, bottom_px=202, width_px=200, height_px=66)
SHOT = Shot(CAMERA, CANONICAL, lookahead_m=10.0, frames_per_road=2)


def silent(text: str) -> None:
    """Progress output that is discarded."""


@pytest.fixture
def in_this_process(monkeypatch):
    """Render without a pool, whose processes would import everything anew; what it is given must be picklable."""
    monkeypatch.setattr(
        learning.rendered, "imap", lambda work, tasks, jobs: map(pickle.loads(pickle.dumps(work)), tasks)
    )


def frames(folder: Path, count: int, *, split: str = "train", reuse: bool = False) -> Labelled:
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
    data = SHOT.labelled(samples)
    for lane, sample in zip(data.lanes, samples, strict=True):
        rate = (lane[3] - lane[2]) / SHOT.lookahead_m
        assert lane[:3] == pytest.approx(sample.lane[:3], abs=1e-6)
        assert rate == pytest.approx(sample.lane.curvature_rate_1pm2, abs=1e-6)


def test_the_frames_of_the_circuit_cover_it_section_by_section():
    sections = circuit_frames(SHOT, "circuit", seed=1, step_m=45.0)
    assert set(sections) == {section.name for section in load_road("circuit").sections}
    lanes = np.concatenate([data.lanes for data in sections.values()])
    assert lanes[:, 0].std() == pytest.approx(0.3, rel=0.4)


@pytest.mark.skipif(importlib.util.find_spec("torch") is not None, reason="torch is installed here")
def test_without_torch_the_verb_names_the_package_to_install(tmp_path):
    with pytest.raises(InputError, match=r"pip install -e '\.\[train\]'"):
        train(out=tmp_path, weights=tmp_path)
