"""The bench of lane estimators: its set, its truth, its scores, and its stored results."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drive.tally import INTERVENTION_S
from lab.bench.perception import bench, drive
from lab.bench.perception.bench import bench_perception, watch_clips
from lab.bench.perception.clips import CLEAR, GAP, GRADES, ClipCase, ClipFrame, harness_set, moments
from lab.bench.perception.report import write
from lab.bench.perception.scores import figures, gap_figures, groups, one_line_figures
from lab.bench.perception.store import ClipStore, StoredFrames
from lab.bench.perception.watch import LOOK, TRUTH, WatchedClip, _TrueRoad, aim, look
from perception.estimators import estimators
from sim_harness.sweep.fingerprint import estimator_fingerprint, hash_of_files, import_closure
from sim_harness.sweep.store import Store
from sim_harness.world.roads.disturbances import DisturbanceKind
from sim_harness.world.roads.drawn import BendShape, MarkingKind, random_road
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import PixelPath, SteeringEstimate

CAMERA, VEHICLE = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
CASE = ClipCase(seed=1, number=0, condition=CLEAR, grade=0, kind=MarkingKind.YELLOW, shape=BendShape.TIGHT)


@pytest.fixture(scope="module")
def clip() -> list[ClipFrame]:
    return list(moments(CASE, CAMERA, VEHICLE))


def looks(frames: int = 20, **fields: float | Sequence[float]) -> np.ndarray:
    """Rows without any error, except for ``fields``."""
    rows = np.zeros(frames, LOOK)
    rows["confidence"] = 1.0
    for name, value in fields.items():
        rows[name] = value
    return rows


def test_the_set_has_every_road_in_every_shape_and_every_grade_of_every_disturbance() -> None:
    cases = harness_set(3)
    assert {(case.kind, case.shape) for case in cases if case.condition == CLEAR} == {
        (kind, shape) for kind in MarkingKind for shape in BendShape
    }
    assert {(case.condition, case.grade) for case in cases if case.grade} == {
        (kind.value, grade) for kind in DisturbanceKind for grade in GRADES
    }
    assert any(case.condition == GAP for case in cases)
    assert replace(cases[0], snow_cover=0.5).key != cases[0].key
    assert len({case.key for case in cases}) == len(cases)


def test_a_seed_is_a_set_and_the_quick_one_is_smaller() -> None:
    assert harness_set(3) == harness_set(3) != harness_set(4)
    assert len(harness_set(3, quick=True)) < len(harness_set(3)) < len(harness_set(3, repeats=2))


@pytest.mark.parametrize("kind", MarkingKind)
def test_every_road_depends_on_its_random_numbers_only(kind: MarkingKind) -> None:
    one, same = (random_road(kind, BendShape.BEND, np.random.default_rng(7)).settings for _ in range(2))
    assert one == same != random_road(kind, BendShape.BEND, np.random.default_rng(8)).settings


def test_frames_and_truth_of_a_clip_depend_on_its_case_only(clip: list[ClipFrame]) -> None:
    again = next(iter(moments(CASE, CAMERA, VEHICLE)))
    assert (again.frame.image == clip[0].frame.image).all()
    assert again.truth == clip[0].truth


def test_the_truth_is_the_place_on_the_road(clip: list[ClipFrame]) -> None:
    for moment in clip[::8]:
        foot = moment.road.foot_point(moment.x_m, moment.y_m)
        assert moment.truth.lateral_offset_m == pytest.approx(foot.offset_m, abs=1e-6)
        assert moment.truth.heading_error_rad == pytest.approx(moment.yaw_rad - foot.heading_rad, abs=1e-6)


def test_the_reported_state_is_the_motion_of_the_vehicle(clip: list[ClipFrame]) -> None:
    for before, after in zip(clip, clip[2:], strict=False):
        dt_s = after.frame.t_s - before.frame.t_s
        way_m = np.hypot(after.x_m - before.x_m, after.y_m - before.y_m)
        assert before.state.speed_mps == pytest.approx(way_m / dt_s, rel=0.02)
        assert before.state.yaw_rate_radps == pytest.approx((after.yaw_rad - before.yaw_rad) / dt_s, abs=0.04)


def true_path(moment: ClipFrame, share: float) -> PixelPath:
    """Pixels of the true boundary."""
    station_m = moment.road.local_coordinates(moment.x_m, moment.y_m)[0] + np.arange(4.0, 20.0, 0.5)
    world = moment.road.positions(station_m, share * moment.road.widths_at(station_m)) - [
        moment.x_m,
        moment.y_m,
    ]
    cos, sin = np.cos(moment.yaw_rad), np.sin(moment.yaw_rad)
    pixels = CAMERA.pixel_from_road(world @ np.array([[cos, -sin], [sin, cos]]))
    return tuple(map(tuple, pixels.tolist()))


def test_the_truth_itself_has_no_error(clip: list[ClipFrame]) -> None:
    moment = clip[5]
    paths = {"left_boundary_px": true_path(moment, 0.5), "right_boundary_px": true_path(moment, -0.5)}
    row = np.array(
        [(*look(replace(moment.truth, **paths), moment.truth, _TrueRoad(moment, CAMERA)), 0.0, 0.0)],
        LOOK,
    )[0]
    for field in ("offset_m", "heading_rad", "curvature_1pm", "width_share", "angle_rad"):
        assert row[field] == pytest.approx(0.0, abs=1e-6)
    assert row["aim_m"] == pytest.approx(0.0, abs=1e-3)
    assert max(row["left_m"], row["right_m"]) < 0.01


def test_ahead_the_road_itself_is_the_truth_also_where_a_bend_begins_in_between() -> None:
    """Five metres straight on, then the entry of a bend: no clothoid from the axle is the road."""
    beginning = []
    for moment in moments(replace(CASE, seed=31337, kind=MarkingKind.DASHED), CAMERA, VEHICLE):
        here = moment.road.local_coordinates(moment.x_m, moment.y_m)[0]
        if abs(moment.road.curvature_at(here + 3.0)) < 1e-3 < abs(moment.road.curvature_at(here + 8.0)):
            beginning.append((moment, here))
    assert beginning, "the clip drives up to a bend"
    for moment, here in beginning:
        true_x_m, true_y_m = moment.road.position(here + 8.0, 0.0)
        road = _TrueRoad(moment, CAMERA)
        place = complex(true_x_m - moment.x_m, true_y_m - moment.y_m) * np.exp(-1j * moment.yaw_rad)
        assert road.beside_m(place) == pytest.approx(0.0, abs=1e-6)
        left = 1j * np.exp(1j * (moment.road.heading_at(here + 8.0) - moment.yaw_rad))
        assert road.beside_m(place + 0.2 * left) == pytest.approx(0.2, abs=1e-3)
        arc_1pm = 2 * place.imag / abs(place) ** 2
        needed_rad = np.arctan(VEHICLE.wheelbase_m * arc_1pm)
        assert moment.truth.road_wheel_angle_rad == pytest.approx(needed_rad, abs=1e-6)


@given(st.floats(-0.06, 0.06), st.floats(-0.3, 0.3), st.floats(-1.0, 1.0))
def test_the_aim_on_a_circle_is_where_the_circle_is(
    kappa: float, heading_rad: float, offset_m: float
) -> None:
    estimate = replace(
        SteeringEstimate.nothing(0.0, estimator="x", lookahead_m=8.0, reason=""),
        lateral_offset_m=offset_m,
        heading_error_rad=heading_rad,
        curvature_1pm=kappa,
        curvature_rate_1pm2=0.0,
    )
    turn = 8.0 * kappa
    arc = 8.0 if abs(turn) < 1e-9 else (np.exp(1j * turn) - 1) / (1j * kappa)
    expected = (arc - 1j * offset_m) * np.exp(-1j * heading_rad)
    assert aim(estimate) == pytest.approx(expected, abs=1e-3)


def test_a_boundary_aside_is_as_far_off_as_it_is(clip: list[ClipFrame]) -> None:
    moment = clip[5]
    width_m = moment.truth.lane_width_m or 0.0
    errors = _TrueRoad(moment, CAMERA).boundary_errors_m(true_path(moment, 0.5 - 0.3 / width_m), ())
    assert errors[0] == pytest.approx(0.3, abs=0.01)
    assert np.isnan(errors[1])


def test_an_absent_estimate_is_nan_and_never_zero(clip: list[ClipFrame]) -> None:
    nothing = SteeringEstimate.nothing(0.0, estimator="x", lookahead_m=8.0, reason="dark")
    row = look(nothing, clip[0].truth, _TrueRoad(clip[0], CAMERA))
    assert np.isnan(row[:8]).all()


def test_rates_are_shares_of_frames_and_of_given_estimates() -> None:
    half, nan = [0.0] * 10 + [1.0] * 5, [np.nan] * 5
    row = figures(looks(offset_m=half + nan, angle_rad=[0.0] * 15 + nan))
    assert row["given_pct"] == 75.0
    assert row["detected_pct"] == 50.0
    assert row["correctness_pct"] == pytest.approx(100 * 10 / 15)
    assert row["offset_m_rmse"] == pytest.approx(np.sqrt(5 / 15))
    assert row["offset_m_rmse_when_right"] == 0.0


def test_an_estimator_without_estimates_has_no_errors_and_a_detection_rate_of_0() -> None:
    row = figures(looks(offset_m=np.nan, angle_rad=np.nan, left_m=np.nan, right_m=np.nan))
    assert (row["given_pct"], row["detected_pct"]) == (0.0, 0.0)
    assert row["offset_m_rmse"] is row["ece"] is row["auroc"] is row["correctness_pct"] is None


def test_a_lane_that_is_right_at_the_axle_but_not_ahead_is_wrong() -> None:
    assert figures(looks(aim_m=0.4))["detected_pct"] == 0.0


def test_perfect_confidence_has_an_auroc_of_1_and_no_calibration_error() -> None:
    bad = np.array([1.0] * 10 + [0.0] * 10)
    row = figures(looks(angle_rad=np.radians(5) * bad, confidence=1 - bad))
    assert row["auroc"] == 1.0
    assert row["ece"] == 0.0


def clip_with(rows: np.ndarray, in_gap: bool = False) -> WatchedClip:
    truth = np.zeros(len(rows), TRUTH)
    truth["in_gap"] = in_gap
    return WatchedClip(truth, {"a": rows})


def test_the_drift_in_a_gap_is_its_greatest_offset() -> None:
    cases = [replace(CASE, condition=GAP, number=n) for n in range(2)]
    results = {
        case: clip_with(looks(offset_m=np.linspace(0, end, 20)), in_gap=True)
        for case, end in zip(cases, (0.1, -0.3), strict=True)
    }
    found = gap_figures(results, "a")
    assert found["gap_drift_m_median"] == pytest.approx(0.2)
    assert found["gap_drift_m_worst"] == pytest.approx(0.3)


def test_bias_with_one_line_does_not_cancel_between_roads() -> None:
    cases = [replace(CASE, kind=MarkingKind.ONE_LINE, number=n) for n in range(2)]
    results = {
        case: clip_with(looks(angle_rad=angle))
        for case, angle in zip(cases, np.radians([1.0, -1.0]), strict=True)
    }
    found = one_line_figures(results, "a")
    assert found["one_line_bias_deg"] == pytest.approx(1.0)
    assert found["one_line_mean_deg"] == pytest.approx(0.0, abs=1e-6)


def test_the_main_conditions_count_drivable_grades_only() -> None:
    parts = groups(harness_set(1))
    assert {case.grade for case in parts["snow"]} == {1, 2, 3}
    assert {case.grade for case in parts["snow 5"]} == {5}
    assert all(case.condition != GAP for case in parts["all"])


def test_only_missing_results_are_computed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    called: list[tuple[str, ...]] = []

    def quickly(
        clip: Sequence[ClipFrame], names: Sequence[str], camera: Camera, vehicle: Vehicle
    ) -> WatchedClip:
        called.append(tuple(names))
        return WatchedClip(np.zeros(20, TRUTH), {name: looks() for name in names})

    monkeypatch.setattr(bench, "watch", quickly)
    monkeypatch.setattr(bench, "moments", lambda *_, **__: [])
    monkeypatch.setattr(bench, "FOLDER", tmp_path)
    watch_clips([CASE], ("cv",), 1)
    both = watch_clips([CASE], ("cv", "canny_hough"), 1)
    watch_clips([CASE], ("canny_hough", "cv"), 1)
    assert called == [("cv",), ("canny_hough",)]
    assert set(both[CASE].looks) == {"cv", "canny_hough"}


def test_results_are_stored_to_the_last_bit_and_those_of_other_code_are_not_read(tmp_path: Path) -> None:
    rows = looks(3, offset_m=(0.1, np.nan, 1e-9))
    with Store(tmp_path / "set.jsonl") as store:
        clips = ClipStore(store, "drawing", {"a": "old", "b": "same"})
        clips.write(CASE, WatchedClip(np.ones(3, TRUTH), {"a": looks(3), "b": rows}))
    with Store(tmp_path / "set.jsonl") as store:
        known = ClipStore(store, "drawing", {"a": "new", "b": "same"}).read(CASE)
        assert known is not None
        assert set(known.looks) == {"b"}
        assert known.looks["b"].tobytes() == rows.tobytes()
        assert known.truth.tobytes() == np.ones(3, TRUTH).tobytes()
        assert ClipStore(store, "other drawing", {"b": "same"}).read(CASE) is None


def test_stored_frames_are_read_back_unchanged(tmp_path: Path, clip: list[ClipFrame]) -> None:
    frames = [moment.frame.image for moment in clip[:3]]
    album = StoredFrames(tmp_path)
    assert album.read(CASE, 240) is None
    album.write(CASE, frames)
    assert all((a == b).all() for a, b in zip(album.read(CASE, 240) or [], frames, strict=True))


def test_the_code_of_an_estimator_is_the_set_of_its_imports() -> None:
    of_cv = import_closure(["perception.lane.lane_cv"])
    assert {
        "perception/lane/model/fit.py",
        "perception/lane/detection/edges.py",
        "trepid/car/camera.py",
    } <= set(of_cv)
    assert not any("techniques" in path for path in of_cv)
    codes = [estimator_fingerprint(name) for name in ("canny_hough", "canny_auto_hough", "cv")]
    assert len(set(codes)) == 3
    hash_of_files.cache_clear()  # as in a new process
    assert codes[0] == estimator_fingerprint("canny_hough")


def test_every_estimator_says_on_what_its_estimates_depend() -> None:
    silent = {name for name, entry in estimators().items() if not entry.modules and not entry.version()}
    assert silent == set()


def test_reports_are_written_as_json_csv_and_markdown(tmp_path: Path) -> None:
    found = {
        "seed": 1,
        "ranking": {"cv": {"auroc": 0.5}},
        "drive: a": {"cv": {"iou": 0.25, "n": None}, "x": {"n": 2}},
    }
    write(tmp_path / "new", found, {"cv": {"all": {"ece": 0.1}}})
    names = {"bench.json", "ranking.csv", "ranking.md", "drive_a.csv", "drive_a.md"}
    assert {path.name for path in (tmp_path / "new").iterdir()} == names
    assert (tmp_path / "new" / "drive_a.csv").read_text().splitlines() == [",iou,n", "cv,0.25,", "x,,2"]
    assert (tmp_path / "new" / "drive_a.md").read_text().splitlines()[2] == "| cv | 0.25 | – |"
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        write(tmp_path / "file", {}, {})


class Straight:
    """Holds the wheels straight."""

    def step(self, frame: object, state: object, *, now_s: float) -> SteeringEstimate:
        nothing = SteeringEstimate.nothing(now_s, estimator="x", lookahead_m=8.0, reason="")
        return replace(nothing, road_wheel_angle_rad=0.0)


def test_an_estimator_that_never_steers_keeps_its_offset_on_a_straight(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    entry = type("Entry", (), {"build": staticmethod(lambda camera, vehicle: Straight())})
    monkeypatch.setattr(drive, "entry_of", lambda name: entry)
    monkeypatch.setattr(drive, "estimator_fingerprint", lambda name: "x")
    monkeypatch.setattr(drive, "DURATION_S", 1.0)
    monkeypatch.setattr(drive, "QUICK_COURSES", 1)
    row = drive.bench_drive(["straight"], 5, tmp_path, quick=True)["straight"]
    assert (row["interventions"], row["autonomy_pct"], row["blind_pct"]) == (0, 100.0, 0.0)
    assert row["offset_m_rms"] == pytest.approx(drive.START_OFFSET_M, abs=0.01)


def test_autonomy_takes_six_seconds_for_each_intervention() -> None:
    rows = [{"interventions": n, "square_m2": 0.0, "blind": 0.0} for n in (0, 1, 50)]
    lost = 100 * INTERVENTION_S / drive.DURATION_S
    assert drive._total(rows)["autonomy_pct"] == pytest.approx((100 + (100 - lost) + 0) / 3)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"estimators": ("cw",)}, "no estimator 'cw'; .*estimate --estimator list"),
        ({"parts": ("sets",)}, "no part 'sets' of bench perception; there are set, drive"),
    ],
)
def test_bad_options_are_refused(options: dict[str, Sequence[str]], message: str) -> None:
    with pytest.raises(InputError, match=message):
        bench_perception(1, **options)
