"""The CNN estimator: a PilotNet-sized network that reads the lane from one frame, run by ONNX Runtime.

Layers as in Bojarski et al., End to End Learning for Self-Driving Cars (2016). The outputs are the lane
state, so that vehicle, look-ahead and camera can change without training, and its standard deviation (Kendall
and Gal, What Uncertainties Do We Need, NIPS 2017). Confidence is the probability, calibrated on roads outside
the training set, that the error of κ_cmd is below that of ``tolerance_rad`` at the wheels of the car of the
calibration: a matter of the path, not of the wheelbase of the car that drives.
"""

import math
from copy import copy
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Annotated, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from perception.lane.settings import steering_settings
from perception.net.canonical import MIRRORED, CanonicalView, lane_of_row
from perception.net.session import WeightsRecord, first_run, load_record, open_session
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle, road_wheel_angle
from trepid.clothoid import Lane
from trepid.config import InputError, Settings, resource
from trepid.messages import SIGMA_AHEAD_M, Frame, SteeringEstimate, VehicleState
from trepid.types import Image, Positive, Share

NAME = "cnn"
OUTPUTS = ("lane", "command_sigma_1pm", "visible", "unlike", "carriageway")
UNSURE = "the network detects a road, but the confidence of its lane is too low"
BETWEEN_WAYS = "the lane of the network lies in the middle of a road for both ways"
BARE = 0.7, 0.9  # probabilities of "no lines" that count not at all and in full: snow hides lines
IN_MIDDLE = 1 / 10, 1 / 6  # distances from it, as shares of the road; the middle of one half lies at 1/4


class SteerNetSettings(Settings):
    """``config/steer_net.yaml``."""

    weights: str
    min_visible: Share
    lane_width_m: tuple[Positive, Positive, Positive, Positive]
    both_ways_m: tuple[Positive, Positive, Positive, Positive] = (5.0, 5.4, 7.6, 8.2)

    def width_share(self, width_m: float) -> float:
        """1 for the width of a lane, 0 for one that no lane has, linear between."""
        return float(np.interp(width_m, self.lane_width_m, (0, 1, 1, 0)))

    def middle_share(self, width_m: float, aside_share: float, bare: float) -> float:
        """1 for a lane in the middle of a road for both ways without lines, 0 on another road or in its half.

        ``width_m``: of the road; ``aside_share``: distance of the lane from its middle, as a share of the width;
        ``bare``: probability that the road has no lines.
        """
        both = np.interp(width_m, self.both_ways_m, (0, 1, 1, 0))
        return float(both * np.interp(aside_share, IN_MIDDLE, (1, 0)) * np.interp(bare, BARE, (0, 1)))

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        for name in ("lane_width_m", "both_ways_m"):
            if not all(one < other for one, other in pairwise(getattr(self, name))):
                raise ValueError(f"{name}: expected increasing widths")
        return self


class Calibration(Settings):
    """P(|road-wheel angle error| < tolerance) = 1/(1 + exp(−(bias + slope·ln(tolerance/σ)))): Platt scaling.

    The angle is that of a car of ``wheelbase_m``. A record without it is that of the default car.
    """

    tolerance_rad: Annotated[float, Field(gt=0)]
    wheelbase_m: Positive = 1.75  # config/vehicle.yaml
    bias: float
    slope: Annotated[float, Field(gt=0)]

    def probability(self, sigma_rad: float) -> float:
        """Probability of an error below ``tolerance_rad`` at the predicted deviation ``sigma_rad``."""
        logit = self.bias + self.slope * math.log(self.tolerance_rad / sigma_rad)
        return 1 / (1 + math.exp(-max(min(logit, 50.0), -50.0)))


class World(Settings):
    """Distances of images from those of training: in their world up to ``near``, outside from ``far`` on."""

    near: Annotated[float, Field(gt=0)]
    far: Annotated[float, Field(gt=0)]

    def share(self, distance: float) -> float:
        """1 within the world, 0 outside, linear between."""
        return float(np.interp(distance, (self.near, self.far), (1, 0)))


class Outputs(NamedTuple):
    """Outputs of the network for n images."""

    # (n, 5): offset [m], heading [rad], curvature at the axle and at ``lane_lookahead_m``, width [m]
    lanes: NDArray[np.float32]
    command_sigma_1pm: NDArray[np.float32]  # (n,): standard deviation of κ_cmd
    visible: NDArray[np.float32]  # (n,): probability of a road
    unlike: NDArray[np.float32]  # (n,): distance from the images of training, 0 to 1
    carriageway: NDArray[np.float32]  # (n, 3): offset from its middle and width [m], share of "no lines"


class SteerNetRecord(WeightsRecord):
    """``steer_net.json``: provenance, calibration and scores of the weights in the same folder."""

    camera: Camera  # the canonical camera
    lane_lookahead_m: Annotated[float, Field(gt=0)]  # the fourth output is the curvature here
    lane_width_m: tuple[float, float]  # of the training roads, seen from the height of the canonical camera
    calibration: Calibration
    world: World
    recipe: dict[str, object]
    training: dict[str, float]
    scores: dict[str, dict[str, float]]  # name of the test set -> metric -> value


def misfit(settings: SteerNetSettings, camera: Camera, vehicle: Vehicle) -> str:
    """How the image of the lanes of ``vehicle`` in ``camera`` differs from those of training; "" if it does not.

    An image has no scale: from a camera at the height h a lane of width w has the image of a lane of width w·h_c/h
    from the canonical height h_c, for a car of any size. Compared to the centimetre, as the text says it.
    """
    weights = resource(Path(settings.weights))
    if not weights.is_file():
        return ""  # the constructor reports it
    record = load_record(weights, SteerNetRecord)
    low_m, high_m = record.lane_width_m
    seen_m = round(vehicle.lane_width_m * record.camera.height_m / camera.height_m, 2)
    if low_m <= seen_m <= high_m:
        return ""
    return (
        f"lanes of {vehicle.lane_width_m:g} m seen from {camera.height_m:g} m look like {seen_m:g} m from"
        f" {record.camera.height_m:g} m, where {weights.name} was trained on {low_m:g} to {high_m:g} m"
    )


def ahead_sigma_m(command_sigma_1pm: float, lookahead_m: float) -> tuple[float, ...]:
    """Standard deviation [m] of the lane centre at SIGMA_AHEAD_M, from σ_κ of κ_cmd = 2·y/ℓ² at ``lookahead_m``.

    At the look-ahead ℓ₀ the arc gives σ_y = σ_κ·ℓ₀²/2. The shares of offset (constant in ℓ), heading (∝ ℓ) and
    curvature (∝ ℓ²) in the error are not known, so each distance gets the greatest of the three:
    σ_y(ℓ) = σ_y(ℓ₀)·max(1, (ℓ/ℓ₀)²).
    """
    aim_sigma_m = command_sigma_1pm * lookahead_m**2 / 2
    return tuple(aim_sigma_m * max(1.0, (ahead_m / lookahead_m) ** 2) for ahead_m in SIGMA_AHEAD_M)


class Network:
    """The ONNX graph: images of the canonical camera to lane, standard deviation and visibility."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when the file is missing or is not a network."""
        if not path.is_file():
            raise InputError(f"{path}: no weights of the CNN estimator; `trepid train-lane` makes them")
        self._session = open_session(path)
        numbers = {output.name: output.shape[-1] for output in self._session.get_outputs()}
        faults = [f"has no output {name!r}" for name in OUTPUTS if name not in numbers]
        if numbers.get("lane", len(MIRRORED)) != len(MIRRORED):
            faults = [f"its lane has {numbers['lane']} numbers, not {len(MIRRORED)}"]
        if faults:
            raise InputError(f"{path}: {faults[0]}; `trepid train-lane` makes another")

    def __call__(self, images: Image) -> Outputs:
        """Of images (n, height, width, 3)."""
        return Outputs(*self._session.run(list(OUTPUTS), {"image": images}))


class SteerNet:
    """Estimator ``cnn``. It reports no boundaries and 0 detected lanes."""

    def __init__(
        self, settings: SteerNetSettings, camera: Camera, vehicle: Vehicle, *, assumed: bool = False
    ) -> None:
        """``assumed``: the height of ``camera`` is not known, so that the width of a lane says nothing.

        Raises InputError when the weights are missing or do not agree with their record.
        """
        weights = resource(Path(settings.weights))
        self._settings, self._steering = settings, steering_settings()
        self._vehicle, self._assumed = vehicle, assumed
        self._network = Network(weights)
        self._record = load_record(weights, SteerNetRecord)
        self._view = CanonicalView(camera, self._record.camera)
        self._shape = (camera.height_px, camera.width_px, 3)
        grey = self._view.image(np.full(self._shape, 128, np.uint8))[None]
        first = first_run(weights, lambda: self._network(grey), tuple)
        if (first.lanes.shape, first.carriageway.shape) != ((1, len(MIRRORED)), (1, 3)):
            raise InputError(f"{weights}: of one picture its lane has the shape {first.lanes.shape}")

    def through(self, camera: Camera) -> "SteerNet":
        """The same network for another camera of images of the same size."""
        twin = copy(self)
        twin._view = CanonicalView(camera, self._record.camera)
        return twin

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The lane in ``frame``, or the reason for its absence. Stateless."""
        image = frame.image
        if image.dtype != np.uint8 or image.shape != self._shape:
            return self._nothing(frame, f"image is {image.dtype} {image.shape}, not uint8 {self._shape}")
        found = self._network(self._view.image(image)[None])
        if not all(np.isfinite(output).all() for output in found):
            return self._nothing(frame, "the network's output is not finite")
        lane, width_m = lane_of_row(found.lanes[0], self._record.lane_lookahead_m)
        sigma_1pm, width_m = float(found.command_sigma_1pm[0]), width_m * self._view.scale
        confidence, reason = self._confidence(found, sigma_1pm, width_m)
        if reason:
            return self._nothing(frame, reason)
        seen = self._lane_estimate(frame, self._view.lane(lane), confidence, sigma_1pm / self._view.scale)
        return replace(seen, lane_width_m=width_m)

    def _confidence(self, found: Outputs, sigma_1pm: float, width_m: float) -> tuple[float, str]:
        """The confidence of the lane of one image, and why there is no lane; "" if there is one."""
        visible, world = float(found.visible[0]), self._record.world.share(float(found.unlike[0]))
        if visible < self._settings.min_visible:
            return 0.0, "the network detects no road"
        if world == 0.0:
            return 0.0, "the image is unlike those of the training of the network"
        width = 1.0 if self._assumed else self._settings.width_share(width_m / self._vehicle.scale)
        if width == 0.0:
            return 0.0, f"the lane of the network is {width_m:.1f} m wide"
        middle = 0.0 if self._assumed else self._in_middle(found)
        confidence = world * width * visible * (1.0 - middle) * self._probability(sigma_1pm)
        if confidence < self._steering.min_confidence:
            return 0.0, UNSURE if middle < 0.5 else BETWEEN_WAYS
        return confidence, ""

    def _in_middle(self, found: Outputs) -> float:
        """Probability that the lane lies in the middle of a road for both ways without lines."""
        offset_m, width_m, bare = found.carriageway[0].tolist()
        aside_m, scale = abs(float(found.lanes[0, 0]) - offset_m), self._view.scale / self._vehicle.scale
        return self._settings.middle_share(width_m * scale, aside_m / max(width_m, 1e-3), bare)

    def _probability(self, command_sigma_1pm: float) -> float:
        """Calibrated probability for δ = atan(L·κ_cmd), with σ_δ ≈ L·σ_κ (its largest value, straight ahead).

        L is that of the calibration, not of this car: on a longer one the same path needs a greater angle.
        """
        calibration = self._record.calibration
        return calibration.probability(calibration.wheelbase_m * command_sigma_1pm / self._view.scale)

    def _lane_estimate(
        self, frame: Frame, lane: Lane, confidence: float, command_sigma_1pm: float
    ) -> SteeringEstimate:
        ahead_m = self._steering.lookahead_m
        return replace(
            self._nothing(frame, ""),
            lateral_offset_m=lane.offset_m,
            heading_error_rad=lane.heading_rad,
            curvature_1pm=lane.curvature_at(ahead_m),
            curvature_rate_1pm2=lane.curvature_rate_1pm2,
            road_wheel_angle_rad=road_wheel_angle(
                lane.pursuit_curvature(ahead_m), wheelbase_m=self._vehicle.wheelbase_m
            ),
            confidence=confidence,
            ahead_sigma_m=ahead_sigma_m(command_sigma_1pm, ahead_m),
        )

    def _nothing(self, frame: Frame, reason: str) -> SteeringEstimate:
        return SteeringEstimate.nothing(
            frame.t_s, estimator=NAME, lookahead_m=self._steering.lookahead_m, reason=reason
        )
