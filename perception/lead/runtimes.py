"""Box detectors as files: what picture a network takes, and its run by ONNX Runtime or TensorFlow Lite."""

import ast
import importlib.util
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.net.session import open_session
from trepid.config import InputError
from trepid.types import Floats, Image

COLOURS = 3
MOST_PX = 8192  # a side of the picture: one of floats then takes 0.8 GB
_TYPES: Mapping[str, type[np.generic]] = {
    "tensor(float)": np.float32,
    "tensor(float16)": np.float16,
    "tensor(uint8)": np.uint8,
}


class Input(NamedTuple):
    """The picture that a network takes."""

    width: int
    height: int
    channels_first: bool
    kind: type[np.generic]  # of its numbers; whole ones are 0 to 255

    def pixels(self, image: Image, *, low: float) -> NDArray[np.generic]:
        """``image`` (h, w, 3) BGR as one RGB picture; numbers that are not whole are ``low`` to 1."""
        shrunk = cv2.resize(image, (self.width, self.height), interpolation=cv2.INTER_AREA)
        picture: NDArray[np.generic] = np.asarray(cv2.cvtColor(shrunk, cv2.COLOR_BGR2RGB))[None]
        if not np.issubdtype(self.kind, np.integer):
            picture = (low + (1 - low) / 255 * picture.astype(np.float32)).astype(self.kind)
        if self.channels_first:
            picture = picture.transpose(0, 3, 1, 2)
        return np.ascontiguousarray(picture)


class Network(NamedTuple):
    """An opened network."""

    input: Input
    run: Callable[[NDArray[np.generic]], list[Floats]]
    names: tuple[str, ...] | None  # of its classes, where the file has them


def check_present(path: Path) -> None:
    """Raise InputError where the file of a detector is missing."""
    if not path.is_file():
        raise InputError(f"{path}: no such detector")


def open_network(path: Path) -> Network:
    """The network in ``path``. Raises InputError for a file that is missing, no network, or takes no picture."""
    check_present(path)
    readers = {".onnx": _onnx, ".tflite": _tflite}
    if path.suffix not in readers:
        raise InputError(f"{path}: not a detector; known: {' '.join(readers)}")
    return readers[path.suffix](path)


def _onnx(path: Path) -> Network:
    runner = open_session(path)
    inputs = runner.get_inputs()
    if len(inputs) != 1:
        raise InputError(f"{path}: takes {', '.join(one.name for one in inputs)}, expected one picture alone")
    entry = inputs[0]
    if entry.type not in _TYPES:
        raise InputError(f"{path}: takes numbers of the kind {entry.type}, expected {', '.join(_TYPES)}")
    taken = _input(path, list(entry.shape), _TYPES[entry.type])

    def run(pixels: NDArray[np.generic]) -> list[Floats]:
        return [np.asarray(output, np.float32) for output in runner.run(None, {entry.name: pixels})]

    return Network(taken, run, _names(runner.get_modelmeta().custom_metadata_map.get("names", "")))


def _names(text: str) -> tuple[str, ...] | None:
    """The names of the classes in the metadata that Ultralytics writes, ``{0: 'person', ...}``."""
    try:
        names = ast.literal_eval(text) if text else None
    except (ValueError, SyntaxError):
        return None
    if isinstance(names, dict) and sorted(names) == list(range(len(names))):
        names = [names[number] for number in range(len(names))]
    return tuple(map(str, names)) if isinstance(names, list) and names else None


def _input(path: Path, shape: list[Any], kind: type[np.generic]) -> Input:
    """The picture of ``shape``, a name or -1 where any size fits. Raises InputError."""
    found = f"takes {_shape_text(shape)}"
    if len(shape) != 4 or COLOURS not in (shape[1], shape[3]):
        fits = "expected one picture, (1, 3, height, width) or (1, height, width, 3)"
        raise InputError(f"{path}: {found}, {fits}")
    if isinstance(shape[0], int) and shape[0] > 1:
        raise InputError(f"{path}: {found}, {shape[0]} pictures at a time: export it with a batch of 1")
    channels_first = shape[1] == COLOURS
    height, width = shape[2:] if channels_first else shape[1:3]
    if not all(isinstance(side, int) and 0 < side <= MOST_PX for side in (height, width)):
        raise InputError(f"{path}: {found}: export it with a fixed size of at most {MOST_PX} px a side")
    return Input(width, height, channels_first, kind)


def _shape_text(shape: list[Any]) -> str:
    return f"({', '.join('?' if side is None else str(side) for side in shape)})"


def _tflite(path: Path) -> Network:
    if importlib.util.find_spec("ai_edge_litert") is None:
        raise InputError(f"{path}: needs the extra: pip install -e '.[tflite]'")
    from ai_edge_litert.interpreter import Interpreter

    try:
        runner: Any = Interpreter(str(path), num_threads=1)
    except ValueError as error:
        raise InputError(f"{path}: not a TensorFlow Lite model") from error
    runner.allocate_tensors()
    entries, answers = runner.get_input_details(), runner.get_output_details()
    if len(entries) != 1 or entries[0]["dtype"] not in (np.float32, np.uint8):
        kinds = ", ".join(np.dtype(entry["dtype"]).name for entry in entries)
        raise InputError(f"{path}: takes {kinds}, expected one picture of float32 or uint8")
    entry = entries[0]
    taken = _input(path, [int(side) for side in entry["shape"]], entry["dtype"])

    def run(pixels: NDArray[np.generic]) -> list[Floats]:
        runner.set_tensor(entry["index"], pixels)
        runner.invoke()
        return [_numbers(runner, answer) for answer in answers]

    return Network(taken, run, None)


def _numbers(runner: Any, answer: Any) -> Floats:
    """The output ``answer``, whole numbers of a quantised network as what they stand for."""
    raw = np.asarray(runner.get_tensor(answer["index"]))
    scale, zero = answer["quantization"]
    if scale and np.issubdtype(raw.dtype, np.integer):
        return np.asarray((raw.astype(np.float32) - zero) * scale, np.float32)
    return np.asarray(raw, np.float32)
