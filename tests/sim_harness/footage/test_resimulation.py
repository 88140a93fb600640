"""Real footage as a simulator, checked on rendered footage with known laterally shifted views."""

import json
import math
import os
from dataclasses import replace
from functools import cache
from itertools import groupby
from pathlib import Path

import cv2
import numpy as np
import pytest
from recorded_rig import record_drive
from typer.testing import CliRunner

from cockpit.footage.sources import sources
from sim_harness.cli import app
from sim_harness.footage import visual_motion
from sim_harness.footage.cli import _one_line, assumed_camera
from sim_harness.footage.clip import ClipFrames, load_drive, read_log, recorded_speeds
from sim_harness.footage.reprojection import PoseChange, Reprojection
from sim_harness.footage.resimulation import Resimulation, resimulate
from sim_harness.footage.visual_motion import yaw_changes_rad
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.appearance import Light
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, ROOT, InputError, load
from trepid.messages import CompressedFrame, VehicleState
from trepid.recording.reader import read_recording
from trepid.recording.writer import Recording
from trepid.topics import CAMERA_COMPRESSED, SIM_TRUTH, VEHICLE_STATE
from trepid.wire import to_cdr

pytestmark = pytest.mark.long
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
VEHICLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
DATA = Path(os.environ.get("TREPID_DATA", ROOT.parent / "shared" / "data"))
REPROJECTION = Reprojection(CAMERA)
SHIFTS = [
    PoseChange(left_m=0.5),
    PoseChange(left_m=-0.5),
    PoseChange(yaw_rad=0.035),
    PoseChange(0.4, -0.3, -0.03),
]


def inverse(shift: PoseChange) -> PoseChange:
    """The pose of the recorded vehicle in the frame of the new one."""
    cos, sin = math.cos(shift.yaw_rad), math.sin(shift.yaw_rad)
    return PoseChange(
        -shift.ahead_m * cos - shift.left_m * sin, shift.ahead_m * sin - shift.left_m * cos, -shift.yaw_rad
    )


def clear(name: str) -> Road:
    """A road of config/ without sensor noise."""
    road = load_road(name).settings
    sections = tuple(s.model_copy(update={"light": Light(noise=0.0), "shadows": 0.0}) for s in road.sections)
    return Road(road.model_copy(update={"sections": sections}))


def photograph(renderer: Renderer, station_m: float, offset_m: float, heading_rad: float) -> np.ndarray:
    x_m, y_m = ROAD.position(station_m, offset_m)
    yaw_rad = ROAD.heading_at(station_m) + heading_rad
    return renderer.render(x_m, y_m, yaw_rad, station_m=station_m, t_s=0.0)


ROAD = clear("straight")
RENDERER = Renderer(ROAD, CAMERA, seed=1)
RECORDED = photograph(RENDERER, 30.0, 0.0, 0.0)
NEAR = slice(int(CAMERA.horizon_row_px) + 30, CAMERA.height_px)  # rows up to 15 m ahead


def texture() -> np.ndarray:
    """Smooth patches, so that half a pixel of interpolation does not count."""
    patches = np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8)
    return cv2.resize(patches, (CAMERA.width_px, CAMERA.height_px), interpolation=cv2.INTER_CUBIC)


@pytest.mark.parametrize("shift", SHIFTS)
def test_a_laterally_shifted_view_agrees_with_the_rendered_one(shift):
    truth = photograph(RENDERER, 30.0 + shift.ahead_m, shift.left_m, shift.yaw_rad)
    view, _ = REPROJECTION.view(RECORDED, shift)
    seen = REPROJECTION.view(np.full_like(RECORDED, 255), shift)[0]
    assert seen.min() == 255
    inner = np.s_[NEAR, 60:-60]
    error = view[inner].astype(float) - truth[inner].astype(float)
    still = RECORDED[inner].astype(float) - truth[inner].astype(float)
    assert psnr_db(error) > 26.0
    assert psnr_db(error) > psnr_db(still) + 6.0


def psnr_db(error: np.ndarray) -> float:
    return 20 * math.log10(255 / math.sqrt(float(np.mean(error**2))))


@pytest.mark.parametrize("shift", SHIFTS)
def test_the_edge_line_lies_within_a_pixel_of_where_the_renderer_paints_it(shift):
    truth = photograph(RENDERER, 30.0 + shift.ahead_m, shift.left_m, shift.yaw_rad)
    view, _ = REPROJECTION.view(RECORDED, shift)
    for row in range(NEAR.start + 5, NEAR.stop - 60, 5):
        there, here = (line_column_px(image[row]) for image in (truth, view))
        assert here == pytest.approx(there, abs=1.0)


def line_column_px(row: np.ndarray) -> float:
    """Centre of the brightest stripe in the right half: the solid edge line."""
    grey = row.astype(float).mean(axis=1)
    start = int(np.argmax(np.convolve(grey[160:], np.ones(3), "same"))) + 160
    window = np.arange(max(start - 8, 0), min(start + 9, len(grey)))
    weight = np.maximum(grey[window] - np.median(grey[160:]) - 25, 0)
    return float((window * weight).sum() / weight.sum())


def test_no_shift_is_the_identity():
    view, unseen = REPROJECTION.view(RECORDED, PoseChange())
    assert (view == RECORDED).all()
    assert unseen == 0.0
    np.testing.assert_allclose(REPROJECTION.ground_matrix(PoseChange()), np.eye(3), atol=1e-9)


@pytest.mark.parametrize("shift", SHIFTS)
def test_there_and_back_is_the_identity_where_the_picture_has_data(shift):
    image = texture()
    back, _ = REPROJECTION.view(REPROJECTION.view(image, shift)[0], inverse(shift))
    inner = np.s_[NEAR.start : -60, 70:-70]  # the bottom rows pass through pixels beyond the border
    assert np.abs(back[inner].astype(float) - image[inner]).mean() < 6.0
    np.testing.assert_allclose(shift.road_from_road @ inverse(shift).road_from_road, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("shift", SHIFTS)
def test_the_mirrored_shift_of_the_mirrored_picture_is_the_mirrored_view(shift):
    image = texture()
    centred = Reprojection(
        CAMERA.model_copy(update={"cx_px": (CAMERA.width_px - 1) / 2, "y_m": 0.0, "yaw_rad": 0.0})
    )
    view, unseen = centred.view(image, shift)
    mirrored, unseen_mirrored = centred.view(
        np.ascontiguousarray(image[:, ::-1]), PoseChange(shift.ahead_m, -shift.left_m, -shift.yaw_rad)
    )
    assert np.abs(mirrored[:, ::-1].astype(int) - view).mean() < 1.0
    assert unseen_mirrored == pytest.approx(unseen, abs=0.01)


def test_sky_and_ground_meet_on_the_horizon():
    shift = PoseChange(left_m=0.7, yaw_rad=0.1)
    horizon = np.array([200.0, CAMERA.horizon_row_px, 1.0])
    ground, sky = REPROJECTION.ground_matrix(shift) @ horizon, REPROJECTION.sky_matrix(shift) @ horizon
    np.testing.assert_allclose(ground[:2] / ground[2], sky[:2] / sky[2], atol=1e-6)


def test_pixels_without_data_are_counted():
    # A camera above the axle that points along the road only turns: columns are uncovered.
    level = CAMERA.model_copy(update={"x_m": 0.0, "y_m": 0.0, "yaw_rad": 0.0, "pitch_down_rad": 0.0})
    _, turned = Reprojection(level).view(RECORDED, PoseChange(yaw_rad=0.1))
    left_rad = math.atan(CAMERA.cx_px / CAMERA.fx_px)
    columns = CAMERA.fx_px * (math.tan(left_rad) - math.tan(left_rad - 0.1))
    assert columns / CAMERA.width_px < turned < columns / CAMERA.width_px + 0.03  # and corners


# The recorded car's own motion.

SPEED_MPS = 8.0


@pytest.fixture(scope="module", autouse=True)
def _tracks_each_pair_of_pictures_once():
    """Many drives share pictures, and the corners that are followed in them depend on no speed."""
    track, known = visual_motion._track, {}

    def track_once(before, after, camera):
        pair = (id(before), id(after), camera)
        if pair not in known:
            known[pair] = (before, after, track(before, after, camera))  # pictures that stay keep their ids
        return known[pair][-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(visual_motion, "_track", track_once)
        yield


@cache
def rendered_drive(name: str, station_m: float, count: int) -> ClipFrames:
    """A drive along the lane centre."""
    road = clear(name)
    renderer = Renderer(road, CAMERA, seed=2)
    frames, t_s = [], np.arange(count) / 25
    for t in t_s:
        station = station_m + SPEED_MPS * t
        x, y = road.position(station, 0.0)
        yaw = road.heading_at(station)
        frames.append(renderer.render(x, y, yaw, station_m=station, t_s=float(t)))
    return ClipFrames(name, frames, t_s, np.full(count, SPEED_MPS), CAMERA)


def test_the_yaw_of_a_car_is_measured_from_its_pictures():
    drive = rendered_drive("s_bend", 45.0, 60)
    road = load_road("s_bend")
    ends = [road.heading_at(45.0 + SPEED_MPS * drive.t_s[i]) for i in (0, -1)]
    assert yaw_changes_rad(drive.frames, CAMERA, np.diff(drive.station_m)).sum() == pytest.approx(
        ends[1] - ends[0], rel=0.1
    )


@pytest.mark.parametrize("turn_rad", [0.02, 0.06, -0.1])
def test_corners_that_stand_still_on_the_bonnet_do_not_hide_a_turn(turn_rad):
    rng = np.random.default_rng(0)
    depth_m = rng.uniform(4.0, 60.0, 80)
    down_m = np.where(rng.random(80) < 0.5, 1.2, rng.uniform(-6.0, 0.0, 80))  # ground, or above the horizon
    before = np.column_stack([rng.uniform(-0.8, 0.8, 80) * depth_m, down_m, depth_m])
    turn = cv2.Rodrigues(np.array([0.0, turn_rad, 0.0]))[
        0
    ]  # of the points to the right: of the car to the left
    after = (before - [0.0, 0.0, 0.5]) @ turn.T
    place, there = (points[:, :2] / points[:, 2:] for points in (before, after))
    bonnet = np.column_stack([rng.uniform(-0.6, 0.6, 10), rng.uniform(0.5, 0.7, 10)])
    corners = np.vstack([place, bonnet])
    motion = np.vstack([there - place, np.zeros((10, 2))]) + rng.normal(0.0, 3e-4, (90, 2))
    up, right = np.array([0.0, -1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    turning = (visual_motion._rotating(corners, axis) for axis in (up, right))
    found = visual_motion._turn(visual_motion._Track(corners, motion, *turning), 0.0, 0.0)
    assert found == pytest.approx(turn_rad, abs=0.002)


def test_pictures_without_features_to_track_are_refused_with_a_message():
    grey = [np.full((240, 320, 3), 90, np.uint8)] * 80
    drive = ClipFrames("grey", grey, np.arange(80) / 25, np.full(80, SPEED_MPS), CAMERA)
    with pytest.raises(InputError, match="grey: too few corners"):
        resimulate(drive, VEHICLE, start=PoseChange())


# Closed loop.


@pytest.mark.parametrize("left_m", [0.5, -0.5])
def test_the_car_returns_from_an_offset_to_the_recorded_path(left_m):
    drive = rendered_drive("straight", 20.0, 150)
    run = resimulate(drive, VEHICLE, start=PoseChange(left_m=left_m))
    assert run.offset_m[0] == pytest.approx(left_m, abs=0.01)
    assert run.row()["end_offset_m"] == pytest.approx(0.0, abs=0.1)
    assert run.interventions == 0
    assert run.autonomy_percent == 100.0


def test_two_estimators_confirm_each_other_and_a_single_one_is_never_calm():
    whole = rendered_drive("straight", 20.0, 150)
    drive = ClipFrames(whole.name, whole.frames[:90], whole.t_s[:90], whole.speed_mps[:90], CAMERA)
    supervised = resimulate(drive, VEHICLE, start=PoseChange())
    alone = resimulate(drive, VEHICLE, start=PoseChange(), estimators=["cv"])
    assert supervised.fear.max() < 0.1
    assert alone.fear.min() == pytest.approx(0.5)


def test_blots_of_a_slow_recording_are_no_dirt_on_the_lens():
    whole, rng = rendered_drive("straight", 20.0, 170), np.random.default_rng(0)
    frames = []
    for frame in whole.frames[::3]:  # as leaves and shadows, which are others in each picture
        blots = (rng.random((24, 32)) < 0.15).astype(np.uint8)
        dark = cv2.resize(blots, (CAMERA.width_px, CAMERA.height_px), interpolation=cv2.INTER_NEAREST)
        frames.append((frame * np.where(dark, 0.6, 1.0)[..., None]).astype(np.uint8))
    slow = np.full(len(frames), 2.0), CAMERA, np.zeros(len(frames))
    drive = ClipFrames(whole.name, frames, whole.t_s[::3], *slow)
    run = resimulate(drive, VEHICLE, start=PoseChange())
    assert not any("dirty" in cause for cause in run.causes)


def test_a_driver_takes_over_when_the_car_stops_and_hands_it_over_again_when_it_is_ready():
    whole = rendered_drive("straight", 20.0, 170)
    grey = np.full_like(whole.frames[0], 90)
    hidden = [grey if 3.0 < t_s < 3.8 else frame for t_s, frame in zip(whole.t_s, whole.frames, strict=True)]
    drive = ClipFrames(whole.name, hidden, whole.t_s, whole.speed_mps, CAMERA, np.zeros(170))
    run = resimulate(drive, VEHICLE, start=PoseChange())
    taken, stopped, again = run.t_s[1:][np.diff(run.engaged.astype(int)) != 0]
    assert taken == pytest.approx(2.2, abs=0.05)
    assert 3.0 < stopped < 3.8
    assert 3.8 + 2.0 < again < 3.8 + 2.2  # healthy for 2 s
    assert (run.stops, run.interventions) == (1, 0)
    waits = [cause for cause, _ in groupby(run.causes) if cause.startswith("starting")]
    assert waits[0] == "starting: ready; drives when the driver lets go"
    assert waits[-2:] == ["starting: takes over after", waits[0]]
    assert (
        "starting: no lane seen" in waits
        or "starting: waits for a lane with a confidence of at least" in waits
    )


def test_a_car_that_was_never_engaged_has_no_autonomy():
    still = np.zeros(3)
    never = np.zeros(3, bool)
    run = Resimulation(np.arange(3.0), still, still, still, still, np.full(3, 0.5), 0, never, ())
    row = run.row()
    assert (row["autonomy_percent"], row["engaged_percent"], row["mean_fear"]) == (None, 0.0, 0.5)
    assert (row["rms_offset_m"], row["stops"]) == (None, 0)
    line = _one_line({"clip": "clip", "return_s": None, **row})
    assert "engaged 0 %" in line and "autonomy none" in line and "fear 0.50 (at most 0.50)" in line


def test_the_same_run_twice_is_the_same_to_the_last_bit():
    whole = rendered_drive("straight", 20.0, 150)
    drive = ClipFrames(whole.name, whole.frames[:70], whole.t_s[:70], whole.speed_mps[:70], CAMERA)
    a, b = (resimulate(drive, VEHICLE, start=PoseChange(yaw_rad=0.02)) for _ in range(2))
    assert (a.offset_m == b.offset_m).all()
    assert a.row() == b.row()


def test_at_standstill_the_frames_of_that_time_are_shown(monkeypatch):
    whole, shown = rendered_drive("straight", 20.0, 150), []
    speeds = np.where(whole.t_s < 3.0, SPEED_MPS, 0.0)
    view = Reprojection.view

    def note_view(self, image, shift):
        shown.append(next(n for n, frame in enumerate(whole.frames) if frame is image))
        return view(self, image, shift)

    monkeypatch.setattr(Reprojection, "view", note_view)
    resimulate(ClipFrames(whole.name, whole.frames, whole.t_s, speeds, CAMERA), VEHICLE, start=PoseChange())
    assert shown == list(range(150))


# Bad input.


def test_a_log_of_speeds_is_read_from_either_kind(tmp_path):
    own, udacity = tmp_path / "own.csv", tmp_path / "udacity.csv"
    own.write_text("t_s,speed_mps,other\n0.0,3.0,x\n0.5,4.0,y\n")
    udacity.write_text(
        "center_2018_07_16_17_11_43_382.jpg,,,0,0,0,10\ncenter_2018_07_16_17_11_43_882.jpg,,,0,0,0,20\n"
    )
    assert [column.tolist() for column in read_log(own)] == [[0.0, 0.5], [3.0, 4.0]]
    times, speeds = read_log(udacity)
    assert times[1] - times[0] == pytest.approx(0.5)
    assert speeds == pytest.approx([4.4704, 8.9408])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", r"log\.csv: is empty"),
        ("a,b\n", ":1:1: expected the columns"),
        ("t_s,speed_mps\n0,x\n", ":2:1: expected a time and a speed"),
        ("t_s,speed_mps\n0,-1\n", ":2:1: expected a time and a speed"),
        ("t_s,speed_mps\n0\n", ":2:1: expected a time and a speed"),
        ("t_s,speed_mps\n0,1\n0,1\n", "time does not rise"),
        ("x.jpg,,,0,0,0,10\n", ":1:1: expected 7 columns"),
    ],
)
def test_a_bad_log_is_refused_with_its_line(text, reason, tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(InputError, match=reason):
        read_log(path)


def folder(tmp_path: Path, count: int) -> Path:
    for number in range(count):
        cv2.imwrite(str(tmp_path / f"{number:03}.png"), RECORDED)
    return tmp_path


def test_a_clip_that_is_too_short_or_longer_than_its_log_is_refused(tmp_path):
    clip = folder(tmp_path, 6)
    log = tmp_path / "log.csv"
    log.write_text("t_s,speed_mps\n0,1\n1,1\n")
    with pytest.raises(InputError, match="3 frames from number 3 on"):
        load_drive(clip, CAMERA, speed_mps=5.0, skip=3)
    with pytest.raises(InputError, match=r"has 2 rows, but .* has 6 frames"):
        load_drive(clip, CAMERA, log=log)
    with pytest.raises(InputError, match=r"6 frames last 0\.2 s"):
        resimulate(load_drive(clip, CAMERA, speed_mps=5.0), VEHICLE, start=PoseChange())


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ([], "give --speed"),
        (["--speed", "5", "--estimator", "x"], "no estimator 'x'"),
        (["--speed", "5", "--scale", "3"], "--scale: is a factor of the speed of --log"),
        (["--speed", "5", "--camera", "no.yaml"], "no.yaml: cannot be read"),
        (["--speed", "5"], "no such file or folder"),
    ],
)
def test_odd_arguments_are_refused(arguments, reason, tmp_path):
    result = CliRunner().invoke(app, ["resimulate", str(tmp_path / "no.mp4"), *arguments])
    assert isinstance(result.exception, InputError)
    assert reason in str(result.exception)


@pytest.fixture(scope="module")
def highway() -> ClipFrames:
    """A real clip, at 1 m/s; skips where it is not on this machine."""
    clip = DATA / "highway_udacity_p1" / "solidWhiteRight.mp4"
    if not clip.is_file():
        pytest.skip("the clip solidWhiteRight.mp4 is not on this machine (TREPID_DATA)")
    return load_drive(clip, assumed_camera(sources(clip)[0]), speed_mps=1.0)


def test_on_a_real_highway_the_car_leaves_an_offset_to_the_recorded_path(highway):
    at_speed = np.full(105, 25.0)
    drive = ClipFrames(highway.name, highway.frames[:105], highway.t_s[:105], at_speed, highway.camera)
    run = resimulate(drive, VEHICLE, start=PoseChange(left_m=0.5))
    assert abs(run.offset_m[-1]) < 0.2
    assert run.interventions == 0


@pytest.mark.parametrize("speed_mps", [8.0, 33.0])
def test_on_a_real_highway_the_supervised_car_takes_over_at_once_and_fear_stays_low(speed_mps, highway):
    drive = replace(highway, speed_mps=np.full_like(highway.speed_mps, speed_mps))
    run = resimulate(drive, VEHICLE, start=PoseChange(), assumed=True)
    assert run.fear.mean() <= 0.1
    assert run.engaged_share > 0.98
    assert run.interventions == 0


def test_a_recording_brings_speed_camera_and_images(tmp_path):
    scenario = load_scenario("straight", {"duration_s": "4"})
    path = tmp_path / "drive.mcap"
    record_drive(path, scenario, seed=1)
    drive = load_drive(path, CAMERA)
    truth = read_recording(path, SIM_TRUTH.key).of(SIM_TRUTH)
    at_s = [at_s - truth[0][0] for at_s, _ in truth]
    driven = np.interp(drive.t_s + 0.0, at_s, [one.speed_mps for _, one in truth])
    assert np.abs(drive.speed_mps - driven).max() < 0.5
    result = CliRunner().invoke(app, ["resimulate", str(path), "--offset", "0.0", "--json"])
    assert result.exit_code == 0, result.output
    assert "assumed camera" not in result.stderr
    assert json.loads(result.stdout.splitlines()[0])["interventions"] == 0


def with_states(path: Path, *at_s: float) -> Path:
    """A recording with 60 frames from 1.05 s on, 20 a second, and the speed t at each time t of ``at_s``."""
    jpeg = bytes(cv2.imencode(".jpg", RECORDED)[1])
    with Recording(path) as file:
        for t_s in at_s:
            state = VehicleState(
                t_s=t_s, speed_mps=t_s, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
            )
            file.add(VEHICLE_STATE.key, to_cdr(state), at_s=t_s)
        for t_s in np.arange(1.05, 4.04, 0.05).tolist():
            file.add(CAMERA_COMPRESSED.key, to_cdr(CompressedFrame(t_s=t_s, jpeg=jpeg)), at_s=t_s)
    return path


def test_no_speed_is_made_up_in_a_silence_of_the_vehicle(tmp_path):
    around = [*np.arange(1.0, 2.01, 0.1), *np.arange(3.0, 4.11, 0.1)]
    path = with_states(tmp_path / "drive.mcap", *around)
    speeds = recorded_speeds(path, np.array([0.5, 1.55, 2.2, 2.8, 3.55, 4.6]))
    assert np.isnan(speeds).tolist() == [True, False, True, True, False, True]
    assert speeds[[1, 4]] == pytest.approx([1.55, 3.55])
    with pytest.raises(InputError, match=r"no speed of the vehicle for 1\.\d s after frame 1\d: .*--skip"):
        load_drive(path, CAMERA)
    assert np.isfinite(load_drive(path, CAMERA, skip=40).station_m).all()


def test_frames_before_the_first_speed_and_after_the_last_are_left_out_and_counted(tmp_path, capsys):
    drive = load_drive(with_states(tmp_path / "drive.mcap", *np.arange(2.02, 3.03, 0.1)), CAMERA)
    assert (len(drive.frames), len(drive.t_s), drive.t_s[0]) == (20, 20, 0.0)
    assert drive.speed_mps == pytest.approx(drive.t_s + drive.speed_mps[0])
    assert "40 frames at the ends have no speed and are left out" in capsys.readouterr().err


def test_a_recording_without_a_speed_is_refused_in_one_line(tmp_path):
    path = tmp_path / "drive.mcap"
    with Recording(path) as file:
        jpeg = bytes(cv2.imencode(".jpg", RECORDED)[1])
        for number in range(6):
            file.add(
                CAMERA_COMPRESSED.key, to_cdr(CompressedFrame(t_s=1.0 + number, jpeg=jpeg)), at_s=1.0 + number
            )
    with pytest.raises(InputError, match="states no speed of the vehicle: give --speed or --log"):
        load_drive(path, CAMERA)
