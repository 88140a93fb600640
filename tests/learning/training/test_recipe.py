"""The recipe of a training, and what overrides what."""

import pytest

from learning.models.catalogue import MODELS
from learning.training.recipe import load_recipe
from trepid.config import InputError


@pytest.mark.parametrize("name", MODELS)
def test_every_network_has_a_recipe_and_a_head(name):
    assert load_recipe(name, None).head == MODELS[name].head


def test_a_file_overrides_fields_and_those_of_one_network(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(
        "batch: 7\nmodels:\n  steer: {seed: 5}\n  pilotnet: {seed: 6}\naugmentation: {flip: 0.0}\n"
    )
    recipe = load_recipe("steer", path, overrides={"beta": "0.25"})
    assert (recipe.batch, recipe.seed, recipe.augmentation.flip, recipe.beta) == (7, 5, 0.0, 0.25)
    assert recipe.augmentation.brightness == load_recipe("steer", None).augmentation.brightness


@pytest.mark.parametrize(
    "text, said",
    [
        ("bath: 7\n", r"mine\.yaml:1:1: unknown field 'bath'; did you mean 'batch'"),
        ("seed: 1\nbatch: many\n", r"mine\.yaml:2:1: batch: "),
        ("models:\n  steeer: {seed: 5}\n", r"mine\.yaml:2:3: .*no such network; did you mean 'steer'"),
        ("models:\n  steer: {sed: 5}\n", r"mine\.yaml:2:11: .*no such field; did you mean 'seed'"),
        ("models:\n  pilotnet: {epochz: 5}\n", r"mine\.yaml:2:14: models\.pilotnet\.epochz: no such field"),
        ("augmentation: {flip: 2}\n", r"mine\.yaml:1:16: augmentation\.flip: "),
        ("- a list\n", r"mine\.yaml:1:1: expected a mapping"),
    ],
)
def test_errors_in_a_file_name_the_place(tmp_path, text, said):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=said):
        load_recipe("steer", path)


def test_donkeycar_trains_without_augmentation_and_with_its_own_numbers():
    recipe = load_recipe("donkey-linear", None)
    changed = recipe.augmentation
    assert changed.flip == changed.brightness == changed.shadow == changed.noise == 0
    assert (recipe.optimiser, recipe.batch, recipe.stages[0].patience) == ("adam", 128, 5)
