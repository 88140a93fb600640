"""Hashes of the code, the configuration and the libraries that a result depends on."""

import ast
import hashlib
import importlib.metadata
import platform
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

from perception.estimators import entry_of
from trepid.config import CONFIG_DIR, IS_INSTALLED, ROOT, car_folder
from trepid.packages import PACKAGES

LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "onnxruntime", "scikit-fuzzy")
SUFFIXES = (".py", ".yaml", ".yml", ".onnx", ".json")
_DIGITS = 16

TABLE = "perception.techniques.stages"  # imports every stage, of which a pipeline uses a few


def fingerprint(*parts: str) -> str:
    """A hash over code, configuration, versions of the numerical libraries, Python and machine type.

    ``parts`` are files and folders of the repository; default: all packages of Trepid and config/. The files of the
    car that overrides the defaults always count. The hash of a process is computed once: later changes of the files
    do not change the code that it runs.
    """
    return hash_of_files(parts, car_folder())


def short_hash(*texts: str) -> str:
    """A hash for the name of a file that depends on ``texts``."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:12]


@cache
def hash_of_files(parts: tuple[str, ...], car: Path | None) -> str:
    """The hash of :func:`fingerprint` with the files of the folder ``car``, computed once."""
    digest = hashlib.sha256(f"{platform.machine()} {platform.python_version()}".encode())
    for library in LIBRARIES:
        digest.update(f"\0{library}=={importlib.metadata.version(library)}".encode())
    tops = [_top(part) for part in parts or (*PACKAGES, "config")]
    files = [path for top in tops for path in (top.rglob("*") if top.is_dir() else [top])]
    for path in sorted(path for path in files if path.suffix in SUFFIXES and path.is_file()):
        digest.update(f"\0{path.relative_to(ROOT).as_posix()}\0".encode())
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    if car is not None:
        for path in files_of_car(car):
            digest.update(f"\0car/{path.relative_to(car).as_posix()}\0".encode())
            digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()[:_DIGITS]


def files_of_car(car: Path) -> list[Path]:
    """The files in the folder of a car on which results depend, sorted."""
    return sorted(path for path in car.rglob("*") if path.suffix in SUFFIXES and path.is_file())


def _top(part: str) -> Path:
    """The path of a file or folder of the repository; that of ``config/...`` also when installed."""
    first, *rest = Path(part).parts
    return CONFIG_DIR.joinpath(*rest) if first == "config" else ROOT / part


def estimator_fingerprint(name: str) -> str:
    """A hash over what the entry of the estimator ``name`` says that it depends on. Raises InputError."""
    entry = entry_of(name)
    version = hashlib.sha256(entry.version().encode()).hexdigest()[:_DIGITS]
    return f"{fingerprint(*import_closure(entry.modules), *entry.files, 'config/vehicle.yaml')}-{version}"


def import_closure(modules: Iterable[str]) -> list[str]:
    """The files, relative to the repository, of ``modules`` and of all modules of Trepid that they import."""
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


@cache
def _file_of(module: str) -> Path | None:
    """The file of a module of Trepid, or in a checkout of any other module beside it; None for others."""
    if IS_INSTALLED and module.split(".", maxsplit=1)[0] not in PACKAGES:
        return None
    path = ROOT.joinpath(*module.split("."))
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((file for file in files if file.is_file()), None)


@cache
def _imports(path: Path) -> tuple[str, ...]:
    """What a file imports when it runs, in functions too; not what its annotations alone need."""
    names: list[str] = []
    for node in _running(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    return tuple(names)


def _running(tree: ast.AST) -> Iterator[ast.AST]:
    """The statements of ``tree`` but those under ``if TYPE_CHECKING``; expressions import nothing."""
    yield tree
    for child in ast.iter_child_nodes(tree):
        if isinstance(child, ast.expr):
            continue
        if (
            isinstance(child, ast.If)
            and isinstance(child.test, ast.Name)
            and child.test.id == "TYPE_CHECKING"
        ):
            continue
        yield from _running(child)
