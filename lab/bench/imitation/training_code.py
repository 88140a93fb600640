"""Trained networks that are kept, under a hash of the code that trained them."""

from importlib.metadata import version
from pathlib import Path

from learning.dataset.dataset import Dataset
from learning.models.catalogue import model
from learning.rendered import say
from learning.training.recipe import Recipe
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash


def code_of_training(network: str) -> str:
    """Hash of all that decides about the weights of a network besides its recipe and its data set."""
    modules = ["learning.training.run", f"learning.models.{model(network).module}"]
    return short_hash(fingerprint(*import_closure(modules), "config"), version("torch"))


def one_stage(epochs: int, rate: float) -> str:
    """The field ``stages`` of a recipe: all ``epochs`` in one, none left out."""
    return (
        f"[{{name: all, part: all, epochs: {epochs}, learning_rate: {rate}, schedule: cosine, patience: 99}}]"
    )


def train_once(data: Dataset, network: str, out: Path, recipe: Recipe, command: str) -> None:
    """Train ``network`` and write ``out``, unless it is there; an interrupted one goes on. Raises InputError."""
    from learning.training.run import run

    out.parent.mkdir(parents=True, exist_ok=True)
    if not out.with_suffix(".md").is_file():  # the card is written last
        run(data, network, out, recipe, resume=True, command=command, report=say)
