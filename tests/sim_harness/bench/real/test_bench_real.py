"""`bench real` on made-up sets whose figures are known."""

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from sim_harness.bench.perception.real.frames import Picture
from sim_harness.bench.perception.real.scores import ROAD_CLASS
from sim_harness.bench.real import baselines
from sim_harness.bench.real import bench as module
from sim_harness.bench.real.bench import bench_real
from sim_harness.bench.real.judgement import COLUMNS, LANE_ROWS, Judged, judgements, same, verdicts
from sim_harness.bench.real.look import GRID_PX
from sim_harness.bench.real.scores import figures
from sim_harness.bench.real.sets import SETS, Labels, Sequence, _road
from sim_harness.bench.real.sheets import evenly, worst
from sim_harness.world.render.renderer import Renderer
from sim_harness.world.road_file import load_road
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, ROOT, InputError, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
LANE = [[0.2, 0.3, 0.4], [0.8, 0.7, 0.6]]


def answer(confidence: float, *, inside: float = 1.0, answered: bool = True, **more) -> dict:
    fields = {"confidence": confidence, "angle_rad": 0.0, "lane": LANE, "answered": answered}
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


def test_a_trapezoid_is_fitted_to_the_labels_of_other_sequences():
    shape = (0.4, 0.45, 0.6, 0.1, 0.9)
    mask = baselines.trapezoid(shape)
    label = np.packbits(mask).tobytes().hex()
    fitted = baselines.fitted([row(answer(0.5), label=label)] * 3)
    assert fitted is not None
    assert baselines.overlap(fitted, mask[None], np.ones_like(mask[None]))[0] > 0.95
    assert (baselines.masks_of([row(answer(0.5), label=label)], "label")[0] == mask).all()


def test_angles_of_other_times_are_the_baselines_of_a_drive():
    rows = [row(answer(0.5), drive="a", t_s=0.1 * n, steering_rad=0.1 * n, file=str(n)) for n in range(5)] + [
        row(answer(0.5), drive="b", t_s=9.0, steering_rad=0.7)
    ]
    found = baselines.angles(rows)
    assert found["previous_200ms"][:5] == pytest.approx([np.nan, np.nan, 0.0, 0.1, 0.2], nan_ok=True)
    assert found["mean"][0] == pytest.approx(0.7)
    assert found["mean"][5] == pytest.approx(0.2)
    assert (found["straight"] == 0).all()


def test_a_later_answer_is_rated_by_the_lane_that_was_judged():
    lane = np.array(LANE)
    moved = answer(0.9, lane=(lane + 0.1).tolist())
    frame = [row(answer(0.9)), row(moved)]
    assert verdicts(frame, "cv", {"a.png": [Judged("right", lane)]}) == [True, False]
    assert verdicts(frame, "cv", {"a.png": [Judged("wrong", lane)]}) == [False, None]
    assert verdicts(frame, "cv", {"a.png": [Judged("cannot_say", lane)]}) == [None, None]
    assert verdicts(frame, "cv", {}) == [None, None]
    both = [Judged("right", lane + 0.1), Judged("cannot_say", lane)]
    assert verdicts(frame, "cv", {"a.png": both}) == [None, True]


def test_lanes_are_the_same_where_both_are_known():
    lane = np.array(LANE)
    short = lane.copy()
    short[:, 0] = np.nan
    assert same(lane, short)
    assert not same(lane, np.full_like(lane, np.nan))
    assert not same(lane, lane + 0.05)


def test_the_judgements_of_the_repository_can_be_read_and_name_known_sets():
    assert set(judgements()) <= set(SETS)
    assert len(COLUMNS) == 4 + 2 * len(LANE_ROWS)


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("a,b,cv,maybe,,,,,,", ":2:1: expected right, wrong"),
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
    sequence = Sequence(pictures, Labels.ROAD, _road)
    monkeypatch.setattr(module, "SETS", {"set": {"a": sequence, "b": sequence}, "absent": {}})
    monkeypatch.setattr(module, "FOLDER", tmp_path / "store")
    return passes


def test_every_sequence_gets_the_figures_of_both_estimators_once_for_the_same_code(made_up, tmp_path):
    first = bench_real(data=tmp_path, out=tmp_path / "out")
    assert set(first["set"]["a"]) == {"cv", "cnn"}
    assert first["set"]["a"]["cv"]["frames"] == 1
    assert first["set"]["a"]["cv"]["inside_road"] > 0.8
    assert first["set"]["a"]["cv"]["baseline_iou"] > 0.5
    assert "left out" in first["absent"]
    assert (tmp_path / "out" / "set-a-spread.png").is_file()
    assert (tmp_path / "out" / "reliability.png").is_file()
    assert bench_real(data=tmp_path, out=tmp_path / "out") == first
    assert len(made_up) == 2


def test_real_pictures_are_not_written_into_the_repository(made_up, tmp_path):
    with pytest.raises(InputError, match="do not belong"):
        bench_real(data=tmp_path, out=ROOT / "docs" / "results")


def test_an_unknown_set_is_refused_with_the_known_ones():
    with pytest.raises(InputError, match="camvid_road"):
        bench_real(sets=("kitti",))
