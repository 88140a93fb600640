"""Vehicles in one frame: what detectors answer, and the embedded one.

The embedded detector is a network of 17 000 weights on strips of one scale (:mod:`perception.lead.view`). It gives
for each cell of each strip the probability that the nearer end of a vehicle stands there, and where exactly.
"""

import hashlib
import math
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from perception.lead.view import CELLS_LEFT_M, DISTANCES_M, RATIO, LeadView
from trepid.camera import Camera
from trepid.config import InputError, Settings, load
from trepid.types import Image

USUAL_WIDTH_M = 1.8
SAME_AHEAD, SAME_LEFT_M = 1.35, 1.1  # two answers this near (ratio of distances; aside) are one vehicle
Cells = NDArray[np.float32]
"""Answers of the network, shape (STRIPS, 4, CELL_COLUMNS): probability, ahead [ln RATIO], left [m], ln(w/1.8 m)."""


class Detection(NamedTuple):
    """The nearer end of a vehicle, on the road, seen from our rear axle."""

    ahead_m: float
    left_m: float
    width_m: float
    confidence: float  # probability that there is one, calibrated

    def pixels(self, camera: Camera, height_m: float = 1.5) -> tuple[float, float, float, float] | None:
        """Upright box (left, top, right, bottom) [px] around it; None when it is not before the camera."""
        depth_m = self.ahead_m - camera.x_m
        if depth_m <= 0.1:
            return None
        half_m = self.width_m / 2
        feet = camera.pixel_from_road(
            [(self.ahead_m, self.left_m + half_m), (self.ahead_m, self.left_m - half_m)]
        )
        bottom_px = float(feet[:, 1].mean())
        return float(feet[0, 0]), bottom_px - camera.fy_px * height_m / depth_m, float(feet[1, 0]), bottom_px


class Detector(Protocol):
    """Finds vehicles in a frame of the camera that it was made for. Remembers nothing."""

    def __call__(self, image: Image) -> list[Detection]:
        """The vehicles in ``image``, the surest first."""
        ...


class Platt(Settings):
    """P(right) = 1/(1 + exp(−(bias + slope·ln(p/(1 − p))))): Platt, Probabilistic Outputs for SVMs (1999)."""

    bias: float
    slope: float

    def __call__(self, probability: float) -> float:
        """The share of answers of this ``probability`` that are right."""
        p = min(max(probability, 1e-6), 1 - 1e-6)
        return 1 / (1 + math.exp(-(self.bias + self.slope * math.log(p / (1 - p)))))


class Record(Settings):
    """``lead_net.json``: what the weights beside it are, how they came about and how good they are."""

    sha256: str  # of the ONNX file
    parameters: int
    calibration: Platt
    min_probability: float  # of a cell that is looked at
    command: str
    date: str
    versions: dict[str, str]
    frames: int
    scores: dict[str, float]


class StripDetector:
    """The embedded detector."""

    def __init__(self, weights: Path, camera: Camera) -> None:
        """Raises InputError when the weights are missing or do not agree with their record."""
        if not weights.is_file():
            raise InputError(f"{weights}: no weights of the lead detector; `trepid train-lead` makes them")
        self._record = load(weights.with_suffix(".json"), Record)
        network = weights.read_bytes()
        if hashlib.sha256(network).hexdigest() != self._record.sha256:
            raise InputError(f"{weights.with_suffix('.json')}: describes other weights than {weights.name}")
        self._session = session(network, weights)
        self._view, self._camera = LeadView(camera), camera

    def __call__(self, image: Image) -> list[Detection]:
        """The vehicles in ``image``, the surest first."""
        cells = self._session.run(None, {"strips": self._view.strips(image)})[0]
        camera, record = self._camera, self._record
        return [
            Detection(ahead_m + camera.x_m, left_m + camera.y_m, width_m, record.calibration(probability))
            for ahead_m, left_m, width_m, probability in peaks(cells, record.min_probability)
        ]


def peaks(cells: Cells, min_probability: float) -> list[tuple[float, float, float, float]]:
    """Vehicles (ahead [m], left [m], width [m], probability) seen from the camera, the surest first.

    The surest cell stands for a vehicle and takes all cells with it that mean the same one; its place is their
    mean, weighted by probability.
    """
    probability = cells[:, 0]
    strip, column = np.nonzero(probability >= min_probability)
    p = probability[strip, column].astype(float)
    log_m = np.log(DISTANCES_M[strip]) + math.log(RATIO) * cells[strip, 1, column]
    left_m = CELLS_LEFT_M[column] + cells[strip, 2, column]
    log_width = cells[strip, 3, column]
    found, free = [], np.ones(len(p), bool)
    for best in np.argsort(-p, kind="stable"):
        if not free[best]:
            continue
        near_m = math.exp(log_m[best])
        aside_m = SAME_LEFT_M + 0.02 * near_m
        same = free & (np.abs(log_m - log_m[best]) < math.log(SAME_AHEAD))
        same &= np.abs(left_m - left_m[best]) < aside_m
        free &= ~same
        weight = p[same] / p[same].sum()
        found.append(
            (
                math.exp(float(weight @ log_m[same])),
                float(weight @ left_m[same]),
                USUAL_WIDTH_M * math.exp(float(weight @ log_width[same])),
                float(p[best]),
            )
        )
    return found


def session(network: bytes, path: Path) -> onnxruntime.InferenceSession:
    """An ONNX network on one thread, deterministic. Raises InputError when ``network`` is none."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    try:
        return onnxruntime.InferenceSession(network, options, providers=["CPUExecutionProvider"])
    except onnxruntime.capi.onnxruntime_pybind11_state.InvalidProtobuf as error:
        raise InputError(f"{path}: not an ONNX network") from error
