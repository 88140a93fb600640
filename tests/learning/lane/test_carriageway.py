"""The branch that measures roads without lines: its labels, and what it leaves of the network as it was."""

import math
from pathlib import Path

import numpy as np
import pytest

onnx = pytest.importorskip("onnx", reason="the branch needs the extra: pip install -e '.[train]'")
pytest.importorskip("torch", reason="the branch needs the extra: pip install -e '.[train]'")

import learning.rendered  # noqa: E402
from learning.drawn_frames import carriageway_at, drawn_road, road_samples  # noqa: E402
from learning.lane.carriageway import OFFSET, WIDTH, CarriagewayShot, add_carriageway  # noqa: E402
from learning.lane.fit import Recipe  # noqa: E402
from learning.lane.frames import TrainingShot  # noqa: E402
from learning.lane.scores import LabelledFrames  # noqa: E402
from learning.roadside import Scenery  # noqa: E402
from learning.unlike import attach  # noqa: E402
from perception.net.canonical import CanonicalView, crop_camera  # noqa: E402
from perception.net.steer_net import Network  # noqa: E402
from sim_harness.world.roads.appearance import Marking, NeighbourLane, Stroke  # noqa: E402
from sim_harness.world.roads.drawn import UNMARKED, MarkingKind  # noqa: E402
from sim_harness.world.roads.road import Road  # noqa: E402
from trepid.car.camera import Camera  # noqa: E402
from trepid.config import CONFIG_DIR, ROOT, load  # noqa: E402

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
CANONICAL = crop_camera(CAMERA, top_px=82, bottom_px=202, width_px=200, height_px=66)
CANONICAL_VIEW = CanonicalView(CAMERA, CANONICAL)
BARE = Scenery(streets=0.0, things=0.0, bare=1.0, both_ways=1.0)
SHIPPED = ROOT / "perception" / "weights" / "steer_net.onnx"
SMALL = {"frames": 24, "frames_per_road": 12, "epochs": 1}


def labels(scenery: Scenery, seed: int) -> LabelledFrames:
    shot = CarriagewayShot(CAMERA, CANONICAL, lookahead_m=10.0, frames_per_road=8, scenery=scenery)
    samples = road_samples(seed, CAMERA, frames=8, scenery=scenery)
    return shot.label_frames(list(samples))


@pytest.mark.parametrize("seed", range(3))
def test_on_a_road_for_both_ways_the_label_is_the_whole_road_and_its_middle(seed: int) -> None:
    found = labels(BARE, seed)
    lanes = list(road_samples(seed, CAMERA, frames=8, scenery=BARE))
    for row, sample in zip(found.lanes, lanes, strict=True):
        half_m = sample.lane_width_m
        assert row[WIDTH] >= 2 * half_m - 1e-6
        aside_m = sample.carriageway.middle_m  # to the left of the lane, or to the right of its mirror image
        assert abs(aside_m) == pytest.approx((row[WIDTH] - half_m) / 2, abs=0.35)  # half of the margins
        assert row[OFFSET] == pytest.approx(sample.lane.offset_m - aside_m, abs=1e-5)


def test_the_middle_of_a_road_is_on_the_left_of_its_right_half_and_pixels_show_it() -> None:
    sides = {1.0: [0.0, 0], -1.0: [0.0, 0]}
    for seed in range(6):
        for sample in road_samples(seed, CAMERA, frames=8, scenery=BARE):
            found = Network(SHIPPED)(CANONICAL_VIEW.image(sample.image)[None]).carriageway[0]
            side = math.copysign(1.0, sample.carriageway.middle_m)
            sides[side][0] += float(found[0]) - sample.lane.offset_m
            sides[side][1] += 1
    assert all(count > 10 for _, count in sides.values())  # mirror images and others
    assert sides[1.0][0] / sides[1.0][1] < -0.6 and sides[-1.0][0] / sides[-1.0][1] > 0.6


@pytest.mark.parametrize("kind", list(MarkingKind))
def test_only_roads_without_lines_have_a_carriageway(kind: MarkingKind) -> None:
    road = drawn_road(np.random.default_rng(3), kinds=(kind,))
    section = road.section_at(0.0)
    paved = carriageway_at(road, 0.0)
    assert paved.width_m == pytest.approx(road.width_at(0.0) + section.paved_left_m + section.paved_right_m)
    assert paved.bare == (kind in UNMARKED)


def test_lines_under_snow_are_lines_and_lanes_without_lines_say_nothing() -> None:
    road = drawn_road(np.random.default_rng(1), kinds=(MarkingKind.DASHED,))
    section = road.section_at(0.0)
    none = Marking(stroke=Stroke.NONE)
    changes = {
        False: {"snow_cover": 0.5},
        None: {"left": none, "right": none, "left_lanes": (NeighbourLane(),)},
    }
    for bare, change in changes.items():
        other = section.model_copy(update=change)
        assert carriageway_at(Road(road.settings.model_copy(update={"sections": (other,)})), 0.0).bare is bare


def test_roads_are_bare_only_where_the_scenery_says_so() -> None:
    names = {
        sample.carriageway.bare
        for seed in range(3)
        for sample in road_samples(seed, CAMERA, frames=1, scenery=BARE)
    }
    assert names == {True}


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    path = tmp_path / "steer_net.onnx"
    path.write_bytes(SHIPPED.read_bytes())
    return path


def test_the_branch_leaves_the_lane_and_its_world_as_they_were_and_replaces_the_branch_before(
    weights: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(learning.rendered, "imap", lambda work, tasks, jobs: map(work, tasks))
    recipe = load(CONFIG_DIR / "train.yaml", Recipe)
    recipe = recipe.model_copy(update={"carriageway": recipe.carriageway.model_copy(update=SMALL)})
    shot = TrainingShot(CAMERA, CANONICAL, lookahead_m=10.0, frames_per_road=1)
    images = labels(BARE, 5).images
    before = Network(weights)(images)
    count = add_carriageway(weights, recipe, shot, folder=tmp_path, reuse=False)
    after, size = Network(weights)(images), weights.stat().st_size
    for one, other in zip(before[:4], after[:4], strict=True):
        assert np.array_equal(one, other)
    assert after.carriageway.shape == (8, 3) and not np.array_equal(before.carriageway, after.carriageway)
    assert (after.carriageway[:, 1] > 0).all()
    assert ((after.carriageway[:, 2] >= 0) & (after.carriageway[:, 2] <= 1)).all()
    assert count < 50_000
    add_carriageway(weights, recipe, shot, folder=tmp_path, reuse=True)
    assert weights.stat().st_size == size
    other = tmp_path / "shipped.onnx"
    other.write_bytes(SHIPPED.read_bytes())
    for path in (weights, other):
        attach(path, images)  # the world of the network has no features of its branch
    known = Network(weights)(images)
    assert np.array_equal(known.unlike, Network(other)(images).unlike)
    assert np.array_equal(known.carriageway, after.carriageway)
