"""Networks at run time: sessions of ONNX Runtime, and the record beside the weights."""

import hashlib
from pathlib import Path
from typing import TypeVar

import onnxruntime

from trepid.config import InputError, Settings, load


class WeightsRecord(Settings):
    """Provenance of weights: a JSON file of the same name in the same folder."""

    sha256: str  # of the ONNX file
    parameters: int
    command: str
    date: str
    versions: dict[str, str]


R = TypeVar("R", bound=WeightsRecord)

_ERRORS = onnxruntime.capi.onnxruntime_pybind11_state
_NO_NETWORK = (
    *(_ERRORS.InvalidProtobuf, _ERRORS.InvalidGraph, _ERRORS.InvalidArgument, _ERRORS.Fail),
    *(_ERRORS.NotImplemented, _ERRORS.RuntimeException),
)


def load_record(weights: Path, kind: type[R]) -> R:
    """The record beside ``weights``. Raises InputError when it is missing or belongs to other weights."""
    path = weights.with_suffix(".json")
    record = load(path, kind)  # JSON is YAML
    if weights.is_file() and hashlib.sha256(weights.read_bytes()).hexdigest() != record.sha256:
        raise InputError(f"{path}: describes other weights than {weights.name} (sha256 differs)")
    return record


def open_session(network: bytes, path: Path) -> onnxruntime.InferenceSession:
    """A deterministic session on one thread for ``network``, the bytes of ``path``. Raises InputError."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = 3  # errors; warnings about the graph are no concern of the user
    try:
        return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
    except _NO_NETWORK as error:
        fault = "it computes with a kind of number or an operator that ONNX Runtime lacks"
        unknown = isinstance(error, _ERRORS.NotImplemented)
        raise InputError(f"{path}: {fault if unknown else 'not an ONNX network'}") from error
