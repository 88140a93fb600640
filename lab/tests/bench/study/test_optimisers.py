"""The table of the optimisers: the rate is chosen without the seeds that are compared, and each row is a mean."""

import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from lab.bench.study import optimisers
from lab.bench.study.optimisers import (
    FIXED,
    MODEL,
    OPTIMISERS,
    OptimiserTraining,
    bench_optimisers,
    best_rate,
)
from learning.training.loop import OPTIMISERS as OF_THE_LOOP
from learning.training.recipe import load_recipe

STUDY = 7


@pytest.fixture
def asked_trainings(monkeypatch: pytest.MonkeyPatch, tmp_path) -> list[OptimiserTraining]:
    """The trainings that the table asks for, without any: the error of one is its rate's distance from 0.02."""
    found: list[OptimiserTraining] = []

    def note(one: OptimiserTraining) -> dict[str, object]:
        found.append(one)
        if one.optimiser == "Adagrad" and one.seed == STUDY + 2:
            return {"validation_deg": None}
        error = abs(one.rate - 0.02) + one.seed / 1000 + 1.0
        return {
            "validation_deg": error,
            "curve_deg": [2 * error, error],
            "mae_deg": error,
            "rmse_deg": error,
            "std_deg": error,
            "seconds": 1.0,
        }

    monkeypatch.setattr(optimisers, "train_one", note)
    monkeypatch.setattr(optimisers, "WORK_DIR", tmp_path)
    monkeypatch.setattr(optimisers, "frames_of", lambda seed: NoFrames())
    monkeypatch.setattr(optimisers, "straight_deg", lambda frames: 9.0)
    return found


class NoFrames:
    train: tuple[()] = ()
    test: tuple[()] = ()


def test_every_optimiser_of_a_recipe_is_in_the_table():
    names = {
        load_recipe(MODEL, None, overrides={**FIXED, **change}).optimiser for change, _ in OPTIMISERS.values()
    }
    assert names == set(OF_THE_LOOP)


def test_the_rate_is_chosen_by_a_seed_of_its_own_and_all_train_the_same_epochs(asked_trainings):
    found = bench_optimisers(STUDY)
    short = [one for one in asked_trainings if one.epochs == optimisers.SHORT_EPOCHS]
    whole = [one for one in asked_trainings if one.epochs == optimisers.EPOCHS]
    assert len(short) == 3 * len(OPTIMISERS) and len(whole) == optimisers.SEEDS * len(OPTIMISERS)
    assert not {one.seed for one in short} & {one.seed for one in whole}
    table = found["optimisers"]
    assert table["momentum"]["learning rate"] == 0.01 and table["Adam"]["learning rate"] == pytest.approx(
        0.003
    )
    assert list(table) == sorted(table, key=lambda name: table[name]["mae_deg"])
    row = table["momentum"]
    assert row["from"] <= row["mae_deg"] <= row["to"] and row["epochs to the error of the worst"] == 2.0


def test_an_optimiser_whose_loss_is_not_finite_is_named_and_has_no_row(asked_trainings):
    found = bench_optimisers(STUDY)
    assert found["without a finite loss"] == "Adagrad" and "Adagrad" not in found["optimisers"]


def test_a_rate_without_a_finite_loss_is_not_chosen():
    one, other = (OptimiserTraining(0, "Adam", rate, 1, 0) for rate in (0.1, 0.2))
    assert best_rate({one: {"validation_deg": None}, other: {"validation_deg": 5.0}}) == 0.2


def test_the_table_again_trains_nothing_twice(asked_trainings):
    before, count = bench_optimisers(STUDY), len(asked_trainings)
    assert bench_optimisers(STUDY) == before and len(asked_trainings) == count
