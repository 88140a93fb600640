"""The hash by which trained networks are kept."""

from importlib.metadata import version

from learning.models.catalogue import model
from sim_harness.sweep.fingerprint import fingerprint, import_closure, short_hash


def code_of_training(network: str) -> str:
    """Hash of all that decides about the weights of a network besides its recipe and its data set."""
    modules = ["learning.training.run", f"learning.models.{model(network).module}"]
    return short_hash(fingerprint(*import_closure(modules), "config"), version("torch"))
