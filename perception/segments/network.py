"""Segmentation networks: an ONNX file, described by a short YAML file, from an image to soft masks.

A mask holds for every pixel the probability that it shows a lane line, or drivable area. Of logits z the
probability of the channels C is softmax: Σ_{c∈C} exp z_c / Σ_k exp z_k, of a single channel 1/(1 + exp(-z)).

The image is scaled to the width of the network. A higher one loses its upper rows, a lower one gets rows of its
uppermost colours above it, so that the proportions stay those of the training, and the road is seen as a whole.

**Dark roads.** Few pictures of the training have an unlit road that the camera hardly exposed, as at dusk. An image
whose road right ahead is below ``least_grey`` is brightened to it; one that was exposed for its road is left alone.
"""

from pathlib import Path
from typing import Annotated, Literal, NamedTuple

import cv2
import numpy as np
from pydantic import Field, model_validator

from perception.lane.light import brighten_road
from perception.net.session import InferenceSession, first_run, open_session
from trepid.config import InputError, Settings
from trepid.types import Floats, Image, Positive

Side = Annotated[int, Field(ge=32, le=4096)]
Colours = tuple[float, float, float]


MAX_GAIN = 4.0  # of a dark image, whose noise grows as well


class NetworkInput(Settings):
    """Section ``input`` of a description: the picture that a network takes, float32, 1 x 3 x height x width."""

    name: str
    width: Side
    height: Side
    colours: Literal["rgb", "bgr"] = "rgb"
    mean: Colours = (0.0, 0.0, 0.0)
    deviation: tuple[Positive, Positive, Positive] = (1.0, 1.0, 1.0)
    least_grey: Annotated[float, Field(ge=0.0, le=255.0)] = 0.0  # of the road right ahead


class MaskOutput(Settings):
    """Sections ``lines`` and ``area`` of a description: an output, 1 x channels x height x width."""

    output: str
    channels: Annotated[tuple[Annotated[int, Field(ge=0)], ...], Field(min_length=1)]
    values: Literal["logits", "probabilities"] = "logits"


class Publication(Settings):
    """Section ``fetch`` of a description: what `trepid networks fetch` gets."""

    address: str
    sha256: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    checkpoint: Literal["onnx", "twinlitenet"] = "onnx"


class SegmentNetwork(Settings):
    """The description of a segmentation network: a file of ``config/networks``, or of a car."""

    description: str
    source: str
    licence: str
    input: NetworkInput
    lines: MaskOutput | None = None
    area: MaskOutput | None = None
    fetch: Publication | None = None

    @model_validator(mode="after")
    def _marks_something(self) -> "SegmentNetwork":
        if self.lines is None and self.area is None:
            raise ValueError("expected `lines`, `area` or both")
        return self


class Masks(NamedTuple):
    """Probabilities 0..1 in the pixels of the whole image at the width of the network; None without such a mask."""

    lines: Floats | None
    area: Floats | None

    @property
    def finite(self) -> bool:
        """Every probability is a finite number."""
        return all(np.isfinite(mask).all() for mask in self if mask is not None)


class Segmenter:
    """A segmentation network, ready to run."""

    def __init__(self, path: Path, about: SegmentNetwork) -> None:
        """Raises InputError where ``path`` is no network, or another one than ``about`` describes."""
        if not path.is_file():
            raise InputError(f"{path}: no such file")
        self._path, self._about = path, about
        self._session = open_session(path)
        _check_names(path, about, self._session)
        self._outputs = list({mask.output for mask in (about.lines, about.area) if mask is not None})
        grey = np.full((about.input.height, about.input.width, 3), 128, np.uint8)
        first_run(path, lambda: self(grey), lambda found: [mask for mask in found if mask is not None])

    def __call__(self, image: Image) -> Masks:
        """The masks of ``image``, (h, w, 3) uint8 BGR of any size."""
        taken = self._about.input
        image = brighten_road(image, grey=taken.least_grey, max_gain=MAX_GAIN)
        rows = max(1, round(image.shape[0] * taken.width / image.shape[1]))
        scaled = cv2.resize(image, (taken.width, rows), interpolation=cv2.INTER_AREA)
        above = rows - taken.height
        seen = cv2.copyMakeBorder(scaled[max(above, 0) :], max(-above, 0), 0, 0, 0, cv2.BORDER_REPLICATE)
        found = self._session.run(self._outputs, {taken.name: self._pixels(seen)})
        outputs = dict(zip(self._outputs, found, strict=True))

        def whole(mask: MaskOutput | None) -> Floats | None:
            if mask is None:
                return None
            found = self._probability(outputs[mask.output], mask)
            return np.pad(found, ((above, 0), (0, 0))) if above >= 0 else found[-above:]

        return Masks(whole(self._about.lines), whole(self._about.area))

    def _pixels(self, image: cv2.typing.MatLike) -> Floats:
        taken = self._about.input
        planes = cv2.split(image)[::-1] if taken.colours == "rgb" else cv2.split(image)
        pixels = np.empty((1, 3, *image.shape[:2]), np.float32)
        for filled, plane, mean, sigma in zip(pixels[0], planes, taken.mean, taken.deviation, strict=True):
            np.multiply(plane, np.float32(1 / (255 * sigma)), out=filled)
            if mean:
                np.subtract(filled, np.float32(mean / sigma), out=filled)
        return pixels

    def _probability(self, output: Floats, mask: MaskOutput) -> Floats:
        taken = self._about.input
        right = output.ndim == 4 and output.shape[2:] == (taken.height, taken.width)
        if not right or max(mask.channels) >= output.shape[1]:
            raise ValueError(
                f"output {mask.output!r} has the shape {list(output.shape)}, expected [1, more than"
                f" {max(mask.channels)}, {taken.height}, {taken.width}]"
            )
        scores = np.asarray(output[0], np.float32)
        if mask.values == "logits":
            if len(scores) == 1:
                return _logistic(scores[0])
            if len(scores) == 2 and len(mask.channels) == 1:  # the same as softmax, in half of the time
                [of] = mask.channels
                return _logistic(scores[of] - scores[1 - of])
            scores = np.exp(scores - scores.max(axis=0))
            scores /= scores.sum(axis=0)
        return np.asarray(scores[list(mask.channels)].sum(axis=0), np.float32)


def _logistic(logits: Floats) -> Floats:
    """1/(1 + exp(-z)) in float32, whose exponential does not overflow within ± 80."""
    found = np.exp(-np.clip(logits, -80, 80))
    found += 1
    return np.asarray(np.reciprocal(found), np.float32)


def _check_names(path: Path, about: SegmentNetwork, session: InferenceSession) -> None:
    inputs = [put.name for put in session.get_inputs()]
    if inputs != [about.input.name]:
        raise InputError(f"{path}: takes {', '.join(inputs)}; its description says {about.input.name}")
    outputs = [put.name for put in session.get_outputs()]
    for mask in (about.lines, about.area):
        if mask is not None and mask.output not in outputs:
            raise InputError(f"{path}: has no output {mask.output!r}; it has {', '.join(outputs)}")
