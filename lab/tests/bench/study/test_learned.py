"""Studies of trainings: they differ in one thing, continue where they ended, and judge an unseen route."""

from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch", reason="training needs the extra: pip install -e '.[train]'")

from drive_rig import made_dataset, write_table, write_tub  # noqa: F401

from lab.bench.imitation import training_code
from lab.bench.imitation.training_code import one_stage
from lab.bench.study import learned
from lab.bench.study.learned import (
    Variant,
    bench_data,
    bench_histogram,
)
from learning.dataset.dataset import Dataset
from learning.training.recipe import load_recipe

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def small_set(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("drive")
    return made_dataset(folder / "set", write_tub(folder / "tub"), options=("--lock-deg", "20"))


@pytest.fixture
def data(small_set: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    """A small data set in place of the drives."""
    monkeypatch.setattr(learned, "study_sets", lambda seed: learned.Sets(small_set, small_set))
    monkeypatch.setattr(learned, "WORK_DIR", tmp_path)
    return small_set


@pytest.fixture
def asked_variants(data: Dataset, monkeypatch: pytest.MonkeyPatch) -> list[Variant]:
    """The variants that a study asks for, without any training."""
    found: list[Variant] = []

    def note(variant: Variant) -> dict[str, Any]:
        found.append(variant)
        return {"mae_deg": float(len(found))}

    monkeypatch.setattr(learned, "trained_row", note)
    return found


def test_every_recipe_of_every_study_is_valid_and_differs_from_the_others(
    asked_variants: list[Variant],
) -> None:
    for name in ("data", "size", "initialisation", "histogram"):
        first = len(asked_variants)
        getattr(learned, f"bench_{name}")(seed=3)
        recipes = [
            load_recipe(one.model, None, overrides=dict(one.changes)) for one in asked_variants[first:]
        ]
        assert len({(one.model, one.changes) for one in asked_variants[first:]}) == len(recipes)
        assert {recipe.seed for recipe in recipes} == ({3, 4, 5} if name == "data" else {3})


def test_small_shares_take_about_as_many_steps(asked_variants: list[Variant]) -> None:
    bench_data(seed=0)
    recipes = [load_recipe(one.model, None, overrides=dict(one.changes)) for one in asked_variants]
    steps = [recipe.frames_share * recipe.stages[0].epochs for recipe in recipes]
    assert steps[2:7] == pytest.approx([learned.EPOCHS] * 5, rel=0.05)


def test_a_share_has_the_mean_error_of_its_trainings(asked_variants: list[Variant]) -> None:
    tables = bench_data(seed=0)
    each = tables["each training, mae_deg"]
    assert each["1%"] == {"training 1": 1.0, "training 2": 8.0, "training 3": 15.0}
    assert [row["mae_deg"] for row in tables["share of the frames"].values()] == [
        float(n) for n in range(8, 15)
    ]


def test_a_study_that_is_started_again_trains_nothing_twice(asked_variants: list[Variant]) -> None:
    before = bench_histogram(seed=0)
    count = len(asked_variants)
    assert bench_histogram(seed=0) == before and len(asked_variants) == count == 9


TINY = dict(stages=one_stage(1, 1.0e-3), height_px="24", width_px="32", batch="16")


@pytest.mark.parametrize(
    ("changed", "trained_again", "judged_again"),
    [
        ("learning/training/loop.py", True, True),
        ("learning/models/steer.py", True, True),
        ("learning/models/papers.py", False, False),
        ("learning/judging/scores.py", True, True),  # the card of a network says what its scores are worth
        ("learning/judging/predictions.py", False, True),
        ("cockpit/page/node.py", False, False),
    ],
)
def test_weights_are_used_again_only_with_the_code_that_trained_them(
    data: Dataset,
    monkeypatch: pytest.MonkeyPatch,
    changed: str,
    trained_again: bool,
    judged_again: bool,
) -> None:
    trained, judged = [], []

    def train(_: Dataset, __: str, out: Path, *___: Any, **____: Any) -> None:
        trained.append(out)
        out.parent.mkdir(parents=True, exist_ok=True)
        out.with_suffix(".md").write_text("# card\n")

    def judge(_: learned.Sets, network: Path) -> dict[str, Any]:
        judged.append(network)
        return {"mae_deg": 1.0}

    monkeypatch.setattr("learning.training.run.run", train)
    for module in (learned, training_code):
        monkeypatch.setattr(module, "fingerprint", lambda *_: "False")
    variants = {"one": Variant(0, "steer", tuple(TINY.items()), judge)}
    learned._study(0, "light", variants)
    learned._study(0, "light", variants)
    assert (len(trained), len(judged)) == (1, 1)
    for module in (learned, training_code):
        monkeypatch.setattr(module, "fingerprint", lambda *parts: f"{changed in parts}")
    learned._study(0, "light", variants)
    assert (len(trained), len(judged)) == (1 + trained_again, 1 + judged_again)


def test_a_variant_is_trained_and_judged_in_degrees_of_the_steering_wheel(data: Dataset) -> None:
    stages = one_stage(2, 1.0e-3)
    changes = dict(stages=stages, height_px="24", width_px="32", batch="16")
    row = learned.trained_row(Variant(0, "steer", tuple(changes.items()), learned.under_light))
    straight_deg = row["always_straight_deg"]
    assert 0 < row["mae_deg"] < 2 * straight_deg and straight_deg > 16, "the lock is 20° of the road wheel"
    assert row["spread_under_light_deg"] > 0
