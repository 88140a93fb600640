"""The angles of a model for the frames of a data set, each frame on its own as in a car, on one core."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from learning.dataset.dataset import Dataset, Rows
from learning.dataset.route_camera import route_camera
from learning.judging.scores import Angles
from perception.estimators import NETWORK_SUFFIX, Estimator, entry_of, name_of
from perception.net.driver import DriverNetwork, DrivingEstimator
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Frame
from trepid.types import Image

Answer = tuple[float, float, float, float, float]
"""Angle [rad], interval half width [rad], unlike, confidence, proposed speed [m/s]; NaN where there is none."""
_NONE: Answer = (np.nan, np.nan, np.nan, 0.0, np.nan)


@dataclass(frozen=True, slots=True)
class Predictions:
    """The outputs of a model for n frames; NaN where it gives none."""

    angle_rad: Angles
    interval_rad: Angles  # half width of the 90 % interval
    unlike: Angles
    confidence: Angles
    latency_ms: Angles
    speed_mps: Angles

    @property
    def has_angle(self) -> NDArray[np.bool_]:
        """Whether the model gives an angle, (n,) bool."""
        return np.isfinite(self.angle_rad)


class JudgedModel:
    """A driving network, or an estimator by its name, which may measure the lane."""

    def __init__(self, text: str, camera: Camera | None = None) -> None:
        """``camera``: of the data set, for estimators that need one; None: self-calibrated for each route.

        Raises InputError for an unknown name and for a file that is no driving network.
        """
        self.text, self.name, self._camera = text, name_of(text), camera
        self.network = DriverNetwork(Path(text)) if text.endswith(NETWORK_SUFFIX) else None
        self._entry = None if self.network else entry_of(text)
        self._vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)

    def predict(
        self,
        dataset: Dataset,
        rows: Rows,
        tick: Callable[[], None] = lambda: None,
        change: Callable[[Image], Image] = lambda image: image,
    ) -> Predictions:
        """The predictions for ``rows``, in the order of the index; ``tick`` is called after every frame.

        ``change``: of the images, before the model reads them.
        """
        answers = np.empty((len(rows), len(_NONE)))
        latency_ms = np.empty(len(rows))
        route, step = None, None
        for number, (row, image) in enumerate(zip(rows, dataset.images(rows), strict=True)):
            if step is None or row["route"] != route:
                route = row["route"]
                step = self._stepper(dataset, rows[rows["route"] == route], image)
            changed = change(image)
            began_s = time.perf_counter()
            answers[number] = step(changed, float(row["t_s"]))
            latency_ms[number] = 1e3 * (time.perf_counter() - began_s)
            tick()
        angle_rad, interval_rad, unlike, confidence, speed_mps = answers.T
        return Predictions(angle_rad, interval_rad, unlike, confidence, latency_ms, speed_mps)

    def _stepper(self, dataset: Dataset, rows: Rows, first: Image) -> Callable[[Image, float], Answer]:
        if self.network is not None:
            return _network_step(DrivingEstimator(self.name, self.network, self._vehicle), self.network)
        assert self._entry is not None
        known = self._camera
        camera = known.resize(first.shape[1], first.shape[0]) if known else route_camera(dataset, rows)
        return _estimator_step(self._entry.build(camera, self._vehicle, assumed=known is None))


def _network_step(driver: DrivingEstimator, network: DriverNetwork) -> Callable[[Image, float], Answer]:
    def step(image: Image, t_s: float) -> Answer:
        found = driver.steer(image, t_s)
        if found is None:
            return _NONE
        known = network.record.confidence(found.scale_rad) if found.unlike <= 1.0 else 0.0
        width_rad = network.record.interval_90 * found.scale_rad
        speed_mps = np.nan if found.speed_mps is None else found.speed_mps
        return found.road_wheel_rad, width_rad, found.unlike, known, speed_mps

    return step


def _estimator_step(estimator: Estimator) -> Callable[[Image, float], Answer]:
    def step(image: Image, t_s: float) -> Answer:
        found = estimator.step(Frame(t_s=t_s, image=image), None, now_s=t_s)
        if found.road_wheel_angle_rad is None:
            return _NONE
        speed_mps = np.nan if found.speed_mps is None else found.speed_mps
        return found.road_wheel_angle_rad, np.nan, np.nan, found.confidence, speed_mps

    return step
