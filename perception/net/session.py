"""ONNX Runtime sessions as the networks of the vehicle use them."""

from pathlib import Path

import onnxruntime

from trepid.config import InputError


def open_session(network: bytes, path: Path) -> onnxruntime.InferenceSession:
    """A deterministic session on one thread for ``network``, the bytes of ``path``. Raises InputError."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    try:
        return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
    except onnxruntime.capi.onnxruntime_pybind11_state.InvalidProtobuf as error:
        raise InputError(f"{path}: not an ONNX network") from error
