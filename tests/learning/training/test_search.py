"""`trepid train --search` finds a recipe by the samplers, continues a search, and trains the best one."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")
optuna = pytest.importorskip("optuna", reason="a search needs the extra: pip install -e '.[tune]'")

from drive_rig import made_dataset, run, write_tub  # noqa: E402

from learning.dataset.dataset import Dataset  # noqa: E402
from learning.training.recipe import load_recipe  # noqa: E402
from learning.training.search import RecipeTask, number, searched_parameters  # noqa: E402
from sim_harness.tuning.study import Invalid, complete, open_storage  # noqa: E402
from trepid.config import InputError  # noqa: E402

RATE = "stages.0.learning_rate"
STAGES = "[{name: all, part: all, epochs: 2, learning_rate: 1.0e-3, schedule: cosine, patience: 2}]"
SMALL = {"stages": STAGES, "batch": "32"}


@pytest.fixture
def task(data: Dataset, tmp_path: Path) -> RecipeTask:
    return RecipeTask(
        parameters=searched_parameters([f"{RATE}=1e-4..0.1", "batch=8..64"], load_recipe("jain", None)),
        storage=str(tmp_path / "study.journal"),
        trials=2,
        seed=1,
        sampler="bat",
        data=data.folder,
        data_sha256=data.sha256,
        model="jain",
        config=None,
        changes=SMALL,
        folder=tmp_path,
    )


def test_a_range_keeps_the_scale_of_the_settings_and_an_integer_field_stays_whole():
    recipe = load_recipe("steer", None)
    found = searched_parameters([f"{RATE}=1e-5..1e-3", "window=2..9", "beta=0..1"], recipe)
    assert found[RATE].log and not found[RATE].whole and (found[RATE].low, found[RATE].high) == (1e-5, 1e-3)
    assert found["window"].whole and found["window"].round_value(3.6) == 4
    assert not found["beta"].whole and not found["beta"].log
    for name, span in searched_parameters([], recipe).items():
        assert number(recipe, name) is not None, f"{name} of the settings is a number of the recipe"
        assert span.low <= span.round_value((span.low * span.high) ** 0.5) <= span.high


@pytest.mark.parametrize(
    "name, said",
    [
        ("stages.7.learning_rate", "no such field"),
        ("learning_rate", "no such field"),
        ("optimiser", "is no number of the recipe, but 'adamw'"),
        ("stages", "is no number"),
    ],
)
def test_a_name_that_is_no_number_of_the_recipe_is_refused(name, said):
    with pytest.raises(InputError, match=said):
        searched_parameters([f"{name}=0..1"], load_recipe("steer", None))


def test_the_first_candidate_is_the_recipe_and_every_question_has_a_study_of_its_own(task):
    assert task.start() == {RATE: 1e-3, "batch": 32.0}
    assert (
        task.recipe({"batch": 12.0}).batch == 12 and task.recipe({RATE: 0.02}).stages[0].learning_rate == 0.02
    )
    others = [replace(task, model="steer"), replace(task, changes=SMALL | {"beta": "1.0"})]
    assert len({one.name for one in (task, *others)}) == 3
    assert replace(task, trials=9, sampler="tpe", storage="x").name == task.name


def test_a_candidate_costs_its_validation_error_and_the_same_values_the_same(task, tmp_path):
    first, second = (task.evaluate({RATE: 3e-3, "batch": 16.0}, tmp_path) for _ in range(2))
    assert first.cost == second.cost and 0 < first.cost < 45
    assert first.details["epochs"] == 2
    assert task.evaluate({RATE: 3e-4, "batch": 16.0}, tmp_path).cost != first.cost


def test_a_candidate_whose_loss_is_not_finite_is_invalid(task, tmp_path, monkeypatch):
    monkeypatch.setattr("learning.training.loop.descend", lambda *_, **__: math.nan)
    monkeypatch.setattr("learning.training.loop.mean_error_rad", lambda *_: math.nan)
    with pytest.raises(Invalid, match="finite"):
        task.evaluate({RATE: 3e-3, "batch": 16.0}, tmp_path)


@pytest.mark.long
@pytest.mark.processes
@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_the_command_continues_a_search_and_trains_the_best_recipe(data, tmp_path, capsys):
    out, storage = tmp_path / "best.onnx", tmp_path / "study.journal"
    words = ["train", "--data", str(data.folder), "--model", "jain", "--out", str(out), "--search", "pso"]
    words += [f"--set=stages={STAGES}", f"--vary={RATE}=1e-4..0.05", f"--storage={storage}", "--json"]
    found = []
    for trials in ("2", "3"):
        assert run(*words, "--trials", trials) == 0
        found.append(json.loads(capsys.readouterr().out))
    before, after = (one["search"] for one in found)
    assert (before["trials"], after["trials"]) == (2, 3) and before["study"] == after["study"]
    assert after["best_mae_deg"] <= before["best_mae_deg"] <= before["recipe_mae_deg"]
    assert found[1]["scores"]["mae_deg"] == pytest.approx(after["best_mae_deg"], rel=1e-3), (
        "its candidate again"
    )
    study = optuna.load_study(study_name=after["study"], storage=open_storage(str(storage)))
    assert len(complete(study.get_trials())) == 3, "nothing lost or doubled"


@pytest.mark.parametrize(
    "words, said",
    [
        (["--search", "btas"], "--search btas: known here: tpe, random, cma-es, bat"),
        (["--vary", "batch=8..64"], "belong to --search"),
        (["--search", "tpe", "--vary", "batch=64..8"], "low must be below high"),
        (["--search", "tpe", "--vary", "bath=8..64"], "bath: the recipe has no such field"),
    ],
)
def test_a_wrong_search_is_refused_in_one_line(data, tmp_path, words, said, capsys):
    code = run(
        "train", "--data", str(data.folder), "--model", "jain", "--out", str(tmp_path / "n.onnx"), *words
    )
    assert code == 2 and said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_a_search_on_images_that_are_not_there_ends_before_its_first_candidate(tmp_path, capsys):
    tub = write_tub(tmp_path / "tub", 360)
    made = made_dataset(tmp_path / "set", tub)
    tub.rename(tmp_path / "elsewhere")
    out = tmp_path / "n.onnx"
    words = ["--model", "jain", "--out", str(out), "--search", "tpe"]
    assert run("train", "--data", str(made.folder), *words) == 2
    said = capsys.readouterr().err
    assert "are not there any more: build it again" in said and "candidate" not in said
    assert sorted(tmp_path.iterdir()) == [tmp_path / "elsewhere", tmp_path / "set"]
