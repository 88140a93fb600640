"""Whether a stored result is older than the code: which files that it depends on have changed since its commit.

A benchmark depends on its module and all modules of Trepid that this imports, and on the files of ``config/`` that
one of them names; one that imports no node runs the command line, and depends on all packages. Of a stored result
the commit is known, so that git tells what has changed, and nothing has to be stored beside it. A change of a
comment counts: whether it matters is for a reader to say.
"""

import subprocess
from collections.abc import Mapping
from functools import cache

from lab.bench.catalogue import BENCHMARKS
from sim_harness.sweep.fingerprint import import_closure
from trepid.config import CONFIG_DIR, ROOT
from trepid.packages import PACKAGES

NODES = ("perception/", "supervisor/", "controller/", "vehicle/", "learning/")
TEMPLATES = "config/cars/"  # of cars, which no benchmark drives by the name of a file


@cache
def files_of(name: str) -> frozenset[str]:
    """The files, relative to the repository, that a result of the benchmark ``name`` depends on."""
    found = {*import_closure([f"lab.bench.{BENCHMARKS[name].module}"])}
    if not any(path.startswith(NODES) for path in found):
        found |= {
            path.relative_to(ROOT).as_posix() for top in PACKAGES for path in (ROOT / top).rglob("*.py")
        }
    return frozenset(found.union(*map(_named_settings, found)))


@cache
def _settings() -> dict[str, str]:
    """Path below ``config/`` -> name, of all files of settings and weights."""
    found = (path for path in CONFIG_DIR.rglob("*") if path.suffix in (".yaml", ".onnx", ".json"))
    names = {f"config/{path.relative_to(CONFIG_DIR).as_posix()}": path.name for path in found}
    return {path: name for path, name in names.items() if not path.startswith(TEMPLATES)}


@cache
def _named_settings(path: str) -> frozenset[str]:
    """The files of ``config/`` whose name stands in a module."""
    text = (ROOT / path).read_text(encoding="utf-8")
    return frozenset(file for file, name in _settings().items() if name in text)


@cache
def changes_since(commit: str) -> frozenset[str] | None:
    """The files that differ from ``commit`` now; None where git does not know it, or where there is no checkout."""
    try:
        found = subprocess.run(
            ["git", "diff", "--name-only", commit, "--"], cwd=ROOT, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return frozenset(found.stdout.splitlines())


def age_sentence(name: str, commit: str) -> str:
    """The sentence about the age of a result of the benchmark ``name`` at ``commit``; "" for a new one.

    A commit that ends with + had changes that are not known, so that it cannot be compared.
    """
    if commit.endswith("+"):
        return "It was measured with changes that no commit has, so that it may be older than the code."
    changed = changes_since(commit)
    if changed is None:
        return f"The commit {commit} is not known here, so that it may be older than the code."
    files = files_of(name)
    since = sorted(
        files & changed, key=lambda path: (path.startswith("lab/"), not path.endswith(".py"), path)
    )
    if not since:
        return ""
    return (
        f"It is older than the code: {len(since)} of the {len(files)} files that it rests on have changed since,"
        f" such as `{since[0]}`."
    )


def ages(commits: Mapping[str, str]) -> dict[str, str]:
    """The sentence of every benchmark of ``commits`` that is older than the code, or may be."""
    found = {name: age_sentence(name, commit) for name, commit in commits.items()}
    return {name: sentence for name, sentence in found.items() if sentence}


def with_ages(page: str, sentences: Mapping[str, str]) -> str:
    """The page of results in Markdown with the sentence of each old result below its heading."""
    lines: list[str] = []
    for line in page.split("\n"):
        lines.append(line)
        name = line.removeprefix("## ")
        if line.startswith("## ") and name in sentences:
            lines += ["", f"*{sentences[name]}*"]
    return "\n".join(lines)
