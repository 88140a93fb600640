"""Rounds of correction: killed at any step they end as undisturbed ones, and a tiny network drives better."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_alone_rig import drive_straight, scenario_file
from drive_rig import made_dataset, run, write_tub
from driving_network_rig import write_network

from learning.correcting import rounds
from learning.correcting.corrections import Drift
from learning.correcting.rounds import Plan, correct
from learning.dataset.dataset import Dataset
from learning.training.recipe import load_recipe
from learning.training.start import checkpoints_of
from sim_harness.lockstep.closed_loop import run as drive
from sim_harness.lockstep.recording import recording
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import CAR, CONFIG_DIR, InputError

pytestmark = pytest.mark.long
Row = dict[str, Any]
BEND_1PM = 0.05


class Kill(BaseException):
    """A kill at one step."""


class Workshop:
    """Stands for driving and training: steps are counted, and one of them is killed."""

    def __init__(self, recorded: Path, kill_at: int | None = None) -> None:
        self.recorded, self.kill_at = recorded, kill_at
        self.steps: list[str] = []
        self.starts: list[Path | None] = []

    def step(self, name: str) -> None:
        """Note a step, unless it is the one to be killed."""
        if len(self.steps) == self.kill_at:
            self.kill_at = None
            raise Kill
        self.steps.append(name)

    def drive(self, task: Any) -> Row:
        """The recorded drive once more; fewer interventions in later rounds."""
        path = task[2]
        self.step(f"drive {path.parent.name}")
        shutil.copyfile(self.recorded, path)
        number = int(path.parent.name.removeprefix("round-"))
        error_m = 0.5 / (1 + number)
        return dict(
            interventions=3 - number,
            departures=0,
            duration_s=10.0,
            distance_m=20.0,
            rms_lateral_error_m=error_m,
            max_lateral_error_m=error_m,
        )

    def train(self, data: Dataset, model: str, out: Path, recipe: Any, **options: Any) -> Row:
        """A network whose gain is the number of its training frames."""
        assert options["resume"]
        self.starts.append(options["start"])
        self.step(f"train {out.parent.name}")
        write_network(out, gain_rad=float(len(data.rows("train"))))
        out.with_suffix(".md").write_text("# card\n")
        return {"scores": {"mae_deg": 1.0}}


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("base")
    return made_dataset(folder / "set", write_tub(folder / "tub"), options=("--lock-deg", "20"))


@pytest.fixture(scope="module")
def recorded_drive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return drive_straight(tmp_path_factory.mktemp("drive"), curvature_1pm=BEND_1PM)[0]


Make = Callable[..., tuple[list[Row], Plan]]


@pytest.fixture
def make_correction(base: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    def make(workshop: Workshop, *, resume: bool = False, **changes: Any) -> tuple[list[Row], Plan]:
        monkeypatch.setattr(rounds, "drive", workshop.drive)
        fields: Row = dict(
            data=base,
            model="steer",
            recipe=load_recipe("steer", None),
            scenarios=(str(scenario_file(tmp_path, curvature_1pm=BEND_1PM)),),
            rounds=2,
            drift=Drift(),
            out=tmp_path / "ahead.onnx",
            command="trepid correct",
        )
        plan = Plan(**fields | changes)
        return correct(plan, workshop.train, resume=resume, jobs=1, report=lambda text: None), plan

    return make


STEPS = [f"{step} round-{number}" for number in range(3) for step in ("train", "drive")]


def test_every_round_trains_the_network_before_on_all_corrections_so_far_and_the_best_is_kept(
    make_correction: Make, recorded_drive: Path
) -> None:
    workshop = Workshop(recorded_drive)
    rows, plan = make_correction(workshop)
    assert workshop.steps == STEPS
    assert workshop.starts == [None, plan.network(0), plan.network(1)]
    assert [row["interventions"] for row in rows] == [3, 2, 1]
    added = [row["corrections"] for row in rows]
    assert added[0] == 0 < added[1] and added[2] == 2 * added[1]
    assert plan.out.read_bytes() == plan.network(2).read_bytes()
    assert "round 2 of 2" in plan.out.with_suffix(".md").read_text()


def test_a_network_that_is_there_is_not_overwritten(
    make_correction: Make, recorded_drive: Path, tmp_path: Path
) -> None:
    (tmp_path / "ahead.onnx").write_bytes(b"mine")
    workshop = Workshop(recorded_drive)
    with pytest.raises(InputError, match=r"--start .*ahead\.onnx begins with it"):
        make_correction(workshop)
    assert not workshop.steps and (tmp_path / "ahead.onnx").read_bytes() == b"mine"


@pytest.mark.parametrize("kill_at", [0, 1, 4, 5])  # the round between is like the last one
def test_a_correction_that_is_killed_at_any_step_continues_there_and_ends_the_same(
    make_correction: Make, recorded_drive: Path, kill_at: int
) -> None:
    workshop = Workshop(recorded_drive, kill_at)
    with pytest.raises(Kill):
        make_correction(workshop)
    rows, plan = make_correction(workshop, resume=True)
    assert workshop.steps == STEPS, "no step is done twice"
    assert [row["interventions"] for row in rows] == [3, 2, 1]
    assert plan.out.read_bytes() == plan.network(2).read_bytes()
    assert make_correction(workshop, resume=True)[0] == rows and workshop.steps == STEPS


def test_a_killed_build_of_corrections_is_done_again(
    make_correction: Make, recorded_drive: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    workshop = Workshop(recorded_drive)

    def kill(*_: Any) -> None:
        raise Kill

    monkeypatch.setattr(rounds, "build_corrections", kill)
    with pytest.raises(Kill):
        make_correction(workshop)
    monkeypatch.undo()
    rows, _ = make_correction(workshop, resume=True)
    assert len(rows) == 3


def test_a_correction_of_other_drives_is_not_continued(make_correction: Make, recorded_drive: Path) -> None:
    make_correction(Workshop(recorded_drive), rounds=1)
    with pytest.raises(InputError, match="--resume continues it"):
        make_correction(Workshop(recorded_drive), rounds=1)
    with pytest.raises(InputError, match="of other data, network, recipe, car or drives"):
        make_correction(Workshop(recorded_drive), rounds=1, seeds=(0, 1), resume=True)
    rows, _ = make_correction(Workshop(recorded_drive), rounds=2, resume=True)
    assert len(rows) == 3, "more rounds continue it"


def test_a_correction_of_another_car_is_not_continued(
    make_correction: Make, recorded_drive: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    make_correction(Workshop(recorded_drive), rounds=1)
    (tmp_path / "car").mkdir()
    (tmp_path / "car" / "vehicle.yaml").write_text("wheelbase_m: 2.6\n")
    monkeypatch.setenv(CAR, str(tmp_path / "car"))
    with pytest.raises(InputError, match="of other data, network, recipe, car or drives"):
        make_correction(Workshop(recorded_drive), rounds=1, resume=True)


def test_two_scenarios_of_one_name_are_refused_before_any_training(
    make_correction: Make, recorded_drive: Path, tmp_path: Path
) -> None:
    (tmp_path / "other").mkdir()
    files = [scenario_file(folder, curvature_1pm=BEND_1PM) for folder in (tmp_path, tmp_path / "other")]
    workshop = Workshop(recorded_drive)
    with pytest.raises(InputError, match="two of the scenarios are called short"):
        make_correction(workshop, scenarios=tuple(map(str, files)))
    assert not workshop.steps and not (tmp_path / "ahead.onnx.correct").exists()


def test_a_scenario_that_cannot_be_driven_alone_is_refused_before_any_training(
    make_correction: Make, recorded_drive: Path, tmp_path: Path
) -> None:
    workshop = Workshop(recorded_drive)
    with pytest.raises(InputError, match="no process 'cnn'"):
        make_correction(workshop, scenarios=("lost_cnn",))
    assert not workshop.steps and not (tmp_path / "ahead.onnx.correct").exists()


def test_nothing_is_trained_where_the_given_network_drifts_nowhere(
    make_correction: Make, recorded_drive: Path
) -> None:
    start = recorded_drive.parent / "ahead.onnx"
    checkpoints_of(start).save({})
    workshop = Workshop(recorded_drive)
    rows, plan = make_correction(workshop, start=start, drift=Drift(9.0, 1.5))
    assert workshop.steps == ["drive round-0"] and len(rows) == 1
    assert plan.out.read_bytes() == (recorded_drive.parent / "ahead.onnx").read_bytes()


@pytest.mark.parametrize(
    ("car", "scenario", "scale"), [("mini", "tight_white", 0.22 / 3.3), ("", "circuit", 1.0)]
)
def test_a_small_car_drifts_by_the_width_of_its_lanes(
    base: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, car: str, scenario: str, scale: float
) -> None:
    plans: list[Plan] = []
    monkeypatch.setattr(rounds, "correct", lambda plan, *_, **__: plans.append(plan) or [])
    monkeypatch.setenv(CAR, str(CONFIG_DIR / "cars" / car) if car else "")
    words = ["--data", str(base.folder), "--model", "steer", "--out", str(tmp_path / "net.onnx")]
    assert run("correct", *words, "--scenario", scenario) == 0
    (plan,) = plans
    assert plan.drift.offset_m == pytest.approx(0.15 * scale) and plan.drift.angle_rad == Drift().angle_rad
    assert float(plan.changes["speed_mps"]) == pytest.approx(2.2352 * scale)


@pytest.mark.processes  # both cores for long
def test_a_tiny_network_that_only_knows_a_straight_road_learns_a_bend(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    straight = load_scenario("straight", {"speed_mps": "3", "duration_s": "25", "sight": "camera"})
    with recording(tmp_path / "straight.mcap", straight) as witness:
        drive(straight, seed=0, witness=witness)
    made_dataset(tmp_path / "set", tmp_path / "straight.mcap")
    bend = scenario_file(tmp_path, curvature_1pm=0.02, distance_m=45.0, name="bend")
    words = ["--data", str(tmp_path / "set"), "--model", "steer", "--scenario", str(bend), "--rounds", "1"]
    words += ["--speed", "3", "--out", str(tmp_path / "tiny.onnx"), "--json"]
    words += ["--set", "height_px=24", "--set", "width_px=32", "--set", "batch=16"]
    words += ["--set", "stages.0.epochs=15"]
    capsys.readouterr()
    assert run("correct", *words) == 0
    found = json.loads(capsys.readouterr().out)
    before, after = found["rounds"]
    assert after["corrections"] > 10
    assert after["rms_lateral_error_m"] < 0.7 * before["rms_lateral_error_m"]
    assert after["interventions"] <= before["interventions"]
    assert Path(found["file"]).is_file()
