"""The data set: labels that fit the picture, seeds, and variety."""

import itertools
import math

import cv2
import numpy as np
import pytest

from learning.drawn_frames import (
    AHEAD_M,
    BLIND_SHARE,
    BOTH_WAYS,
    MIN_RADIUS_M,
    LaneSample,
    _blinding_light,
    _mirror_camera,
    _random_light,
    _random_offset,
    _random_place,
    add_seams,
    highway,
    random_road,
    road_samples,
)
from learning.roadside import Scenery
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.roads.appearance import Light, Marking, Section, Stroke, Verge
from sim_harness.world.roads.drawn import UNMARKED
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)


@pytest.fixture(scope="module")
def samples():
    return list(itertools.chain(*(road_samples(seed, CAMERA, frames=60) for seed in range(2))))


def test_the_same_seed_gives_the_same_samples_wherever_it_runs():
    alone = list(road_samples(1, CAMERA, frames=3))
    in_a_range = [sample for seed in (0, 1) for sample in road_samples(seed, CAMERA, frames=3)][3:]
    for a, b in zip(alone, in_a_range, strict=True):
        assert np.array_equal(a.image, b.image)
        assert a.lane == b.lane


def test_frames_have_the_size_of_the_camera_and_labels_stay_in_their_ranges(samples):
    for sample in samples:
        assert sample.image.shape == (CAMERA.height_px, CAMERA.width_px, 3)
        assert sample.image.dtype == np.uint8 and sample.image.flags.c_contiguous
        assert abs(sample.lane.offset_m) <= 1.2 and abs(sample.lane.heading_rad) <= 0.3
        assert abs(sample.lane.curvature_1pm) <= 1 / MIN_RADIUS_M + 1e-9
        assert 2.8 <= sample.lane_width_m <= 5.0


def test_left_and_right_are_equally_common(samples):
    signs = np.sign([sample.lane.offset_m for sample in samples])
    assert abs(signs.mean()) < 0.35


@pytest.mark.parametrize("seed", range(20))
def test_a_random_road_never_turns_back_on_itself(seed):
    road = random_road(np.random.default_rng(seed))
    headings = road.poses(np.arange(0, road.length_m, 1.0))[:, 2]
    assert np.abs(headings).max() < math.pi / 2


@pytest.mark.parametrize("seed", range(10))
def test_a_highway_has_up_to_six_lanes_and_wide_bends(seed):
    road = highway(np.random.default_rng(seed))
    (section,) = road.sections
    beside = len(section.left_lanes), len(section.right_lanes)
    assert beside[0] <= 3 and beside[1] <= 2
    strokes = section.left.stroke, section.right.stroke
    assert strokes == tuple(Stroke.DASHED if lanes else Stroke.SOLID for lanes in beside)
    bends = [road.curvature_at(station_m) for station_m in np.arange(0, road.length_m, 5.0).tolist()]
    assert max(abs(bend) for bend in bends) <= 1 / 300 + 1e-9


def test_seams_are_the_only_change_of_a_seamed_road():
    road = random_road(np.random.default_rng(3))
    with_seams = add_seams(road, np.random.default_rng(4))
    assert all(1 <= len(section.seams_m) <= 3 for section in with_seams.sections)
    bare = [section.model_copy(update={"seams_m": ()}) for section in with_seams.sections]
    assert with_seams.settings.model_copy(update={"sections": tuple(bare)}) == road.settings


def roads(**shares: float) -> list[Road]:
    """Roads of 40 seeds outside towns."""
    scenery = Scenery(streets=0, things=0, **shares)
    generators = [(np.random.default_rng((n, 1)), np.random.default_rng((n, 2))) for n in range(40)]
    return [_random_place(*pair, scenery)[0].road for pair in generators]


def test_scenery_adds_highways_and_seams_in_their_shares():
    assert {road.name for road in roads(highways=1.0)} == {"highway"}
    assert "highway" not in {road.name for road in roads()}
    seams = [bool(road.sections[0].seams_m) for road in roads(seams=0.5)]
    assert 12 <= sum(seams) <= 28


def test_roads_without_lines_are_for_both_ways_in_their_share_and_no_others_are():
    usual, wide = roads(), roads(both_ways=1.0)
    assert BOTH_WAYS not in {road.name for road in usual}
    for one, other in zip(usual, wide, strict=True):
        assert (other.name == BOTH_WAYS) == (one.name in UNMARKED)
        assert other.name == BOTH_WAYS or one.settings == other.settings
    assert sum(road.name == BOTH_WAYS for road in wide) > 2


def test_the_lane_is_the_right_half_of_a_road_for_both_ways():
    for road in (road for road in roads(both_ways=1.0) if road.name == BOTH_WAYS):
        (section,) = road.sections
        assert 2.7 <= section.paved_left_m == road.width_at(0.0) <= 3.7
        assert section.paved_right_m == 0.0 and section.left.stroke == section.right.stroke == Stroke.NONE


def test_on_a_road_for_both_ways_the_car_is_nowhere_beyond_the_middle_and_often_just_before_it():
    road = next(road for road in roads(both_ways=1.0) if road.name == BOTH_WAYS)
    middle_m, rng = road.width_at(0.0) / 2, np.random.default_rng(1)
    offsets_m = np.array([_random_offset(road, rng) for _ in range(2000)])
    assert -1.2 <= offsets_m.min() < -1.0 and middle_m - 0.1 < offsets_m.max() <= middle_m
    assert 0.25 <= np.mean(offsets_m > middle_m - 0.5) <= 0.4 and np.mean(np.abs(offsets_m) < 0.5) > 0.3


def test_snow_covers_a_share_of_the_roads_with_a_bank_along_each_of_their_edges():
    usual, snowed = roads(), roads(snow=0.5)
    changed = [other for one, other in zip(usual, snowed, strict=True) if one.settings != other.settings]
    assert 10 <= len(changed) <= 30
    sections = [section for road in changed for section in road.sections]
    assert all(one.verge == Verge.SNOW and 0.3 <= one.snow_cover <= 0.9 for one in sections)
    assert all(0 <= bank_m <= 0.6 for one in sections for bank_m in (one.snow_left_m, one.snow_right_m))


def test_a_mirrored_frame_shows_the_mirror_image_of_the_road():
    """Rendering with the mirrored camera and flipping equals rendering the mirrored road."""
    camera = CAMERA.model_copy(update={"y_m": 0.2, "yaw_rad": 0.05, "cx_px": 150.0})
    solid = Section(name="solid", start_m=0, left=Marking(), right=Marking(), patchiness=0)
    frames = {}
    for sign in (-1, 1):
        settings = RoadSettings(
            name="circle",
            closed=True,
            lane_width_m=3.4,
            segments=(Segment(length_m=40 * math.pi, curvature_1pm=sign / 20),),
            sections=(solid,),
        )
        road = Road(settings)
        x_m, y_m = road.position(30.0, sign * 0.4)
        view = camera if sign < 0 else _mirror_camera(camera)
        frames[sign] = Renderer(road, view, seed=1).render(
            x_m, y_m, road.heading_at(30.0) + sign * 0.1, t_s=0, light=Light(noise=0)
        )
    ours, theirs = frames[-1][120:].min(axis=2) > 165, frames[1][120:, ::-1].min(axis=2) > 165
    assert (ours & theirs).sum() > 0.8 * max(ours.sum(), theirs.sum()) > 100


def test_the_labels_place_the_lane_lines_in_the_picture(samples):
    """Along the labelled right edge of the lane the picture has an edge or a line: more change than next to it."""
    at, beside = [], []
    for sample in samples:
        if not sample.visible or sample.image.std() < 25:
            continue
        x = np.linspace(4.0, 8.0, 12)
        for side in (-0.5, 0.5):
            at += _change_across(sample, x, side)
            beside += _change_across(sample, x, side / 2)
    assert len(at) > 500
    assert np.mean(at) > 1.5 * np.mean(beside)


def _change_across(sample: LaneSample, x: np.ndarray, lanes: float) -> list[float]:
    """Range of the colour within 4 columns of the points ``lanes`` lane widths left of the lane centre."""
    y = -sample.lane.offset_m - sample.lane.heading_rad * x + sample.lane.curvature_1pm * x**2 / 2
    y += sample.lane.curvature_rate_1pm2 * x**3 / 6 + lanes * sample.lane_width_m
    image, changes = sample.image, []
    for u, v in np.round(CAMERA.pixel_from_road(np.column_stack([x, y]))).astype(int).tolist():
        if 8 <= u < image.shape[1] - 8 and 0 <= v < image.shape[0]:
            changes.append(float(np.ptp(image[v, u - 4 : u + 5].astype(float), axis=0).max()))
    return changes


def test_the_curvature_rate_is_the_mean_over_the_lane_ahead():
    road = random_road(np.random.default_rng((5, 10)))
    rates = (road.curvature_at(30 + AHEAD_M) - road.curvature_at(30)) / AHEAD_M
    steps = np.diff(road.poses(np.linspace(30, 30 + AHEAD_M, 200))[:, 3])
    assert rates == pytest.approx(steps.sum() / AHEAD_M, abs=1e-12)


def test_no_line_is_left_in_blinding_light():
    renderer = Renderer(random_road(np.random.default_rng(0)), CAMERA, seed=0)
    for seed in range(12):
        image = renderer.render(0, 0, 0, t_s=seed, light=_blinding_light(np.random.default_rng(seed)))
        smooth = cv2.GaussianBlur(image[150:].astype(np.float32), (0, 0), 3)
        assert smooth.std() < 3


def test_a_small_share_of_the_frames_is_blind():
    lights = [_random_light(rng) for rng in map(np.random.default_rng, range(2000))]
    assert np.mean([not visible for _, visible in lights]) == pytest.approx(BLIND_SHARE, abs=0.015)
