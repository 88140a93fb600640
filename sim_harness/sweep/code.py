"""Which code and settings the answers of an estimator hang on, as a hash: what is on file of it is good as long."""

import ast
import hashlib
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from perception.techniques.recipe import Recipe, recipes
from sim_harness.sweep.fingerprint import fingerprint
from trepid.config import ROOT
from trepid.packages import PACKAGES

PIPELINE = ("perception.techniques.pipeline", "perception.techniques.recipe")
TABLE = "perception.techniques.stages"  # imports every stage: a pipeline hangs on its own ones only
OUR_OWN = {
    "cv": ("perception.lane.lane_cv", ("config/perception.yaml",)),
    "cnn": ("perception.net.steer_net", ("config/steer_net.yaml", "perception/weights")),
}
_DIGITS = 16


@cache
def code_of(name: str) -> str:
    """A hash that changes with the code, the settings and the libraries that the estimator called ``name`` uses."""
    if name in OUR_OWN:
        root, settings = OUR_OWN[name]
        return fingerprint(*_paths([root]), *settings, "config/vehicle.yaml")
    recipe = recipes()[name]
    own = [*PIPELINE, *(stage.entry.__module__ for stage in recipe.stages)]
    written = hashlib.sha256(_text(recipe).encode()).hexdigest()[:_DIGITS]
    return f"{fingerprint(*_paths(own), 'config/vehicle.yaml')}-{written}"


def _text(recipe: Recipe) -> str:
    stages = [(stage.name, sorted(stage.settings.items())) for stage in recipe.stages]
    return repr((recipe.trust, recipe.width_m, recipe.width_sigma_m, stages))


def _paths(modules: Iterable[str]) -> list[str]:
    """The files of ``modules`` and of all of ours that they import, however far down, below the repository."""
    found: dict[str, Path] = {}
    open_ = list(modules)
    while open_:
        module = open_.pop()
        path = _file_of(module)
        if path is None or module in found or module == TABLE:
            continue
        found[module] = path
        open_ += _imports(path)
    return sorted(path.relative_to(ROOT).as_posix() for path in found.values())


def _file_of(module: str) -> Path | None:
    """The file of a module of ours; None for any other."""
    path = ROOT.joinpath(*module.split("."))
    files = (path.with_suffix(".py"), path / "__init__.py")
    ours = module.split(".", maxsplit=1)[0] in PACKAGES
    return next((file for file in files if ours and file.is_file()), None)


@cache
def _imports(path: Path) -> tuple[str, ...]:
    names: list[str] = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(names)
