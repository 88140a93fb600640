"""`bench real` on made-up sets whose figures are known."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from lab.bench.real import baselines, look
from lab.bench.real import bench as module
from lab.bench.real.bench import bench_real
from lab.bench.real.frames import Picture
from lab.bench.real.judgement import COLUMNS, LANE_ROWS, JudgedLane, judgements, verdicts, within
from lab.bench.real.labels import ROAD_CLASS, Labels
from lab.bench.real.look import GRID_PX
from lab.bench.real.scores import figures
from lab.bench.real.sets import SETS, Sequence, data_folder
from lab.bench.real.sheets import evenly, worst
from lab.bench.real.supervision import supervision_figures
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, InputError, load

pytestmark = pytest.mark.long
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
LANE = [[0.2, 0.3, 0.4], [0.8, 0.7, 0.6]]


def answer(confidence: float, *, inside: float = 1.0, answered: bool = True, **more) -> dict:
    fields = {"confidence": confidence, "angle_rad": 0.0, "width_m": None, "lane": LANE, "answered": answered}
    return fields | {"iou": 0.5 * inside, "inside": inside} | more


def row(one: dict, **more) -> dict:
    label = "00" * (GRID_PX[0] * GRID_PX[1] // 8)
    fields = {"file": "a.png", "drive": "a", "t_s": 0.0, "fear": 0.1, "steering_rad": None, "label": label}
    fields["known"] = "ff" * (GRID_PX[0] * GRID_PX[1] // 8)
    return fields | {"estimates": {"cv": one}} | more


def test_an_answer_is_wrong_below_eighty_percent_and_confident_above_one_half():
    rows = [
        row(answer(0.9, inside=0.79)),
        row(answer(0.9, inside=0.81)),
        row(answer(0.4, inside=0.1)),
        row(answer(0.0, answered=False)),
    ]
    found = figures(rows, "cv", Labels.ROAD, trapezoid=None, judged={})
    assert found["answered"] == 0.75
    assert found["confident"] == 0.5
    assert found["wrong_and_confident"] == 0.25
    assert found["wrong_of_very_confident"] == 0.5
    assert found["baseline_iou"] is None, "there is no other sequence to fit the trapezoid to"
    assert found["mae_deg"] is None


def test_auroc_is_one_where_confidence_and_fear_tell_wrong_answers_from_right_ones():
    rows = [row(answer(0.9), fear=0.1), row(answer(0.8), fear=0.2), row(answer(0.3, inside=0.2), fear=0.7)]
    found = figures(rows, "cv", Labels.ROAD, trapezoid=None, judged={})
    assert (found["auroc_confidence"], found["auroc_fear"]) == (1.0, 1.0)


def test_right_and_confident_is_a_share_of_the_drawn_lanes_and_wrong_and_confident_of_the_judged_answers():
    true, aside = np.array(LANE), (np.array(LANE) + 0.3).tolist()
    rows = [
        row(answer(0.9), fear=0.1),
        row(answer(0.4), fear=0.2),
        row(answer(0.7, lane=aside), fear=0.9),
        row(answer(0.0, answered=False), fear=0.9),
        row(answer(0.9), file="junction.png"),
    ]
    found = figures(rows, "cv", Labels.NONE, trapezoid=None, judged={"a.png": [JudgedLane("lane", true)]})
    assert (found["drawn_right_and_confident"], found["judged"]) == (0.25, 3)
    assert found["ego_wrong_and_confident"] == pytest.approx(1 / 3)
    assert (found["ego_auroc_confidence"], found["ego_auroc_fear"]) == (0.5, 1.0)


def test_the_car_is_engaged_in_modes_other_than_stop_after_the_driver_has_let_go():
    modes = ["STOP"] * 23 + ["KEEP"] * 6 + ["STOP"] * 2
    drive = [
        row(answer(0.9), t_s=0.1 * n, mode=mode, cause="glare" if n < 8 else "none", fear=0.5 * (n < 8))
        for n, mode in enumerate(modes)
    ]
    still = row(answer(0.9), drive="still", mode="STOP", cause="starting", fear=1.0)
    found = supervision_figures([*drive, still])
    assert found["engaged"] == pytest.approx(6 / 9), "of the frames from 2.2 s on"
    assert found["mean_fear"] == pytest.approx((8 * 0.5 + 1.0) / 32)
    assert found["fear_causes"] == "glare 0.25, starting 0.03"
    assert supervision_figures([still])["engaged"] is None


def test_lines_are_shares_of_all_labelled_points_and_lines():
    counts = {"points": 40, "right_points": 30, "lines": 2, "false_lines": 0, "missed_lines": 1}
    rows = [row(answer(0.9, **counts)), row(answer(0.9, **(counts | {"points": 60, "false_lines": 1})))]
    found = figures(rows, "cv", Labels.LINES, trapezoid=None, judged={})
    assert found["tusimple_accuracy"] == 0.6
    assert (found["tusimple_false_lines"], found["tusimple_missed_lines"]) == (0.25, 0.5)
    assert figures(rows, "cv", Labels.ROAD, trapezoid=None, judged={})["tusimple_accuracy"] is None


def test_width_and_border_error_are_medians_over_the_frames_that_have_one():
    rows = [row(answer(0.9, width_m=width, border_error_px=width)) for width in (3.0, 3.5, 4.5, None)]
    found = figures(rows, "cv", Labels.ROAD, trapezoid=None, judged={})
    assert (found["lane_width_m"], found["lane_width_iqr_m"], found["border_error_px"]) == (3.5, 0.75, 3.5)
    nothing = figures([row(answer(0.9))], "cv", Labels.ROAD, trapezoid=None, judged={})
    assert nothing["lane_width_m"] is nothing["lane_width_iqr_m"] is nothing["border_error_px"] is None


def test_angles_are_compared_over_the_frames_with_one_and_with_driving_straight():
    driven, given = np.radians([0, 10, -10, 5]), [*np.radians([1, 11, -9]), None]
    rows = [
        row(answer(0.5, angle_rad=mine), drive=str(n), steering_rad=truth)
        for n, (truth, mine) in enumerate(zip(driven, given, strict=True))
    ]
    found = figures(rows, "cv", Labels.ANGLE, trapezoid=None, judged={})
    assert found["mae_deg"] == pytest.approx(1.0)
    assert found["mae_straight_deg"] == pytest.approx(20 / 3)
    assert found["correlation"] == pytest.approx(1.0)


def test_a_trapezoid_is_fitted_to_the_labels_of_other_sequences():
    shape = (0.4, 0.45, 0.6, 0.1, 0.9)
    mask = baselines.trapezoid(shape)
    label = np.packbits(mask).tobytes().hex()
    fitted = baselines.fit_trapezoid([row(answer(0.5), label=label)] * 3)
    assert fitted is not None
    assert baselines.overlap(fitted, mask[None], np.ones_like(mask[None]))[0] > 0.95
    assert (baselines.masks_of([row(answer(0.5), label=label)], "label")[0] == mask).all()


def test_angles_of_other_times_are_the_baselines_of_a_drive():
    rows = [row(answer(0.5), drive="a", t_s=0.1 * n, steering_rad=0.1 * n, file=str(n)) for n in range(5)] + [
        row(answer(0.5), drive="b", t_s=9.0, steering_rad=0.7)
    ]
    found = baselines.angles(rows)
    assert found["previous_200ms"][:5] == pytest.approx([np.nan, np.nan, 0.0, 0.1, 0.2], nan_ok=True)
    assert np.isnan(found["around_500ms"][5])
    longer = [
        row(answer(0.5), drive="a", t_s=0.1 * n, steering_rad=float(n == 9), file=str(n)) for n in range(20)
    ]
    near = [1 / (min(n, 5) + 5) if 4 <= n <= 14 and n != 9 else 0.0 for n in range(20)]
    assert baselines.angles(longer)["around_500ms"] == pytest.approx(near)
    assert found["mean"][0] == pytest.approx(0.7)
    assert found["mean"][5] == pytest.approx(0.2)
    assert (found["straight"] == 0).all()


def test_a_later_answer_is_rated_by_the_lane_that_was_judged():
    lane = np.array(LANE)
    moved = answer(0.9, lane=(lane + 0.1).tolist())
    frame = [row(answer(0.9)), row(moved)]
    assert verdicts(frame, "cv", {"a.png": [JudgedLane("right", lane)]}) == [True, False]
    assert verdicts(frame, "cv", {"a.png": [JudgedLane("wrong", lane)]}) == [False, None]
    assert verdicts(frame, "cv", {"a.png": [JudgedLane("cannot_say", lane)]}) == [None, None]
    assert verdicts(frame, "cv", {}) == [None, None]
    both = [JudgedLane("right", lane + 0.1), JudgedLane("cannot_say", lane)]
    assert verdicts(frame, "cv", {"a.png": both}) == [None, True]


def test_an_answer_is_rated_by_the_lane_of_the_car_where_that_was_drawn():
    true = np.array(LANE)
    shifted, doubled = true + np.array([0.1, 0.08, 0.04]), np.array([true[0], 2 * true[1] - true[0]])
    frame = [row(answer(0.9, lane=lane.tolist())) for lane in (true, shifted, doubled)]
    drawn = JudgedLane("lane", true)
    assert verdicts(frame, "cv", {"a.png": [drawn]}) == [True, True, False]
    assert verdicts(frame, "cv", {"a.png": [JudgedLane("wrong", shifted), drawn]}) == [True, False, False]
    assert verdicts(frame, "cv", {"a.png": [JudgedLane("cannot_say", doubled), drawn]}) == [True, True, False]
    unseen = {"a.png": [JudgedLane("lane", np.full_like(true, np.nan))]}
    assert verdicts(frame, "cv", unseen) == [None, None, None]


def test_lanes_are_compared_in_shares_of_their_width_where_both_are_known():
    lane = np.array(LANE)
    short, wider = lane.copy(), 2 * lane
    short[:, 0] = np.nan
    assert within(lane, short, 0.01)
    assert within(lane, np.full_like(lane, np.nan), 0.01) is None
    aside = 0.05 * (lane[1] - lane[0])
    assert within(lane + aside, lane, 0.06) and within(lane + aside, lane, 0.04) is False
    assert within(wider + 2 * aside, wider, 0.06)


def test_an_answer_a_little_beside_a_lane_that_was_judged_right_is_not_rated_and_one_far_beside_is_wrong():
    lane = np.array(LANE)
    width = lane[1] - lane[0]
    frame = [row(answer(0.9, lane=(lane + share * width).tolist())) for share in (0.05, 0.15, 0.3)]
    assert verdicts(frame, "cv", {"a.png": [JudgedLane("right", lane)]}) == [True, None, False]


def test_the_judgements_of_the_repository_can_be_read_and_name_known_sets():
    assert set(judgements()) <= set(SETS)
    assert len(COLUMNS) == 4 + 2 * len(LANE_ROWS)


def test_a_lane_is_drawn_in_rows_in_which_the_eye_can_place_it_and_at_both_sides():
    drawn = [one.lane for files in judgements().values() for lanes in files.values() for one in lanes
             if one.judgement == "lane"]  # fmt: skip
    assert drawn
    for left, right in drawn:
        assert (np.isnan(left) == np.isnan(right)).all() and np.isfinite(left[:2]).all()
        assert np.nanmin(right - left) >= 0.15  # of the image


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("a,b,cv,maybe,,,,,,", ":2:1: expected right, wrong, cannot_say or lane"),
        ("a,b,cv,right,x,,,,,", ":2:1: expected numbers"),
    ],
)
def test_a_bad_judgement_is_named_with_its_line(tmp_path, line, reason):
    path = tmp_path / "judged.csv"
    path.write_text(f"{','.join(COLUMNS)}\n{line}\n")
    with pytest.raises(InputError, match=reason):
        judgements(path)


def test_sheets_show_frames_spread_evenly_and_confident_errors_first():
    assert evenly(3) == [0, 1, 2]
    assert evenly(100)[0] == 0 and evenly(100)[-1] == 99 and len(evenly(100)) == 12
    rows = [row(answer(0.2)), row(answer(0.9)), row(answer(0.5))]
    assert worst(rows, "cv", [True, True, False]) == [1, 0]


@pytest.fixture
def made_up(tmp_path, monkeypatch) -> list[int]:
    """A set of two sequences of one rendered frame each; the list grows with every pass over a sequence."""
    road, passes = load_road("straight"), []
    image = Renderer(road, CAMERA, seed=1).render(30.0, 0.0, 0.0, station_m=30.0, t_s=0.0)
    label = np.zeros(image.shape[:2], np.uint8)
    label[150:] = ROAD_CLASS
    cv2.imwrite(str(tmp_path / "label.png"), label)

    def pictures(folder: Path, every: int) -> Iterator[Picture]:
        passes.append(every)
        yield Picture("one", 0.0, image, CAMERA, label=tmp_path / "label.png", file="one.png")

    (tmp_path / "set").mkdir()
    sequence = Sequence(pictures, Labels.ROAD)
    monkeypatch.setattr(module, "SETS", {"set": {"a": sequence, "b": sequence}, "absent": {}})
    monkeypatch.setattr(module, "FOLDER", tmp_path / "store")
    monkeypatch.setattr(module, "supervised_estimators", lambda: ("cv", "cnn"))
    return passes


def test_every_sequence_gets_the_figures_of_both_estimators_once_for_the_same_code(made_up, tmp_path):
    first = bench_real(data=tmp_path, out=tmp_path / "out")
    assert set(first["set"]["a"]) == {"cv", "cnn", "supervisor"}
    assert 0 <= first["set"]["a"]["supervisor"]["mean_fear"] <= 1
    assert first["set"]["a"]["cv"]["frames"] == 1
    assert first["set"]["a"]["cv"]["inside_road"] > 0.8
    assert first["set"]["a"]["cv"]["baseline_iou"] > 0.5
    assert "left out" in first["absent"]
    assert (tmp_path / "out" / "set-a-spread.png").is_file()
    assert (tmp_path / "out" / "reliability.png").is_file()
    assert bench_real(data=tmp_path, out=tmp_path / "out") == first
    assert len(made_up) == 2


def test_techniques_are_scored_beside_the_estimators_of_the_car_once_for_the_same_code(made_up, tmp_path):
    both = ("canny_hough", "cv")
    first = bench_real(data=tmp_path, out=tmp_path / "out", estimators=both)
    assert set(first["set"]["b"]) == {"cv", "cnn", "canny_hough", "supervisor"}
    assert first["set"]["b"]["canny_hough"]["frames"] == 1
    assert first["set"]["b"]["cv"] == bench_real(data=tmp_path, out=tmp_path / "out")["set"]["b"]["cv"]
    assert bench_real(data=tmp_path, out=tmp_path / "out", estimators=both) == first
    assert len(made_up) == 4, "a pass with the supervisor and one with the technique, of two sequences"


@pytest.mark.parametrize(("fetched", "names"), [(True, ("cv", "cnn", "segments")), (False, ("cv", "cnn"))])
def test_the_supervised_car_has_segments_where_its_network_was_fetched(fetched, names, monkeypatch):
    entry = replace(look.FURTHER["segments"], is_here=lambda: fetched)
    monkeypatch.setitem(look.FURTHER, "segments", entry)
    assert look.supervised_estimators() == names


def test_real_pictures_are_not_written_into_the_repository(made_up, tmp_path):
    with pytest.raises(InputError, match="do not belong"):
        bench_real(data=tmp_path, out=ROOT / "lab" / "results")


def test_an_unknown_set_and_an_unknown_estimator_are_refused():
    with pytest.raises(InputError, match="camvid_road"):
        bench_real(sets=("kitti",))
    with pytest.raises(InputError, match="no estimator 'cw'"):
        bench_real(estimators=("cw",))


def test_a_set_that_is_not_there_is_left_out_with_the_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FOLDER", tmp_path / "store")
    found = bench_real(data=tmp_path, out=tmp_path / "out")
    assert set(found) == set(SETS)
    assert found["kitti_road_tiny"] == {"left out": "no folder kitti_road_tiny in the data folder"}


def test_the_data_folder_is_the_given_one_the_environments_or_the_neighbour(monkeypatch):
    assert data_folder(Path("here")) == Path("here")
    monkeypatch.setenv("TREPID_DATA", "/there")
    assert data_folder(None) == Path("/there")
    monkeypatch.delenv("TREPID_DATA")
    assert data_folder(None) == ROOT.parent / "shared" / "data"


@pytest.mark.skipif(
    not (data_folder(None) / "tusimple_lanenet").is_dir(),
    reason="the real sets are not beside the repository",
)
def test_the_default_estimator_finds_ego_lines_on_the_real_highway(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "FOLDER", tmp_path / "store")
    found = bench_real(out=tmp_path / "out", sets=("tusimple_lanenet",))
    assert found["tusimple_lanenet"]["highway"]["cv"]["tusimple_accuracy"] > 0.85
