"""Driving networks: from the whole image to the road-wheel angle, each a self-contained ONNX file.

A file has the input `image` (uint8, N x H x W x 3, BGR: the whole frame, scaled to H x W by averaging) and the
outputs `road_wheel_rad`, `sigma_rad` (scale of the error) and `unlike` (distance of the features from those of
training, relative to the 99 % quantile there; above 1 the image is outside the network's world), each of shape N. A
recurrent network also has the input `state` and the output `next_state`; one whose record says so has the output
`speed_mps`, the speed that the driver of the training would have here, in metres of the car. The metadata `trepid`
holds a :class:`DriverRecord`.

The interval of 90 % is angle ± q·σ with the conformal factor q (Angelopoulos and Bates, A Gentle Introduction to
Conformal Prediction (2021), section 2.3.2), so that q·σ/1.645 is the standard deviation of a normal error.
"""

import json
import math
from collections import deque
from dataclasses import replace
from pathlib import Path
from statistics import NormalDist
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, PositiveFloat, PositiveInt, ValidationError

from perception.lane.settings import steering_settings
from perception.net.session import RUN_FAILURES, InferenceSession, line_of, open_session
from perception.net.steer_net import ahead_sigma_m
from trepid.car.vehicle import Vehicle
from trepid.config import InputError, complaint
from trepid.messages import EstimateKind, Frame, SteeringEstimate, VehicleState
from trepid.types import Image

KEY = "trepid"  # of the metadata of the file
KIND = "steering"
TOLERANCE_RAD = math.radians(2.0)  # confidence is the probability of an error below it
LONGEST_GAP_S = 0.5  # between frames; after a longer one a recurrent network starts anew
_OUTPUTS = ("road_wheel_rad", "sigma_rad", "unlike")
SPEED = "speed_mps"
_NORMAL = NormalDist()
_Z_90 = _NORMAL.inv_cdf(0.95)  # 1.645: 90 % of normal errors lie within so many deviations
Numbers = NDArray[np.float32]


class DriverRecord(BaseModel):
    """The metadata of a driving network that the run time uses; further fields are ignored."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)

    kind: str
    model: str  # family, such as pilotnet
    parameters: PositiveInt
    height: PositiveInt
    width: PositiveInt
    interval_90: PositiveFloat  # q: 90 % of errors are within q·σ
    stride: PositiveInt = 1  # the memory reads every so-manieth frame
    data_sha256: str = ""  # of the data set of the training
    speed: bool = False  # it has the output SPEED

    def sigma_rad(self, scale_rad: float) -> float:
        """Standard deviation [rad] of a normal error with the 90 % interval ± q·``scale_rad``."""
        return self.interval_90 * scale_rad / _Z_90

    def confidence(self, scale_rad: float) -> float:
        """P(|error| < TOLERANCE_RAD) = 2·Φ(TOLERANCE_RAD/σ) - 1 for the network's output ``scale_rad``."""
        return 2.0 * _NORMAL.cdf(TOLERANCE_RAD / self.sigma_rad(scale_rad)) - 1.0


class NetworkOutput(NamedTuple):
    """The outputs of a driving network for one frame."""

    road_wheel_rad: float
    scale_rad: float  # of the error
    unlike: float
    state: Numbers | None  # for the next frame; None: the network has no memory
    speed_mps: float | None = None  # proposed, at least 0; None: no proposal

    @property
    def finite(self) -> bool:
        """Every number is finite, and the scale positive."""
        numbers = (self.road_wheel_rad, self.scale_rad, self.unlike)
        return all(map(math.isfinite, numbers)) and self.scale_rad > 0.0


class DriverNetwork:
    """The graph of a driving network and its record. It has no memory of frames."""

    def __init__(self, path: Path) -> None:
        """Raises InputError, with the fault, for a file that is missing, damaged or no driving network."""
        self.path = path
        if not path.is_file():
            raise InputError(f"{path}: no such file; `trepid train` writes driving networks")
        self._session = open_session(path)
        self.record = _record(self._session, path)
        self.initial_state = self._checked_graph()
        self._names = [*_OUTPUTS, *([SPEED] if self.record.speed else [])]
        self._names += [] if self.initial_state is None else ["next_state"]
        grey = np.full((self.record.height, self.record.width, 3), 128, np.uint8)
        try:
            steering = self(grey, self.initial_state)
            steering = self(grey, steering.state)  # also with the state of the first one
        except RUN_FAILURES as error:
            raise self._refusal(f"fails on a grey image: {line_of(error)}") from error
        if not steering.finite:
            raise self._refusal("its outputs for a grey image are not finite, or sigma_rad is not positive")

    def __call__(self, image: Image, state: Numbers | None) -> NetworkOutput:
        """The outputs for an image of any size, (h, w, 3) uint8 BGR, after the frames behind ``state``."""
        size = (self.record.width, self.record.height)
        if image.shape[:2] != size[::-1]:
            image = np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)
        inputs: dict[str, Any] = {"image": image[None]}
        if state is not None:
            inputs["state"] = state
        found = dict(zip(self._names, self._session.run(self._names, inputs), strict=True))
        angle_rad, scale_rad, unlike = (found[name].item() for name in _OUTPUTS)
        speed_mps = found[SPEED].item() if SPEED in found else math.nan
        proposed_mps = max(speed_mps, 0.0) if math.isfinite(speed_mps) else None
        return NetworkOutput(angle_rad, scale_rad, unlike, found.get("next_state"), proposed_mps)

    def _checked_graph(self) -> Numbers | None:
        """The state before the first frame, zeros of shape (1, …); None without memory. Raises InputError."""
        inputs = {put.name: put for put in self._session.get_inputs()}
        outputs = {put.name for put in self._session.get_outputs()}
        for name in (*_OUTPUTS, *([SPEED] if self.record.speed else [])):
            if name not in outputs:
                raise self._refusal(f"has no output {name!r}")
        size, image = (self.record.height, self.record.width, 3), inputs.pop("image", None)
        if image is None:
            raise self._refusal("has no input 'image'")
        if image.type != "tensor(uint8)" or tuple(image.shape[1:]) != size:
            raise self._refusal(
                f"its input 'image' is {image.type} {image.shape}, expected tensor(uint8) [N, {size}]"
            )
        state = inputs.pop("state", None)
        if inputs:
            raise self._refusal(
                f"has an unknown input {min(inputs)!r}; a driving network has image and state"
            )
        if (state is None) != ("next_state" not in outputs):
            raise self._refusal("has one of the input 'state' and the output 'next_state', expected both")
        if state is None:
            return None
        if state.type != "tensor(float)" or not all(isinstance(size, int) for size in state.shape[1:]):
            raise self._refusal(
                f"its input 'state' is {state.type} {state.shape}, expected tensor(float) [N, …]"
            )
        return np.zeros((1, *state.shape[1:]), np.float32)

    def _refusal(self, fault: str) -> InputError:
        return InputError(f"{self.path}: no driving network: {fault}")


class DrivingEstimator:
    """A driving network as an estimator of kind ANGLE: it measures no lane. Some propose a speed.

    A recurrent network has as many memories as its stride, used in turn: each reads every ``stride``-th frame.
    """

    def __init__(self, name: str, network: DriverNetwork, vehicle: Vehicle) -> None:
        self._name, self._network, self._vehicle = name, network, vehicle
        self._steering = steering_settings()
        self._memories = self._empty()
        self._last_s = math.nan

    def steer(self, image: Image, t_s: float) -> NetworkOutput | None:
        """The outputs for an image (h, w, 3) uint8 BGR that was taken at ``t_s``; None where they are not finite.

        The memory of a recurrent network ends with an output that is not finite, and with a time between images
        that is not positive or above LONGEST_GAP_S.
        """
        if not 0.0 < t_s - self._last_s <= LONGEST_GAP_S:  # NaN: the first image
            self._restart()
        steering = self._network(image, self._memories[0])
        if not steering.finite or not (steering.state is None or np.isfinite(steering.state).all()):
            self._restart()
            return None
        self._memories[0], self._last_s = steering.state, t_s
        self._memories.rotate(-1)
        return steering

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The road-wheel angle for ``frame``, or the reason for its absence.

        The memory of a recurrent network ends with an image of another kind, too.
        """
        image = frame.image
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or 0 in image.shape:
            self._restart()
            return self._nothing(frame, f"image is {image.dtype} {image.shape}, not uint8 (height, width, 3)")
        steering = self.steer(image, frame.t_s)
        if steering is None:
            return self._nothing(frame, "the network's output is not finite")
        if steering.unlike > 1.0:
            return self._nothing(frame, "the image is unlike those of the training of the network")
        confidence = self._network.record.confidence(steering.scale_rad)
        if confidence < self._steering.min_confidence:
            return self._nothing(frame, "the network states a low confidence of its angle")
        if abs(steering.road_wheel_rad) >= math.pi / 2:
            return self._nothing(frame, "the network's angle is impossible")
        return replace(
            self._nothing(frame, ""),
            road_wheel_angle_rad=steering.road_wheel_rad,
            confidence=confidence,
            ahead_sigma_m=self._ahead_sigma_m(steering),
            speed_mps=steering.speed_mps,
        )

    def _ahead_sigma_m(self, steering: NetworkOutput) -> tuple[float, ...]:
        """Deviation of the arc, from σ_κ = σ_δ/(L·cos²δ), because κ = tan(δ)/L."""
        slope_1pm = 1.0 / (self._vehicle.wheelbase_m * math.cos(steering.road_wheel_rad) ** 2)
        return ahead_sigma_m(
            self._network.record.sigma_rad(steering.scale_rad) * slope_1pm, self._steering.lookahead_m
        )

    def _restart(self) -> None:
        self._memories, self._last_s = self._empty(), math.nan

    def _empty(self) -> deque[Numbers | None]:
        return deque([self._network.initial_state] * self._network.record.stride)

    def _nothing(self, frame: Frame, reason: str) -> SteeringEstimate:
        return SteeringEstimate.nothing(
            frame.t_s,
            estimator=self._name,
            lookahead_m=self._steering.lookahead_m,
            reason=reason,
            kind=EstimateKind.ANGLE,
        )


def _record(session: InferenceSession, path: Path) -> DriverRecord:
    """The record in the metadata of the file. Raises InputError."""
    text = session.get_modelmeta().custom_metadata_map.get(KEY)
    if text is None:
        raise InputError(f"{path}: no driving network: has no metadata {KEY!r}; `trepid train` writes it")
    try:
        data = json.loads(text)
        record = DriverRecord.model_validate(data)
    except ValidationError as error:
        what = complaint(error, data, DriverRecord)
        raise InputError(f"{path}: no driving network: metadata {KEY!r}: {what}") from error
    except ValueError as error:
        raise InputError(f"{path}: no driving network: metadata {KEY!r} is not JSON") from error
    if record.kind != KIND:
        raise InputError(f"{path}: no driving network: its kind is {record.kind!r}, expected {KIND!r}")
    return record
