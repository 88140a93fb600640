"""The renderer: geometry against the camera model, determinism, light."""

import math

import cv2
import numpy as np
import pytest

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Light, Marking, Section, Stroke, Verge
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
WIDTH_M = 3.4
PLAIN = Light(noise=0)
SOLID = Section(
    name="solid", start_m=0, left=Marking(), right=Marking(), paved_left_m=1, paved_right_m=1, patchiness=0
)


def bend(curvature_1pm: float, *, closed: bool = True, section: Section = SOLID) -> Road:
    """A circle (or a straight), so that the whole view has one curvature."""
    length_m = 2 * math.pi / abs(curvature_1pm) if curvature_1pm else 200
    segments = (Segment(length_m=length_m, curvature_1pm=curvature_1pm),)
    return Road(
        RoadSettings(name="bend", closed=closed, lane_width_m=WIDTH_M, segments=segments, sections=(section,))
    )


STRAIGHT = bend(0.0, closed=False)
CIRCUIT = load_road("circuit")
ON_STRAIGHT, ON_CIRCUIT = (Renderer(road, CAMERA, seed=7) for road in (STRAIGHT, CIRCUIT))


def frame(renderer: Renderer, station_m: float, offset_m: float = 0.0, *, turn_rad: float = 0.0, **how):
    x_m, y_m = renderer.road.position(station_m, offset_m)
    heading = renderer.road.heading_at(station_m) + turn_rad
    return renderer.render(x_m, y_m, heading, **({"t_s": 0.0, "station_m": station_m} | how))


def brightest_column(row: np.ndarray, expected: float, reach: int) -> float:
    """Centre of brightness, to a part of a pixel, near an expected column."""
    columns = np.arange(round(expected) - reach, round(expected) + reach + 1)
    excess = row[columns].astype(float) - np.median(row[columns])
    weight = np.where(excess > 0.5 * excess.max(), excess, 0)
    return float((columns * weight).sum() / weight.sum())


@pytest.mark.parametrize("curvature_1pm", [0.0, 1 / 15, -1 / 30])
@pytest.mark.parametrize("place", [-0.5, 0.5], ids=["right", "left"])
def test_a_painted_line_appears_where_the_camera_model_puts_it(curvature_1pm, place):
    road = bend(curvature_1pm, closed=curvature_1pm != 0)
    grey = cv2.cvtColor(frame(Renderer(road, CAMERA, seed=1), 60.0, 0.4, light=PLAIN), cv2.COLOR_BGR2GRAY)
    x0, y0 = road.position(60.0, 0.4)
    heading = road.heading_at(60.0)
    world = road.positions(np.arange(62.5, 75, 0.05), place * WIDTH_M) - (x0, y0)
    turn = np.array([[math.cos(heading), math.sin(heading)], [-math.sin(heading), math.cos(heading)]])
    pixels = CAMERA.pixel_from_road(world @ turn.T)
    errors_px = []
    for row in range(115, 235, 5):
        nearest = np.argmin(np.abs(pixels[:, 1] - row))
        column = pixels[nearest, 0]
        if abs(pixels[nearest, 1] - row) < 0.5 and 20 < column < 300:
            errors_px.append(brightest_column(grey[row], column, 12) - column)
    assert len(errors_px) >= 5
    assert np.abs(errors_px).max() < 1.2 and abs(np.mean(errors_px)) < 0.25


def test_a_dash_has_the_length_and_a_line_the_width_of_its_marking():
    dashed = Marking(stroke=Stroke.DASHED, dash_m=3, gap_m=6, width_m=0.15)
    road = bend(0.0, closed=False, section=SOLID.model_copy(update={"left": dashed}))
    image, _, y_m = Ground(road, seed=0).crop(0, np.array([0, -2.5]), np.array([45, 2.5]))
    bright = image[:, :, :3].min(axis=2) > 165
    left = bright[round((WIDTH_M / 2 - y_m) / 0.025)]
    assert left.mean() == pytest.approx(1 / 3, abs=0.02)
    runs = np.diff(np.flatnonzero(np.diff(left.astype(int)))) * 0.025
    assert runs == pytest.approx(np.resize([6, 3], len(runs)), abs=0.06) or runs == pytest.approx(
        np.resize([3, 6], len(runs)), abs=0.06
    )
    width_m = bright[: image.shape[0] // 2].sum(axis=0).mean() * 0.025
    assert width_m == pytest.approx(0.12, abs=0.02)


def test_without_markings_the_carriageway_ends_at_the_lane():
    none = Marking(stroke=Stroke.NONE)
    section = Section(
        name="bare",
        start_m=0,
        left=none,
        right=none,
        paved_left_m=0,
        paved_right_m=0,
        edge_roughness_m=0,
        verge=Verge.SNOW,
    )
    road = bend(0.0, closed=False, section=section)
    image, _, y_m = Ground(road, seed=0).crop(0, np.array([0, -4.0]), np.array([20, 4.0]))
    dark = (image[:, :, :3].mean(axis=2) < 165).mean(axis=1) > 0.5
    rows = np.flatnonzero(dark)
    edges = y_m + 0.025 * rows[[0, -1]]
    assert edges == pytest.approx([-WIDTH_M / 2, WIDTH_M / 2], abs=0.06)


def test_a_mirrored_bend_gives_a_mirrored_image():
    left = frame(Renderer(bend(1 / 20), CAMERA, seed=1), 30.0, 0.5, turn_rad=0.1, light=PLAIN)
    right = frame(Renderer(bend(-1 / 20), CAMERA, seed=1), 30.0, -0.5, turn_rad=-0.1, light=PLAIN)
    direct, mirrored = (im[100:].min(axis=2) > 165 for im in (left[:, 1:], right[:, :0:-1]))
    grown = [cv2.dilate(mask.astype(np.uint8), np.ones((5, 5))) > 0 for mask in (direct, mirrored)]
    assert (direct & grown[1]).sum() > 0.95 * direct.sum() > 100
    assert (mirrored & grown[0]).sum() > 0.95 * mirrored.sum()


def test_equal_seed_pose_and_time_give_equal_bytes_in_any_order():
    one, other = ON_CIRCUIT, Renderer(CIRCUIT, CAMERA, seed=7)
    frame(other, 700.0, t_s=3.0)
    stations = (20.0, 420.0, 760.0)
    assert all(np.array_equal(frame(one, s, t_s=s / 5), frame(other, s, t_s=s / 5)) for s in stations)


def test_tiles_that_are_dropped_and_repainted_give_the_same_image(monkeypatch):
    expected = frame(ON_STRAIGHT, 60.0)
    monkeypatch.setattr("sim_harness.world.render.ground.ground.MAX_TILES", (4, 4, 4, 4, 12))
    monkeypatch.setattr("sim_harness.world.render.ground.ground.MOSAICS", 1)
    monkeypatch.setattr("sim_harness.world.render.ground.road_strip.MAX_FINEST", 4)
    renderer = Renderer(STRAIGHT, CAMERA, seed=7)
    frame(renderer, 60.0), frame(renderer, 140.0)
    assert np.array_equal(frame(renderer, 60.0), expected)


def test_the_seed_changes_the_image_and_the_time_changes_the_noise():
    one, other = ON_STRAIGHT, Renderer(STRAIGHT, CAMERA, seed=8)
    assert not np.array_equal(frame(one, 20.0, light=PLAIN), frame(other, 20.0, light=PLAIN))
    assert np.array_equal(frame(one, 20.0, light=PLAIN), frame(one, 20.0, light=PLAIN, t_s=1.0))
    assert not np.array_equal(frame(one, 20.0), frame(one, 20.0, t_s=1.0))


def test_glare_and_darkness_change_the_exposure():
    renderer = ON_CIRCUIT
    over_exposed = {s: (frame(renderer, s).min(axis=2) >= 250).mean() for s in (60.0, 770.0)}
    assert over_exposed[770.0] > over_exposed[60.0] + 0.1
    night = frame(renderer, 60.0, light=Light(gain=0.1))
    assert night.mean() < 0.25 * frame(renderer, 60.0).mean()


def test_haze_and_blur_reduce_contrast():
    renderer = ON_STRAIGHT
    clear = frame(renderer, 20.0, light=PLAIN)
    hazy = frame(renderer, 20.0, light=Light(noise=0, haze=0.5))
    blurred = frame(renderer, 20.0, light=Light(noise=0, blur_px=2))
    assert hazy.std() == pytest.approx(0.5 * clear.std(), rel=0.05)
    assert cv2.Laplacian(blurred, cv2.CV_64F).var() < 0.2 * cv2.Laplacian(clear, cv2.CV_64F).var()


@pytest.mark.parametrize("gap_m", [6.0, 15.0, 30.0])
def test_a_lead_vehicle_is_as_wide_as_a_car_at_its_distance(gap_m):
    renderer = ON_STRAIGHT
    rear_axle_m = 20.0 + CAMERA.x_m + gap_m + 0.85
    without = frame(renderer, 20.0, light=PLAIN)
    with_lead = frame(renderer, 20.0, light=PLAIN, lead=(rear_axle_m, 0.0, 0.0))
    changed = np.abs(with_lead.astype(int) - without).max(axis=2) > 25
    body = changed[: round(CAMERA.horizon_row_px + 0.8 * CAMERA.fy_px / gap_m)]
    depth_m = gap_m * math.cos(CAMERA.pitch_down_rad)
    assert body.any(axis=0).sum() == pytest.approx(CAMERA.fx_px * 1.78 / depth_m, rel=0.12, abs=2)
    assert np.flatnonzero(changed.any(axis=0)).mean() == pytest.approx(CAMERA.cx_px, abs=1.5)


def test_a_vehicle_behind_is_not_drawn():
    renderer = ON_STRAIGHT
    assert np.array_equal(frame(renderer, 20.0), frame(renderer, 20.0, lead=(10.0, 0.0, 0.0)))


def test_a_camera_that_looks_down_fills_its_image_with_ground():
    camera = CAMERA.model_copy(update={"pitch_down_rad": 0.9})
    assert frame(Renderer(STRAIGHT, camera, seed=1), 20.0).std() > 5


def test_a_distortion_that_is_not_one_to_one_is_refused():
    with pytest.raises(ValueError, match="one to one"):
        Renderer(STRAIGHT, CAMERA.model_copy(update={"distortion": (-2.0, 0.0)}), seed=1)


def test_a_distorted_line_appears_where_opencv_puts_it():
    camera = CAMERA.model_copy(update={"distortion": (-0.25, 0.06, 0.002, -0.001, -0.004)})
    grey = cv2.cvtColor(frame(Renderer(STRAIGHT, camera, seed=1), 60.0, 0.4, light=PLAIN), cv2.COLOR_BGR2GRAY)
    ahead_m = np.arange(2.8, 14, 0.02)
    points = np.column_stack([ahead_m, np.full_like(ahead_m, -WIDTH_M / 2 - 0.4)])
    rays = np.linalg.solve(
        CAMERA.intrinsics, np.column_stack([CAMERA.pixel_from_road(points), np.ones(len(points))]).T
    )
    seen, _ = cv2.projectPoints(
        rays.T[:, None], np.zeros(3), np.zeros(3), camera.intrinsics, np.array(camera.distortion)
    )
    errors_px = []
    for row in range(110, 235, 5):
        nearest = np.argmin(np.abs(seen[:, 0, 1] - row))
        column = seen[nearest, 0, 0]
        if abs(seen[nearest, 0, 1] - row) < 0.5 and 20 < column < 300:
            errors_px.append(brightest_column(grey[row], column, 12) - column)
    assert len(errors_px) >= 5
    assert np.abs(errors_px).max() < 1.2 and abs(np.mean(errors_px)) < 0.25


def test_a_lens_without_distortion_renders_as_the_pinhole():
    camera = CAMERA.model_copy(update={"distortion": (1e-9,)})
    bent = frame(Renderer(STRAIGHT, camera, seed=7), 20.0, light=PLAIN).astype(int)
    assert np.abs(bent - frame(ON_STRAIGHT, 20.0, light=PLAIN))[:, 1:-1].mean() < 1.0
