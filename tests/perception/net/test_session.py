"""A network that cannot be opened is refused with its own fault and remedy; ONNX Runtime sends nothing."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import onnxruntime
import pytest
from table_network_rig import plain, write_table

from perception.net.session import first_run, open_session
from trepid.config import InputError
from trepid.packages import PACKAGES

ROOT = Path(__file__).parents[3]
TABLE = plain(189)[None]


def test_weights_in_a_file_beside_the_network_are_found_from_any_folder(tmp_path, monkeypatch):
    path = write_table(tmp_path / "d.onnx", TABLE, data="d.onnx.data")
    assert (tmp_path / "d.onnx.data").stat().st_size > TABLE.nbytes
    for folder, given in ((Path("/"), path), (tmp_path, Path("d.onnx"))):
        monkeypatch.chdir(folder)
        picture = np.zeros((1, 3, 96, 96), np.float32)
        assert np.array_equal(open_session(given).run(None, {"images": picture})[0], TABLE)


def write_without_data(path):
    write_table(path, TABLE, data="weights.data")
    (path.parent / "weights.data").unlink()


def write_with_short_data(path):
    write_table(path, TABLE, data="weights.data")
    (path.parent / "weights.data").write_bytes(b"\0" * 100)


def write_cut(path):
    write_table(path, TABLE)
    path.write_bytes(path.read_bytes()[:5000])


POINTER = "version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n"
FAULTS = {
    "missing data": (
        write_without_data,
        "its weights, the file weights.data, are missing beside it: copy both files",
    ),
    "short data": (
        write_with_short_data,
        "the file of its weights is too short or belongs to another network (tensor ",
    ),
    "IR": (
        lambda path: write_table(path, TABLE, ir_version=99),
        "its IR version is 99, ONNX Runtime {0} reads up to ",
    ),
    "opset": (
        lambda path: write_table(path, TABLE, opset=60),
        "its opset of ai.onnx is 60, ONNX Runtime {0} computes up",
    ),
    "operator": (
        lambda path: write_table(path, TABLE, domain="trt"),
        "its operator trt:Add is none that ONNX Runtime",
    ),
    "LFS": (
        lambda path: path.write_text(POINTER),
        "a Git LFS pointer, not the file: `git lfs pull` gets it",
    ),
    "empty": (lambda path: path.write_bytes(b""), "is empty: copy or download it again"),
    "web page": (
        lambda path: path.write_text("<!DOCTYPE html>\n<html>"),
        "a web page: download the file itself",
    ),
    "checkpoint": (
        lambda path: path.write_bytes(b"PK\x03\x04data"),
        "a zip archive or PyTorch checkpoint: export it",
    ),
    "TFLite": (lambda path: path.write_bytes(b"\x1c\0\0\0TFL3"), "a TensorFlow Lite model, not ONNX"),
    "text": (lambda path: path.write_text("no network at all"), "not an ONNX network, or cut off"),
    "cut": (write_cut, "not an ONNX network, or cut off"),
    "folder": (lambda path: path.mkdir(), "cannot be read: Is a directory"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_each_fault_of_a_file_has_its_own_line(tmp_path, fault):
    write, text = FAULTS[fault]
    path = tmp_path / "d.onnx"
    write(path)
    with pytest.raises(InputError) as refused:
        open_session(path)
    assert str(refused.value).startswith(f"{path}: {text.format(onnxruntime.__version__)}")
    assert "\n" not in str(refused.value) and "onnxruntime_src" not in str(refused.value)


def test_weights_that_git_lfs_has_not_brought_are_called_so(tmp_path):
    path = write_table(tmp_path / "d.onnx", TABLE, data="weights.data")
    (tmp_path / "weights.data").write_text(POINTER)
    (tmp_path / "another.data").write_text(POINTER)
    with pytest.raises(InputError, match=r"/weights\.data: a Git LFS pointer, not the file: `git lfs pull`"):
        open_session(path)


def test_a_first_run_that_fails_or_is_not_finite_is_refused(tmp_path):
    path = write_table(tmp_path / "d.onnx", TABLE)
    session = open_session(path)
    with pytest.raises(InputError, match=r"d\.onnx: fails on a grey picture: .*images"):
        first_run(path, lambda: session.run(None, {"images": np.zeros((2, 3, 9, 9), np.float32)}), tuple)
    for bad in (np.nan, np.inf):
        with pytest.raises(InputError, match=r"d\.onnx: its outputs for a grey picture are not finite"):
            first_run(path, lambda bad=bad: [np.array([1.0, bad])], tuple)
    assert first_run(path, lambda: [np.array([1.0])], tuple) == [1.0]


OPEN_FILES = """
import os, sys
from pathlib import Path
from perception.net.session import open_session
session = open_session(Path(sys.argv[1]))
files = [f"/proc/self/fd/{number}" for number in os.listdir("/proc/self/fd")]
print(*(os.readlink(file) for file in files if os.path.exists(file)))
"""


def test_onnx_runtime_keeps_no_store_of_what_it_would_send(tmp_path):
    """With its telemetry on, ONNX Runtime queues events in a data base below the home of the user."""
    path = write_table(tmp_path / "d.onnx", TABLE)
    off = {"ORT_DISABLE_TELEMETRY", "CI", "ORT_RUNNING_UNIT_TESTS"}  # each of them turns it off
    variables = {name: value for name, value in os.environ.items() if name not in off}
    variables |= {"HOME": str(tmp_path), "XDG_CACHE_HOME": str(tmp_path / "cache")}
    command = [sys.executable, "-c", OPEN_FILES, str(path)]
    said = subprocess.run(command, env=variables, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    assert "onnxruntime.db" not in said
    assert [each.name for each in tmp_path.rglob("*.db*")] == []


def test_only_one_module_loads_onnx_runtime_by_itself():
    """Loaded elsewhere first, it would read its variables before they are set; its tools are loaded after it."""
    loading = set()
    for file in (each for package in PACKAGES for each in (ROOT / package).rglob("*.py")):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:  # at the import of the module
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            if any(name.split(".")[0] == "onnxruntime" for name in names):
                loading.add(str(file.relative_to(ROOT)))
    assert loading == {"perception/net/session.py"}
