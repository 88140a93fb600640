"""Disturbed images: no effect at grade 0, stronger with every grade, deterministic, by physical laws."""

from itertools import pairwise

import cv2
import numpy as np
import pytest

from sim_harness.world.render.ground.ground import Ground
from sim_harness.world.render.renderer import Renderer, ShutterMotion
from sim_harness.world.render.scene.standing import standing
from sim_harness.world.roads.appearance import Light, Marking, Section
from sim_harness.world.roads.disturbance_table import at, extinction_1pm, load_table
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
TABLE = load_table()
WIDTH_M = 3.4
PLAIN = Light(noise=0)
SECTION = Section(name="solid", start_m=0, left=Marking(), paved_left_m=1, paved_right_m=1, patchiness=0)
ROAD = Road(
    RoadSettings(
        name="straight",
        closed=False,
        lane_width_m=WIDTH_M,
        segments=(Segment(length_m=200),),
        sections=(SECTION,),
    )
)
GROUND = Ground(ROAD, seed=3)
STATION_M = 60.0
DRIVING = ShutterMotion(speed_mps=8.0, yaw_rate_radps=0.2)


def renderer(*disturbances: Disturbance, camera: Camera = CAMERA, seed: int = 3) -> Renderer:
    """Rendered on shared ground, without the disturbances that are painted on it."""
    return Renderer(ROAD, camera, seed=seed, ground=GROUND, disturbances=disturbances)


def frame(*disturbances: Disturbance, station_m: float = STATION_M, **how):
    return shot(renderer(*disturbances), station_m, **how)


def shot(camera: Renderer, station_m: float = STATION_M, **how):
    pose = (station_m, 0.0, 0.0)
    return camera.render(
        *pose, **({"t_s": 1.0, "station_m": station_m, "motion": DRIVING, "light": PLAIN} | how)
    )


def of(kind: str, grade: float, **where) -> Disturbance:
    return Disturbance(kind=kind, grade=grade, **where)


def marking(image: np.ndarray, ahead_m: float) -> float:
    """Michelson contrast of the right line against the adjacent lane surface at that distance."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(float)
    (u, v), (inner, _) = CAMERA.pixel_from_road([(ahead_m, -WIDTH_M / 2), (ahead_m, -WIDTH_M / 2 + 0.5)])
    row = grey[round(v) - 1 : round(v) + 2].mean(axis=0)
    line = row[round(u) - 1 : round(u) + 2].max()
    lane = row[round(inner) - 2 : round(inner) + 3].mean()
    return float((line - lane) / (line + lane + 1e-9))


def sharpness(image: np.ndarray) -> float:
    return float(cv2.Laplacian(image[130:], cv2.CV_64F).var())


CLEAR = frame()
EFFECTS = {  # each falls with every grade
    "night": lambda image: float(image[100:120].mean()),
    "low_sun": lambda image: marking(image, 12.0),
    "glare": lambda image: marking(image, 12.0),
    "over_exposure": lambda image: -float((image >= 250).mean()),
    "tunnel_exit": lambda image: float(image[200:].mean()),
    "rain": lambda image: float(np.corrcoef(image.ravel(), CLEAR.ravel())[0, 1]),
    "wet_road": lambda image: -float(np.abs(image.astype(int) - CLEAR)[100:].mean()),
    "snow": lambda image: marking(image, 25.0),
    "fog": lambda image: marking(image, 15.0),
    "dirt": lambda image: float(np.corrcoef(image.ravel(), CLEAR.ravel())[0, 1]),
    "motion_blur": sharpness,
    "rolling_shutter": lambda image: -float(np.abs(image.astype(int) - CLEAR)[130:].mean()),
    "noise": lambda image: -float(np.abs(image.astype(int) - CLEAR).mean()),
    "jpeg": lambda image: -float(np.abs(image.astype(int) - CLEAR).mean()),
}


def test_grade_0_changes_no_byte():
    for kind in DisturbanceKind:
        assert np.array_equal(frame(of(kind, 0)), CLEAR), kind


@pytest.mark.parametrize("kind", EFFECTS)
def test_every_grade_changes_the_image_more_than_the_previous_one(kind):
    tunnel = {"to_m": STATION_M + 35} if kind == "tunnel_exit" else {}
    effects = [EFFECTS[kind](frame(of(kind, grade, **tunnel))) for grade in (1, 2, 3, 4, 5)]
    effects = [EFFECTS[kind](CLEAR), *effects]
    assert all(worse < better for better, worse in pairwise(effects)), effects


def test_painted_kinds_have_no_effect_on_shared_ground():
    for kind in ("tree_shadows", "building_shadows", "bridge_shadows"):
        assert np.array_equal(frame(of(kind, 5)), CLEAR)


ALL = [of(kind, 3) for kind in DisturbanceKind if kind != "tunnel_exit"]


def test_equal_seed_pose_and_time_give_equal_bytes_in_any_order():
    one, other = renderer(*ALL), renderer(*ALL)
    times = (0.0, 2.0, 7.3)
    forwards = [shot(one, t_s=t) for t in times]
    backwards = [shot(other, t_s=t) for t in reversed(times)]
    assert all(np.array_equal(a, b) for a, b in zip(forwards, reversed(backwards), strict=True))
    assert not np.array_equal(forwards[0], forwards[1])


def test_the_seed_changes_drops_flakes_dirt_and_vehicles():
    for kind in ("rain", "snow", "dirt", "noise", "occlusion"):
        one, other = (shot(renderer(of(kind, 4), seed=seed)) for seed in (3, 4))
        plain = shot(renderer(seed=4))
        assert not np.array_equal(one.astype(int) - CLEAR, other.astype(int) - plain), kind


def test_a_disturbance_has_no_effect_outside_its_stretch():
    stretch = of("fog", 5, from_m=80, to_m=120)
    assert np.array_equal(frame(stretch, station_m=70.0), frame(station_m=70.0))
    assert np.array_equal(frame(stretch, station_m=121.0), frame(station_m=121.0))
    assert marking(frame(stretch, station_m=100.0), 12.0) < 0.5 * marking(frame(station_m=100.0), 12.0)


def test_fog_follows_koschmieders_law():
    for grade in (2, 5):
        foggy = frame(of("fog", grade)).astype(float)
        clear = CLEAR.astype(float)
        beta_1pm = extinction_1pm(TABLE.fog.visibility_m, grade)
        air = (foggy[75, 160] / 255) ** 2  # the sky has the colour of the fog
        for ahead_m in (6.0, 12.0, 25.0):
            u, v = CAMERA.pixel_from_road([(ahead_m, 0.0)])[0]
            row, column = round(v), round(u)
            ray = CAMERA.road_from_pixel([(column, row)])[0]
            distance_m = np.hypot(ray[0] - CAMERA.x_m, CAMERA.height_m)
            passed = np.exp(-beta_1pm * distance_m)
            expected = (clear[row, column] / 255) ** 2 * passed + air * (1 - passed)
            assert foggy[row, column] == pytest.approx(
                255 * np.sqrt(expected), abs=4
            )  # the vignette differs a little


def test_the_contrast_of_black_falls_to_5_percent_at_the_visibility():
    for grade in (1, 3, 5):
        visibility_m = at(TABLE.fog.visibility_m, grade)
        assert np.exp(-extinction_1pm(TABLE.fog.visibility_m, grade) * visibility_m) == pytest.approx(
            0.05, abs=0.001
        )


def test_by_night_the_road_is_lit_near_and_dark_far_and_to_the_sides():
    night = frame(of("night", 4)).mean(axis=2)
    rows = [round(CAMERA.pixel_from_road([(d, 0.0)])[0, 1]) for d in (8.0, 16.0, 32.0, 60.0)]
    ahead = [night[row - 1 : row + 2, 150:170].mean() for row in rows]
    assert all(far < near for near, far in pairwise(ahead[1:]))
    assert ahead[1] > 4 * night[:60].mean()
    assert night[105:110, :20].mean() < 0.6 * night[105:110, 150:170].mean()


def test_the_low_sun_dazzles_only_when_driving_towards_it():
    low = of("low_sun", 5)
    towards = frame(low)
    away = renderer(low).render(STATION_M, 0.0, np.pi, t_s=1.0, station_m=STATION_M, light=PLAIN)
    assert (towards >= 250).mean() > 0.02
    assert (away >= 250).mean() < 0.001


def test_a_tunnel_is_dark_and_its_exit_is_over_exposed():
    tunnel = of("tunnel_exit", 4, to_m=STATION_M + 20)
    inside = frame(tunnel)
    assert inside[150:, 100:220].mean() < 0.9 * CLEAR[150:, 100:220].mean()
    assert (inside[70:85, 150:170] >= 250).mean() > 0.8
    behind = [frame(tunnel, station_m=STATION_M + 20 + m).mean() for m in (0.5, 5.0, 15.0, 60.0)]
    assert all(later < sooner for sooner, later in pairwise(behind))
    assert behind[-1] == pytest.approx(frame(station_m=STATION_M + 80).mean(), rel=0.03)


def test_a_wet_road_mirrors_the_vehicle_ahead():
    lead = (STATION_M + 14, 0.0, 0.0)
    wet, dry = (frame(*d, lead=lead).astype(int) for d in ((of("wet_road", 5),), ()))
    without = frame(of("wet_road", 5)).astype(int)
    below = slice(132, 145)  # nearer than its contact shadow
    assert np.abs(dry - CLEAR)[below, 150:170].mean() < 2
    assert np.abs(wet - without)[below, 150:170].mean() > 4


def test_every_grade_adds_standing_vehicles_and_moves_them_inwards():
    half_m = WIDTH_M / 2
    crowds = [standing(ROAD, of("occlusion", grade), TABLE.occlusion, seed=3) for grade in (1, 2, 3, 4, 5)]
    assert all(len(more) > len(fewer) > 0 for fewer, more in pairwise(crowds))
    over_m = [max(half_m - abs(y) + body.width_m / 2 for (_, y, _), body in crowd) for crowd in crowds]
    assert all(more > less > 0 for less, more in pairwise(over_m)) and over_m[-1] <= 0.41
    hidden = [
        marking(frame(of("occlusion", 5), station_m=s), 6.0) < 0.5 * marking(frame(), 6.0)
        for s in range(20, 160, 7)
    ]
    assert 0.1 < np.mean(hidden) < 0.9


def test_a_distorted_camera_renders_all_disturbances():
    camera = CAMERA.model_copy(update={"distortion": (-0.2, 0.03)})
    image = shot(renderer(*ALL, camera=camera))
    assert image.shape == CLEAR.shape and image.std() > 5
