"""`trepid estimate --fear`: the supervisor's view of footage that others drove."""

import json
import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from recorded_rig import record_drive

from perception.camera.odometry import StateOdometry
from sim_harness.footage.estimate_cli import estimate
from sim_harness.footage.fear_picture import with_lanes
from sim_harness.footage.frame_fear import given_motion
from sim_harness.footage.onlooker import GivenSpeed, Onlooker
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame

pytestmark = pytest.mark.long
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
SPEED_MPS, COUNT = 8.0, 75
FIELDS = {
    "file",
    "frame",
    "t_s",
    "fear",
    "level",
    "cause",
    "mode",
    "path_source",
    "sources",
    "trust",
    "estimates",
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Three seconds along a straight road, 25 images a second, named 0.png to 74.png."""
    road, out = load_road("straight"), tmp_path_factory.mktemp("straight")
    renderer = Renderer(road, CAMERA, seed=1)
    for number in range(COUNT):
        station_m = 20.0 + SPEED_MPS * number / 25
        x_m, y_m = road.position(station_m, 0.0)
        image = renderer.render(x_m, y_m, road.heading_at(station_m), station_m=station_m, t_s=number / 25)
        cv2.imwrite(str(out / f"{number}.png"), image)
    return out


def look(capsys, *inputs: Path, **options) -> list[dict]:
    options = {"camera": CONFIG_DIR / "camera.yaml", "speed": SPEED_MPS} | options
    estimate(list(inputs), fear=True, as_json=True, **options)
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]


def test_a_folder_driven_as_one_drive_is_left_to_the_car_when_the_driver_lets_go(folder, capsys):
    rows = look(capsys, folder, drive=True)
    assert [row["frame"] for row in rows] == list(range(COUNT))
    assert [Path(row["file"]).name for row in rows[:11]] == [f"{n}.png" for n in range(11)]
    assert rows[0]["mode"] == "STOP" and rows[0]["cause"] == "starting"
    assert rows[-1]["mode"] == "KEEP" and rows[-1]["fear"] < 0.1
    for row in rows:
        assert set(row) >= FIELDS
        assert set(row["estimates"]) == {"cv", "cnn"}
        assert len(row["sources"]) == len(row["trust"])
    assert rows[-1]["estimates"]["cnn"]["left_boundary_px"]
    assert rows[-1]["estimates"]["cnn"]["lane_width_m"] == pytest.approx(3.3, abs=0.6)


def test_the_lanes_of_both_estimators_are_drawn(folder):
    image = cv2.imread(str(folder / "30.png"))
    onlooker = Onlooker(
        CAMERA, VEHICLE, GivenSpeed(CAMERA, VEHICLE, lambda _: SPEED_MPS), cruise_speed_mps=None
    )
    seen = onlooker.step(Frame(t_s=0.0, image=image))
    both = with_lanes(image, seen)
    for name in ("cv", "cnn"):
        alone = with_lanes(image, replace(seen, estimates={name: seen.estimates[name]}))
        assert (alone != both).any(), f"{name} alone looks like both"
        assert (alone != with_lanes(image, replace(seen, estimates={}))).any()


def test_without_drive_each_image_of_a_folder_stands_alone(folder, tmp_path, capsys):
    for number in (3, 40):
        (tmp_path / f"{number}.png").write_bytes((folder / f"{number}.png").read_bytes())
    rows = look(capsys, tmp_path)
    assert [(row["frame"], row["t_s"], row["mode"]) for row in rows] == [(0, 0.0, "STOP")] * 2


def test_a_black_image_is_feared_more_than_the_road(folder, tmp_path, capsys):
    (tmp_path / "1.png").write_bytes((folder / "3.png").read_bytes())
    cv2.imwrite(str(tmp_path / "2.png"), np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8))
    road, black = look(capsys, tmp_path)
    assert black["fear"] > 0.8
    assert road["fear"] < 0.3


def test_a_recording_brings_its_own_speed_and_driver(tmp_path, capsys):
    scenario = load_scenario("straight", {"duration_s": "3"})
    path = tmp_path / "drive.mcap"
    record_drive(path, scenario, seed=1)
    rows = look(capsys, path, speed=None)
    assert len(rows) > 10
    assert rows[-1]["mode"] == "KEEP"
    assert all(b["t_s"] > a["t_s"] for a, b in pairwise(rows))


def test_the_film_is_written(folder, tmp_path, capsys):
    few = tmp_path / "few"
    few.mkdir()
    for number in range(5):
        (few / f"{number}.png").write_bytes((folder / f"{number}.png").read_bytes())
    look(capsys, few, drive=True, annotate=tmp_path / "film.mp4")
    film = cv2.VideoCapture(str(tmp_path / "film.mp4"))
    assert film.get(cv2.CAP_PROP_FRAME_COUNT) == 5
    film.release()


def test_the_yaw_rate_of_a_straight_drive_is_measured_as_nearly_zero(folder):
    state_of = GivenSpeed(CAMERA, VEHICLE, lambda _: SPEED_MPS)
    images = [cv2.imread(str(folder / f"{number}.png")) for number in range(20)]
    states = [state_of(Frame(t_s=number / 25, image=image)) for number, image in enumerate(images)]
    assert abs(states[-1].yaw_rate_radps) < math.radians(2.0)
    assert states[-1].road_wheel_angle_rad == pytest.approx(
        math.atan(VEHICLE.wheelbase_m * states[-1].yaw_rate_radps / SPEED_MPS)
    )


def test_an_image_without_anything_to_track_has_no_yaw_rate():
    state_of = GivenSpeed(CAMERA, VEHICLE, lambda _: SPEED_MPS)
    grey = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)
    state_of(Frame(t_s=0.0, image=grey))
    second = state_of(Frame(t_s=0.04, image=grey))
    assert second.yaw_rate_radps is None and second.road_wheel_angle_rad is None


def test_a_log_gives_speeds_and_yaw_rates_between_its_rows(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("t_s,speed_mps,yaw_rate_radps\n10,4,0.0\n11,6,0.2\n")
    motion = given_motion(None, log)
    assert motion.speed_mps_at(0.5) == pytest.approx(5.0)
    assert motion.yaw_radps_at(0.5) == pytest.approx(0.1)
    assert motion.top_mps == 6.0


@pytest.mark.parametrize(
    ("header", "odometry"),
    [("t_s,speed_mps,yaw_rate_radps", StateOdometry.WAY_AND_TURN), ("t_s,speed_mps", StateOdometry.WAY)],
)
def test_a_log_measures_the_camera_by_what_it_contains(tmp_path, header, odometry):
    """A yaw rate that is measured in the images says nothing about their lens."""
    log = tmp_path / "log.csv"
    cells = header.count(",") + 1
    rows = (",".join(row[:cells]) for row in (["10", "4", "0.0"], ["11", "6", "0.2"]))
    log.write_text("\n".join([header, *rows]))
    motion = given_motion(None, log)
    states = GivenSpeed(CAMERA, VEHICLE, motion.speed_mps_at, motion.yaw_radps_at, logged=motion.logged)
    assert states.odometry is odometry


def test_a_constant_speed_measures_no_camera():
    motion = given_motion(8.0, None)
    assert (
        GivenSpeed(CAMERA, VEHICLE, motion.speed_mps_at, logged=motion.logged).odometry is StateOdometry.NONE
    )


@pytest.mark.parametrize(("at_s", "known"), [(0.35, True), (1.1, False), (5.6, True), (600.0, False)])
def test_where_a_log_has_no_rows_the_motion_is_unknown(tmp_path, at_s, known):
    log = tmp_path / "log.csv"
    times = (*np.arange(10) / 10, *(5.0 + np.arange(6) / 10))
    rows = "".join(f"{t:.1f},10,0.1\n" for t in times)
    log.write_text(f"t_s,speed_mps,yaw_rate_radps\n{rows}")
    motion = given_motion(None, log)
    state = GivenSpeed(CAMERA, VEHICLE, motion.speed_mps_at, motion.yaw_radps_at)
    grey = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)
    state(Frame(t_s=100.0, image=grey))
    found = state(Frame(t_s=100.0 + at_s, image=grey))
    expected = (pytest.approx(10.0), pytest.approx(0.1)) if known else (None, None)
    assert (found.speed_mps, found.yaw_rate_radps) == expected
    assert (found.road_wheel_angle_rad is not None) is known


def test_two_frames_of_one_time_measure_no_yaw_rate(folder):
    state_of = GivenSpeed(CAMERA, VEHICLE, lambda _: SPEED_MPS)
    image = cv2.imread(str(folder / "0.png"))
    assert state_of(Frame(t_s=1.0, image=image)).yaw_rate_radps == 0.0
    assert state_of(Frame(t_s=1.0, image=image)).yaw_rate_radps is None


@pytest.mark.parametrize(
    ("speed_mps", "text", "reason"),
    [
        (5.0, "t_s,speed_mps\n0,1\n1,1\n", "--speed or --speeds"),
        (None, "t_s,speed_mps,yaw_rate_radps\n0,1,x\n", ":2:1: expected a yaw rate"),
        (None, "a,b\n", ":1:1: expected the columns"),
    ],
)
def test_a_bad_motion_is_refused_in_one_line(tmp_path, speed_mps, text, reason):
    log = tmp_path / "log.csv"
    log.write_text(text)
    with pytest.raises(InputError, match=reason):
        given_motion(speed_mps, log)


@pytest.mark.parametrize("options", [{"speed": 5.0}, {"speeds": Path("log.csv")}, {"fps": 10.0}])
def test_options_of_another_option_are_refused_without_it(folder, options):
    with pytest.raises(InputError, match=r"options? of --"):
        estimate([folder], **options)
