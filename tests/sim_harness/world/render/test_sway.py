"""The picture of a camera that pitches and rolls with its body: that of a camera mounted so."""

import cv2
import numpy as np
import pytest

from sim_harness.lockstep.camera import SimulatedCamera
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.plants.springs import LEVEL, Attitude
from sim_harness.world.render.optics.sway import Sway, road_from_body
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Light
from sim_harness.world.roads.disturbances import Disturbance
from tests.rigs.trace_rig import truth
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
ROAD = load_road("straight")
STILL = {"t_s": 1.0, "station_m": 40.0, "light": Light(noise=0)}


def frame(camera: Camera = CAMERA, **how: object) -> np.ndarray:
    renderer = Renderer(ROAD, camera, seed=3, on_springs="attitude" in how)
    return cv2.cvtColor(renderer.render(40.0, 0.2, 0.0, **STILL, **how), cv2.COLOR_BGR2GRAY).astype(float)


def likeness(one: np.ndarray, other: np.ndarray) -> float:
    blurred = (cv2.GaussianBlur(image, (0, 0), 1.5)[30:] for image in (one, other))
    return float(np.corrcoef(*(image.ravel() for image in blurred))[0, 1])


@pytest.mark.parametrize("pitch_rad", [-0.03, 0.04])
def test_a_pitching_camera_shows_what_one_mounted_at_that_pitch_shows(pitch_rad):
    mounted = CAMERA.model_copy(update={"pitch_down_rad": CAMERA.pitch_down_rad + pitch_rad})
    turned = frame(attitude=Attitude(pitch_rad=pitch_rad))
    assert likeness(turned, frame(mounted)) > 0.99
    assert likeness(turned, frame()) < 0.97


def test_the_rays_of_a_turned_camera_are_those_of_its_eye():
    sway, attitude = Sway(CAMERA), Attitude(pitch_rad=0.05, roll_rad=-0.08)
    picture = np.zeros((sway.eye.height_px, sway.eye.width_px), np.float32)
    place = np.array([20.0, 2.0, 0.5])  # from the lens, in the axes of the body
    on_eye = sway.eye.intrinsics @ sway.eye.optical_from_vehicle @ road_from_body(attitude) @ place
    column, row = np.rint(on_eye[:2] / on_eye[2]).astype(int)
    picture[row - 1 : row + 2, column - 1 : column + 2] = 1
    turned = sway.turn(picture, attitude)
    expected = CAMERA.intrinsics @ CAMERA.optical_from_vehicle @ place
    rows, columns = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    found = [(turned * of).sum() / turned.sum() for of in (columns, rows)]
    np.testing.assert_allclose(found, expected[:2] / expected[2], atol=0.6)


def test_a_camera_with_its_left_side_up_sees_the_left_of_the_horizon_lower():
    turned = frame(attitude=Attitude(roll_rad=0.08))
    steep = np.abs(np.diff(cv2.GaussianBlur(turned, (0, 0), 2), axis=0))[40:140]
    left, right = (int(np.argmax(steep[:, part].mean(axis=1))) for part in (np.s_[:40], np.s_[-40:]))
    assert left - right == pytest.approx(0.08 * (CAMERA.width_px - 40), abs=6)


@pytest.mark.parametrize("kind", ["rain", "night", "motion_blur"])
def test_disturbances_apply_to_a_camera_on_springs(kind):
    on = Renderer(ROAD, CAMERA, seed=3, disturbances=[Disturbance(kind=kind, grade=4)], on_springs=True)
    pictures = [on.render(40.0, 0.2, 0.0, **STILL, attitude=of) for of in (LEVEL, Attitude(0.05, 0.05))]
    assert pictures[0].shape == pictures[1].shape == (CAMERA.height_px, CAMERA.width_px, 3)
    assert (pictures[0] != pictures[1]).mean() > 0.3


class Recall:
    """A renderer that keeps the attitudes that it is given."""

    def __init__(self, road):
        self.road, self.seed, self.attitudes = road, 0, []

    def render(self, *_, attitude, **__):
        self.attitudes.append(attitude)
        return np.zeros((2, 2, 3), np.uint8)


def test_the_body_turns_by_the_forces_of_the_tyres_which_hold_the_weight_on_a_slope():
    slope = {"elevation": [{"at_m": 0, "grade": 0.1}], "bank": [{"at_m": 0, "bank_rad": 0.05}]}
    found = {}
    for name, road, accel_mps2 in (
        ("brakes", {}, -3.0),
        ("parked on a slope", slope, 0.0),
        ("rests", {}, 0.0),
    ):
        scenario = Scenario(
            description="", tags=("nominal",), road="straight", duration_s=1, plant={"springs": {}}, **road
        )
        recall = Recall(scenario.build_road())
        moving = truth(1.0, longitudinal_accel_mps2=accel_mps2, lateral_accel_mps2=0.0, station_m=20.0)
        SimulatedCamera(scenario, recall, wheelbase_m=2.5).step(moving, now_s=1.0)
        found[name] = recall.attitudes[0]
    assert found["rests"] == LEVEL
    assert found["brakes"].pitch_rad > 0.01
    assert found["parked on a slope"].pitch_rad < -0.003  # uphill the nose rises
    assert found["parked on a slope"].roll_rad > 0.003


HUMP_M, WHEELBASE_M = 20.0, 2.5


@pytest.fixture(scope="module")
def over_a_hump() -> dict[str, np.ndarray]:
    """Pitch of a camera [rad] on a stiff body and on springs, at every 0.1 m of the rear axle at 5 m/s."""
    found = {}
    for name, springs in (("stiff", None), ("on springs", {})):
        plant, humps = {"springs": springs}, ({"at_m": HUMP_M},)
        scenario = Scenario(
            description="", tags=("nominal",), road="straight", duration_s=9, plant=plant, humps=humps
        )
        recall = Recall(scenario.build_road())
        camera = SimulatedCamera(scenario, recall, wheelbase_m=WHEELBASE_M)
        for number in range(120):
            t_s, station_m = 0.02 * number, HUMP_M - WHEELBASE_M - 0.1 + 0.1 * number
            camera.step(
                truth(t_s, station_m=station_m, longitudinal_accel_mps2=0.0, lateral_accel_mps2=0.0),
                now_s=t_s,
            )
        found[name] = np.array([attitude.pitch_rad for attitude in recall.attitudes])
    return found


def test_over_a_hump_the_nose_rises_first_and_falls_by_as_much(over_a_hump):
    pitch_rad = over_a_hump["stiff"]
    assert np.flatnonzero(pitch_rad)[0] == np.flatnonzero(pitch_rad < 0)[0]
    assert pitch_rad.max() == pytest.approx(-pitch_rad.min(), rel=1e-3)
    assert -pitch_rad.min() == pytest.approx(
        0.1 / WHEELBASE_M, rel=0.1
    )  # nearly: L = 2.5 m on a hump of 3.7 m
    assert not pitch_rad[-40:].any()


def test_springs_swing_on_after_a_hump(over_a_hump):
    assert np.abs(over_a_hump["on springs"][-40:]).max() > 0.004
    assert np.corrcoef(over_a_hump["stiff"], over_a_hump["on springs"])[0, 1] > 0.5


def test_a_camera_of_a_road_with_humps_is_turned():
    road = Scenario(
        description="", tags=("nominal",), road="straight", duration_s=9, humps=({"at_m": HUMP_M},)
    ).build_road()
    renderer = Renderer(road, CAMERA, seed=3)
    level, up = (
        renderer.render(40.0, 0.2, 0.0, **STILL, attitude=Attitude(pitch_rad=of)) for of in (0.0, -0.04)
    )
    assert (level != up).mean() > 0.3
