"""What a program of the project loads: its modules in ``sys.modules``, and their lines of code."""

import ast
import io
import json
import os
import subprocess
import sys
import tokenize
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from trepid.config import ROOT
from trepid.packages import PACKAGES

LISTS = (
    "import sys; found = {name: module.__file__ for name, module in [*sys.modules.items()]"
    " if getattr(module, '__file__', None)}; import json; print(json.dumps(found))"
)
SPACE = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}


def lines_of_code(text: str) -> int:
    """Lines of ``text`` without blanks, comments and docstrings."""
    docs: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            first = node.body[0] if node.body and ast.get_docstring(node, clean=False) is not None else None
            docs |= set(range(first.lineno, (first.end_lineno or 0) + 1)) if first else set()
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    code = {line for one in tokens if one.type not in SPACE for line in range(one.start[0], one.end[0] + 1)}
    return len(code - docs)


@cache
def lines_of_file(file: str) -> int:
    """Lines of code of a file, counted once: most modules are loaded by many programs."""
    return lines_of_code(Path(file).read_text())


def loaded_modules(statements: str, environment: Mapping[str, str]) -> dict[str, int]:
    """The modules of the project that a process holds after ``statements``, and their lines of code."""
    done = subprocess.run(
        [sys.executable, "-c", f"{statements}\n{LISTS}"],
        cwd=ROOT,
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    files = json.loads(done.stdout.splitlines()[-1])
    return {
        name: lines_of_file(file)
        for name, file in files.items()
        if name.split(".")[0] in PACKAGES and Path(file).suffix == ".py"
    }
