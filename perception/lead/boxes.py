"""Vehicles, people, cyclists and animals from a box detector in an ONNX or TensorFlow Lite file.

The lower edge of a box is where it stands on the road; the camera geometry turns it into metres
 (Stein, Mano and Shashua, Vision-based ACC with a Single Camera, IEEE Intelligent Vehicles 2003).
"""

import importlib.util
import itertools
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Annotated, Any, Literal

import cv2
import numpy as np
from pydantic import AfterValidator, BeforeValidator, Field

from perception.lead.detection import Detection, Platt
from perception.lead.kinds import KINDS, VEHICLE, Box, detected_kinds, standing, with_cyclists
from perception.net.session import open_session
from trepid.car.camera import Camera
from trepid.config import InputError, Settings
from trepid.spelling import did_you_mean
from trepid.types import Floats, Image, OpenShare

Boxes = tuple[Floats, Floats]
"""Corners (n, 4) as left, top, right, bottom in shares of the picture, and scores (n, classes)."""
Model = Callable[[Floats], list[Floats]]
NMS_OVERLAP = 0.5
WIDTH_M = (1.0, 4.0)  # of vehicles: a motorcycle to a truck at an angle
FARTHEST_M = 120.0
BONNET_SHARE = 0.95  # of the image


def _of_vehicles(classes: Any) -> Any:
    """The form of earlier versions, which detected vehicles only, as a mapping."""
    return classes if isinstance(classes, Mapping) else {VEHICLE: classes}


def _are_kinds(classes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, ...]]:
    unknown = [kind for kind in classes if kind not in KINDS]
    if unknown:
        raise ValueError(f"unknown kind {unknown[0]!r}; {did_you_mean(unknown[0], KINDS)}")
    if not any(classes.values()):
        raise ValueError("no class of any kind")
    return classes


class BoxSettings(Settings):
    """Section ``boxes`` of ``config/lead.yaml``."""

    layout: Literal["ssd", "yolo"]
    # kind of perception.lead.kinds -> its classes; a list is that of vehicles
    classes: Annotated[dict[str, tuple[int, ...]], BeforeValidator(_of_vehicles), AfterValidator(_are_kinds)]
    min_score: OpenShare
    tile_share: Annotated[float, Field(gt=0, le=1)]  # 1: no second detection around the horizon
    calibration: Platt = Platt(
        bias=0.0, slope=1.0
    )  # of the scores to probabilities; these values change nothing

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds with classes."""
        return tuple(kind for kind, classes in self.classes.items() if classes)


class BoxDetector:
    """A box detector for one camera."""

    def __init__(self, path: Path, settings: BoxSettings, camera: Camera) -> None:
        """Raises InputError when the file is missing, of another kind, or its runtime is not installed."""
        if not path.is_file():
            raise InputError(f"{path}: no such detector")
        readers = {".onnx": _onnx, ".tflite": _tflite}
        if path.suffix not in readers:
            raise InputError(f"{path}: not a detector; known: {' '.join(readers)}")
        self._model, self._shape = readers[path.suffix](path)
        self._settings, self._camera = settings, camera
        self._decode = {"ssd": ssd_boxes, "yolo": yolo_boxes}[settings.layout]
        self._classes = [number for classes in settings.classes.values() for number in classes]
        self._kinds = [kind for kind, classes in settings.classes.items() for _ in classes]

    @property
    def detects(self) -> tuple[str, ...]:
        """The kinds of road users besides vehicles that it finds at all."""
        return detected_kinds(self._settings.kinds)

    def __call__(self, image: Image) -> list[Detection]:
        """The road users in ``image``, in falling order of confidence."""
        boxes = self.boxes(image)
        seen = [on_road(self._camera, b.corners, b.confidence) for b in boxes if b.kind == VEHICLE]
        seen += [standing(self._camera, box) for box in with_cyclists(boxes)]
        return sorted(filter(None, seen), key=lambda detection: -detection.confidence)

    def boxes(self, image: Image) -> list[Box]:
        """The boxes in ``image``, those of a kind without overlaps."""
        found: dict[str, list[tuple[Floats, float]]] = {kind: [] for kind in self._kinds}
        for left, top, right, bottom in self._tiles():
            corners, scores = self._look(image[top:bottom, left:right])
            scale = np.array([right - left, bottom - top] * 2, np.float32)
            shift = np.array([left, top] * 2, np.float32)
            for kind in found:
                best = scores[:, [k == kind for k in self._kinds]].max(axis=1)
                sure = best >= self._settings.min_score
                found[kind] += zip(corners[sure] * scale + shift, best[sure].tolist(), strict=True)
        probability = self._settings.calibration
        return [
            Box(kind, some[i][0], probability(some[i][1]))
            for kind, some in found.items()
            for i in _suppressed(some, self._settings.min_score)
        ]

    def _tiles(self) -> list[tuple[int, int, int, int]]:
        """The whole image, and a part around the horizon in which far vehicles are larger."""
        width, height = self._camera.width_px, self._camera.height_px
        tiles = [(0, 0, width, height)]
        share = self._settings.tile_share
        if share < 1:
            w, h = round(width * share), round(height * share)
            left = round(min(max(self._camera.cx_px - w / 2, 0), width - w))
            top = round(min(max(self._camera.horizon_row_px - h / 3, 0), height - h))
            tiles.append((left, top, left + w, top + h))
        return tiles

    def _look(self, image: Image) -> Boxes:
        channels_first = self._shape[1] == 3
        height, width = self._shape[2:] if channels_first else self._shape[1:3]
        shrunk = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
        colours = np.asarray(cv2.cvtColor(shrunk, cv2.COLOR_BGR2RGB), np.float32)[None]
        low = -1.0 if self._settings.layout == "ssd" else 0.0  # SSD takes -1..1, YOLO 0..1
        pixels = (low + (1 - low) / 255 * colours).astype(np.float32)
        if channels_first:
            pixels = np.ascontiguousarray(pixels.transpose(0, 3, 1, 2))
        corners, scores = self._decode(self._model(pixels), self._classes, (width, height))
        sure = scores.max(axis=1) >= self._settings.min_score
        return corners[sure], scores[sure]


def on_road(camera: Camera, corners: Sequence[float] | Floats, confidence: float) -> Detection | None:
    """The vehicle of a box [px]; None where it would not stand on the road or not have the width of a vehicle.

    A box as wide as the image that ends at its lower edge is the bonnet of the ego vehicle.
    """
    left, _, right, bottom = (float(c) for c in corners)
    if right - left >= BONNET_SHARE * camera.width_px and bottom >= BONNET_SHARE * camera.height_px:
        return None
    feet = camera.road_from_pixel([(left, bottom), (right, bottom)])
    ahead_m, left_m = feet.mean(axis=0).tolist()
    if not camera.x_m < ahead_m <= FARTHEST_M:
        return None
    width_m = float(np.hypot(*(feet[0] - feet[1])))
    if not WIDTH_M[0] <= width_m <= WIDTH_M[1]:
        return None
    return Detection(ahead_m, left_m, width_m, min(max(confidence, 1e-3), 1 - 1e-3))


def ssd_boxes(outputs: list[Floats], classes: Sequence[int], size: tuple[int, int]) -> Boxes:
    """Boxes of raw SSD outputs: encodings (1, n, 4) and class logits (1, n, c), by TensorFlow's box coder.

    y = y_a + h_a·t_y/10, h = h_a·exp(t_h/5), likewise x and w; Liu et al., SSD (ECCV 2016), section 2.2.
    """
    encoded = next(o for o in outputs if o.shape[-1] == 4)[0]
    logits = next(o for o in outputs if o.shape[-1] != 4)[0]
    anchors = ssd_anchors(size[0])
    centre = anchors[:, :2] + anchors[:, 2:] * encoded[:, :2] / 10  # y, x
    half = anchors[:, 2:] * np.exp(encoded[:, 2:] / 5) / 2
    corners = np.column_stack([(centre - half)[:, ::-1], (centre + half)[:, ::-1]]).astype(np.float32)
    scores = 1 / (1 + np.exp(-logits[:, list(classes)]))
    return corners, scores.astype(np.float32)


@cache
def ssd_anchors(size_px: int) -> Floats:
    """Anchors (n, 4) as y, x, height, width: six layers, scales 0.2 to 0.95, the lowest layer with three shapes."""
    scales = np.append(np.linspace(0.2, 0.95, 6), 1.0)
    rows: list[tuple[float, float, float, float]] = []
    cells = -(-size_px // 16)
    for layer in range(6):
        if layer == 0:
            shapes = [(0.1, 1.0), (scales[0], 2.0), (scales[0], 0.5)]
        else:
            shapes = [(scales[layer], ratio) for ratio in (1.0, 2.0, 0.5, 3.0, 1 / 3)]
            shapes.append((float(np.sqrt(scales[layer] * scales[layer + 1])), 1.0))
        for y, x in itertools.product(range(cells), repeat=2):
            rows += [
                ((y + 0.5) / cells, (x + 0.5) / cells, scale / ratio**0.5, scale * ratio**0.5)
                for scale, ratio in shapes
            ]
        cells = -(-cells // 2)
    return np.array(rows, np.float32)


def yolo_boxes(outputs: list[Floats], classes: Sequence[int], size: tuple[int, int]) -> Boxes:
    """Boxes of one table (1, 4 + c, n) or (1, n, 4 + c): centre, width and height [px], then a score a class."""
    table = outputs[0][0]
    table = table.T if table.shape[0] < table.shape[1] else table
    centre, half = table[:, :2], table[:, 2:4] / 2
    scale = np.array([*size, *size], np.float32)
    corners = np.column_stack([centre - half, centre + half]) / scale
    return corners.astype(np.float32), table[:, [4 + c for c in classes]]


def _suppressed(found: list[tuple[Floats, float]], min_score: float) -> list[int]:
    """Indices in ``found`` of the boxes that non-maximum suppression keeps."""
    if not found:
        return []
    boxes = [(b[0], b[1], b[2] - b[0], b[3] - b[1]) for b, _ in found]
    kept = cv2.dnn.NMSBoxes(boxes, [score for _, score in found], min_score, NMS_OVERLAP)
    return [int(i) for i in np.asarray(kept).ravel()]


def _onnx(path: Path) -> tuple[Model, tuple[int, ...]]:
    runner = open_session(path.read_bytes(), path)
    entry = runner.get_inputs()[0]
    if len(entry.shape) != 4 or not all(isinstance(side, int) for side in entry.shape[1:]):
        raise InputError(f"{path}: takes {entry.shape}, not one image of a fixed size")
    return lambda pixels: runner.run(None, {entry.name: pixels}), tuple(entry.shape)


def _tflite(path: Path) -> tuple[Model, tuple[int, ...]]:
    if importlib.util.find_spec("ai_edge_litert") is None:
        raise InputError(f"{path}: needs the extra: pip install -e '.[tflite]'")
    from ai_edge_litert.interpreter import Interpreter

    try:
        runner: Any = Interpreter(str(path), num_threads=1)
    except ValueError as error:
        raise InputError(f"{path}: not a TensorFlow Lite model") from error
    runner.allocate_tensors()
    entry, answers = runner.get_input_details()[0], runner.get_output_details()

    def run(pixels: Floats) -> list[Floats]:
        runner.set_tensor(entry["index"], pixels)
        runner.invoke()
        return [runner.get_tensor(answer["index"]) for answer in answers]

    return run, tuple(int(side) for side in entry["shape"])
