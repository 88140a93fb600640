"""Vehicles and people in one frame: the detector interface and the embedded detector.

The embedded detector is a network of 20 000 weights on strips of one scale (:mod:`perception.lead.view`). It gives
for each cell of each strip the probability that the nearer end of a vehicle stands there, and where exactly.
"""

import math
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from perception.lead.view import CELLS_LEFT_M, DISTANCES_M, RATIO, LeadView
from perception.net.session import WeightsRecord, first_run, load_record, open_session
from trepid.car.camera import Camera
from trepid.config import InputError, Settings
from trepid.types import Image

USUAL_WIDTH_M, USUAL_HEIGHT_M = 1.8, 1.5
SAME_AHEAD, SAME_LEFT_M = 1.35, 1.1  # two detections this near (ratio of distances; lateral) are one vehicle
Cells = NDArray[np.float32]
"""Outputs of the network, shape (STRIPS, 4, CELL_COLUMNS): probability, ahead [ln RATIO], left [m], ln(w/1.8 m)."""


class Detection(NamedTuple):
    """The nearer end of a vehicle or another road user on the road, in the frame of the ego rear axle."""

    ahead_m: float
    left_m: float
    width_m: float
    confidence: float  # calibrated probability of it
    height_m: float = USUAL_HEIGHT_M  # no detector measures that of a vehicle
    kind: str = "vehicle"
    ahead_sigma_m: float | None = None  # deviation of ahead_m; None: that of the settings of the tracker

    def scale(self, factor: float) -> "Detection":
        """The detection in a world that is ``factor`` times larger."""
        return self._replace(
            ahead_m=self.ahead_m * factor,
            left_m=self.left_m * factor,
            width_m=self.width_m * factor,
            height_m=self.height_m * factor,
            ahead_sigma_m=None if self.ahead_sigma_m is None else self.ahead_sigma_m * factor,
        )

    def pixels(self, camera: Camera) -> tuple[float, float, float, float] | None:
        """Upright box (left, top, right, bottom) [px] around it; None when it is behind the camera."""
        depth_m = self.ahead_m - camera.x_m
        if depth_m <= 0.1:
            return None
        half_m = self.width_m / 2
        feet = camera.pixel_from_road(
            [(self.ahead_m, self.left_m + half_m), (self.ahead_m, self.left_m - half_m)]
        )
        bottom_px = float(feet[:, 1].mean())
        return (
            float(feet[0, 0]),
            bottom_px - camera.fy_px * self.height_m / depth_m,
            float(feet[1, 0]),
            bottom_px,
        )


class NotFinite(Exception):
    """A network whose outputs for an image are not finite: nothing is known of what the image shows."""


class Detector(Protocol):
    """Vehicles and other road users in a single frame of one camera; stateless."""

    @property
    def text(self) -> str:
        """What it is, and how its file is read, in one line."""
        ...

    @property
    def detects(self) -> tuple[str, ...]:
        """The kinds of road users besides vehicles that it finds at all."""
        ...

    def __call__(self, image: Image) -> list[Detection]:
        """The road users in ``image``, in falling order of confidence. Raises NotFinite."""
        ...


class Platt(Settings):
    """P(right) = 1/(1 + exp(−(bias + slope·ln(p/(1 − p))))): Platt, Probabilistic Outputs for SVMs (1999)."""

    bias: float
    slope: float

    def __call__(self, probability: float) -> float:
        """The calibrated probability for an output ``probability``."""
        p = min(max(probability, 1e-6), 1 - 1e-6)
        return 1 / (1 + math.exp(-(self.bias + self.slope * math.log(p / (1 - p)))))


class Record(WeightsRecord):
    """``lead_net.json``: provenance, calibration and scores of the weights in the same folder."""

    calibration: Platt
    min_probability: float  # least output of a cell that counts
    frames: int
    scores: dict[str, float]
    by_distance: dict[str, dict[str, float]] = Field(default_factory=dict)  # empty: not measured
    by_weather: dict[str, dict[str, float]] = Field(default_factory=dict)


class StripDetector:
    """The embedded detector, of vehicles only."""

    text = "embedded detector"
    detects: tuple[str, ...] = ()

    def __init__(self, weights: Path, camera: Camera) -> None:
        """Raises InputError when the weights are missing or do not agree with their record."""
        if not weights.is_file():
            raise InputError(f"{weights}: no weights of the lead detector; `trepid train-lead` makes them")
        self._record = load_record(weights, Record)
        self._session = open_session(weights)
        self._view, self._camera = LeadView(camera), camera
        grey = np.full((camera.height_px, camera.width_px, 3), 128, np.uint8)
        first_run(weights, lambda: self._cells(grey), lambda cells: [cells])

    def __call__(self, image: Image) -> list[Detection]:
        """The vehicles in ``image``, in falling order of confidence."""
        cells = self._cells(image)
        if not np.isfinite(cells).all():
            raise NotFinite(self.text)
        camera, record = self._camera, self._record
        return [
            Detection(ahead_m + camera.x_m, left_m + camera.y_m, width_m, record.calibration(probability))
            for ahead_m, left_m, width_m, probability in peaks(cells, record.min_probability)
        ]

    def _cells(self, image: Image) -> Cells:
        cells: Cells = self._session.run(None, {"strips": self._view.strips(image)})[0]
        return cells


def peaks(cells: Cells, min_probability: float) -> list[tuple[float, float, float, float]]:
    """Vehicles (ahead [m], left [m], width [m], probability) in the camera frame, in falling order of probability.

    The cell with the highest probability and all cells near its place are one vehicle, whose place is their mean
    weighted by probability.
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
