"""Networks at run time: sessions of ONNX Runtime, and the record beside the weights.

The official builds of ONNX Runtime send data of every session to Microsoft, unless a variable says otherwise when
the library is loaded. A car sends nothing by itself, so that all of Trepid loads ONNX Runtime here.
"""

import hashlib
import os
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np

from trepid.config import InputError, Settings, load
from trepid.files.decoding import GIT_LFS, MARK_BYTES, other_file

os.environ["ORT_DISABLE_TELEMETRY"] = "1"
import onnxruntime

onnxruntime.disable_telemetry_events()
InferenceSession: TypeAlias = onnxruntime.InferenceSession


class WeightsRecord(Settings):
    """Provenance of weights: a JSON file of the same name in the same folder."""

    sha256: str  # of the ONNX file
    parameters: int
    command: str
    date: str
    versions: dict[str, str]


R = TypeVar("R", bound=WeightsRecord)
A = TypeVar("A")

_ERRORS = onnxruntime.capi.onnxruntime_pybind11_state
_OPENING = (
    *(_ERRORS.InvalidProtobuf, _ERRORS.InvalidGraph, _ERRORS.InvalidArgument, _ERRORS.Fail),
    *(_ERRORS.NotImplemented, _ERRORS.RuntimeException, _ERRORS.NoSuchFile),
)
RUN_FAILURES: tuple[type[Exception], ...] = (
    *(ValueError, IndexError, _ERRORS.Fail, _ERRORS.InvalidArgument),
    *(_ERRORS.NotImplemented, _ERRORS.RuntimeException),
)
_ZIPPED = {b"PK\x03\x04": "a zip archive or PyTorch checkpoint: export it to ONNX (`torch.onnx.export`)"}
_VERSION = onnxruntime.__version__
_FAULTS = (
    (
        r"Unsupported model IR version: (\d+), max supported IR version: (\d+)",
        f"its IR version is {{0}}, ONNX Runtime {_VERSION} reads up to {{1}}: save it with an older one"
        " (`model.ir_version = {1}`), or update onnxruntime",
    ),
    (
        r"Opset (\d+) is under development.*domain (\S+) is till opset (\d+)",
        f"its opset of {{1}} is {{0}}, ONNX Runtime {_VERSION} computes up to {{2}}: export with"
        " `opset_version={2}` or less, or update onnxruntime",
    ),
    (
        r'External data path does not exist: "?(?:[^"\n]*/)?([^"/\n]+)',
        "its weights, the file {0}, are missing beside it: copy both files",
    ),
    (
        r"External initializer: (\S+) .*out of bounds",
        "the file of its weights is too short or belongs to another network (tensor {0})",
    ),
    (r"(\S+)\(-?\d+\) is not a registered", "its operator {0} is none that ONNX Runtime has"),
    (r"No Op registered for (\S+) with domain_version of (\d+)", "its operator {0} is not in its opset, {1}"),
)
"""What ONNX Runtime says, and what to say of it."""
_LENGTH = 200


def load_record(weights: Path, kind: type[R]) -> R:
    """The record beside ``weights``. Raises InputError when it is missing or belongs to other weights."""
    path = weights.with_suffix(".json")
    record = load(path, kind)  # JSON is YAML
    if weights.is_file() and hashlib.sha256(weights.read_bytes()).hexdigest() != record.sha256:
        raise InputError(f"{path}: describes other weights than {weights.name} (sha256 differs)")
    return record


def open_session(path: Path) -> InferenceSession:
    """A deterministic session on one thread for the network in ``path``, with the data in files beside it.

    Raises InputError with the fault of the file and, where there is one, the remedy.
    """
    fault = _fault_before(path)
    if fault:
        raise InputError(f"{path}: {fault}")
    try:
        return session_of(path)
    except _OPENING as error:
        pointer = _pointer_beside(path) if "External" in str(error) else None
        if pointer is not None:
            raise InputError(f"{pointer}: {other_file(GIT_LFS)}") from error
        raise InputError(f"{path}: {_fault_of(error)}") from error


def session_of(network: bytes | Path) -> InferenceSession:
    """A deterministic session on one thread for a file or for the bytes of a network without further files.

    Raises what ONNX Runtime raises.
    """
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors; warnings about the graph are no concern of the user
    source = str(network) if isinstance(network, Path) else network
    return onnxruntime.InferenceSession(source, options, providers=["CPUExecutionProvider"])


def first_run(path: Path, run: Callable[[], A], arrays: Callable[[A], Sequence[Any]]) -> A:
    """What ``run`` gives for a grey picture, through the code that serves the frames of a drive.

    ``arrays``: the numbers in it. Raises InputError where the network of ``path`` fails, or its outputs are not
    finite.
    """
    try:
        found = run()
    except RUN_FAILURES as error:
        raise InputError(f"{path}: fails on a grey picture: {line_of(error)}") from error
    if not all(np.isfinite(array).all() for array in arrays(found)):
        raise InputError(f"{path}: its outputs for a grey picture are not finite")
    return found


def line_of(error: BaseException) -> str:
    """The text of ``error`` in one line, without places in the source of ONNX Runtime, at most 200 characters."""
    text = re.sub(r"^\[ONNXRuntimeError\] : \d+ : \w+ : ", "", str(error))
    text = re.sub(r"Load model from \S+ failed:|\S+\.(?:cc|h):\d+ ", "", text)
    return " ".join(text.split())[:_LENGTH]


def _fault_before(path: Path) -> str:
    """What the first bytes say against ``path``; "" for nothing."""
    try:
        with path.open("rb") as file:
            start = file.read(MARK_BYTES)
    except OSError as error:
        return f"cannot be read: {error.strerror}"
    if not start:
        return "is empty: copy or download it again"
    if start[4:8] == b"TFL3":
        return "a TensorFlow Lite model, not ONNX: only detectors (`.tflite`) are read from these"
    return other_file(start, _ZIPPED)


def _pointer_beside(path: Path) -> Path | None:
    """The first file beside ``path`` whose name the network has and whose content Git LFS has not brought yet."""
    network = path.read_bytes()
    for file in sorted(path.parent.iterdir()):
        if file.name.encode() in network and file.is_file():
            with file.open("rb") as opened:
                if opened.read(len(GIT_LFS)) == GIT_LFS:
                    return file
    return None


def _fault_of(error: Exception) -> str:
    """One line for a failure of opening."""
    text = str(error)
    for said, fault in _FAULTS:
        if found := re.search(said, text, re.DOTALL):
            return fault.format(*found.groups())
    if isinstance(error, _ERRORS.NotImplemented):
        return "it computes with a kind of number or an operator that ONNX Runtime lacks"
    if isinstance(error, _ERRORS.InvalidProtobuf) or "No graph was found" in text:
        return "not an ONNX network, or cut off"
    return f"not an ONNX network that runs: {line_of(error)}"
