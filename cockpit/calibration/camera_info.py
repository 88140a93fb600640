"""``camera_info`` files of ROS as cameras: as camera_calibration writes and ``ros2 topic echo`` prints them.

Both state the intrinsics K of the full sensor, the lens model and its coefficients; so do a ``FileStorage`` of
OpenCV and the chain of one camera that Kalibr writes. A matrix is a list of numbers or of rows, alone or as
``data`` beside ``rows`` and ``cols``. Of an image the region of interest is read out first, then pixels are binned
(sensor_msgs/CameraInfo). The lens models are:

- ``plumb_bob``: k1 k2 p1 p2 k3 of Brown and Conrady, as in :class:`trepid.car.camera.Camera`.
- ``rational_polynomial``: k1 k2 p1 p2 k3 k4 k5 k6, the same with a quotient of polynomials.
- ``equidistant``: a fisheye by Kannala and Brandt, IEEE PAMI 28(8), 2006,
  r_d = θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) at the angle θ from the axis, taken as a quotient of polynomials
  (:mod:`cockpit.calibration.fisheye`).
"""

import math
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import (
    AfterValidator,
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    NonNegativeInt,
    PositiveInt,
)

from cockpit.calibration.fisheye import FIT_PX, corner_radius, fit_quotient
from trepid.car.camera import Camera
from trepid.config import InputError, parse, read_first

WIDEST = 20.0  # heights of the image in a focal length: no lens has a wider image
SKEW_PX = 0.5  # over the height of the image, that a camera without skew may have
FAR_SHARE = 0.2  # of the image, from its middle: a crop moves the principal point so far on one axis ...
SAME_SHARE = 0.05  # ... and a matrix of another size on both alike
TURNED_SHARE, TURNED_NEARER = 0.1, 4.0
"""Width and height are swapped where the principal point is farther than this share of the image from its middle,
and that many times nearer to the middle of the image turned by 90°."""

_OPENCV_HEAD = re.compile(r"\A%YAML:1\.0\s*\n(?:---[^\n]*\n)?")
_OPENCV_TAG = re.compile(r"(?<=:)\s*!!opencv-matrix")
_XML = re.compile(r"\A\s*<(?:\?xml|opencv_storage)")
_OST = re.compile(r"\A\s*(?:#[^\n]*\n\s*)*\[image\]\s*$", re.MULTILINE)


def _numbers(value: Any) -> Any:
    """The numbers of a matrix, row after row. Raises ValueError where its size is stated otherwise."""
    if isinstance(value, Mapping) and "data" in value:
        numbers = _numbers(value["data"])
        rows, columns = value.get("rows"), value.get("cols")
        if isinstance(rows, int) and isinstance(columns, int) and rows * columns != len(numbers):
            raise ValueError(f"{rows} rows of {columns} numbers, but {len(numbers)} numbers")
        return numbers
    if isinstance(value, list) and any(isinstance(row, list) for row in value):
        return [number for row in value for number in (row if isinstance(row, list) else [row])]
    if not isinstance(value, Sequence) or isinstance(value, str):
        raise ValueError(f"expected a list of numbers, got {value!r}")
    return value


def _nine(numbers: tuple[float, ...]) -> tuple[float, ...]:
    if len(numbers) != 9:
        raise ValueError(f"expected the 9 numbers of a matrix with three rows, got {len(numbers)}")
    return numbers


Numbers = Annotated[tuple[float, ...], BeforeValidator(_numbers)]
Nine = Annotated[Numbers, AfterValidator(_nine)]


class _Part(BaseModel):
    """A part of a file that may have further fields."""

    model_config = ConfigDict(frozen=True, extra="ignore", allow_inf_nan=False)


class Region(_Part):
    """The part of the sensor that is read out; without size: all of it."""

    x_offset: NonNegativeInt = 0
    y_offset: NonNegativeInt = 0
    height: NonNegativeInt = 0
    width: NonNegativeInt = 0


class Message(_Part):
    """``sensor_msgs/CameraInfo`` of ROS 2, or of ROS 1 with D and K."""

    height: PositiveInt
    width: PositiveInt
    distortion_model: str | None = ""
    d: Numbers = Field(default=(), validation_alias=AliasChoices("d", "D"))
    k: Nine = Field(validation_alias=AliasChoices("k", "K"))
    binning_x: NonNegativeInt = 0
    binning_y: NonNegativeInt = 0
    roi: Region = Region()


class CameraInfo(_Part):
    """A file of camera_calibration_parsers."""

    image_height: PositiveInt = Field(validation_alias=AliasChoices("image_height", "image_Height"))
    image_width: PositiveInt = Field(validation_alias=AliasChoices("image_width", "image_Width"))
    distortion_model: str | None = ""
    distortion_coefficients: Numbers = Field(
        default=(), validation_alias=AliasChoices("distortion_coefficients", "Distortion_Coefficients", "D")
    )
    camera_matrix: Nine = Field(validation_alias=AliasChoices("camera_matrix", "Camera_Matrix", "K"))

    def message(self) -> Message:
        """The same as a message."""
        return Message(
            height=self.image_height,
            width=self.image_width,
            distortion_model=self.distortion_model,
            d=self.distortion_coefficients,
            k=self.camera_matrix,
        )


class KalibrCamera(_Part):
    """A camera of the chain that Kalibr writes."""

    camera_model: Literal["pinhole"]
    intrinsics: Annotated[tuple[float, ...], Field(min_length=4, max_length=4)]  # fx, fy, cx, cy [px]
    resolution: tuple[PositiveInt, PositiveInt]
    distortion_model: str | None = ""
    distortion_coeffs: Numbers = ()

    def message(self) -> Message:
        """The same as a message."""
        fx_px, fy_px, cx_px, cy_px = self.intrinsics
        width, height = self.resolution
        return Message(
            height=height,
            width=width,
            distortion_model=self.distortion_model,
            d=self.distortion_coeffs,
            k=(fx_px, 0.0, cx_px, 0.0, fy_px, cy_px, 0.0, 0.0, 1.0),
        )


class KalibrChain(_Part):
    """The file of Kalibr for one camera."""

    cam0: KalibrCamera


class ImportedCamera(NamedTuple):
    """A camera whose lens is that of a file, and how it is stated there."""

    camera: Camera
    model: str
    fit_px: float | None  # largest error of a fitted lens; None: as stated


def import_camera(path: Path, mounting: Camera) -> ImportedCamera:
    """The camera of the camera_info at ``path``, mounted as ``mounting``. Raises InputError with its place."""
    message = _read_message(read_first(path, _plain_yaml), path)
    if fault := _fault_of_matrix(message):
        raise InputError(f"{path}: {fault}")
    fx_px, _, cx_px, _, fy_px, cy_px, *_ = message.k
    name, needs, lens = _lens_model(message, path)
    coefficients = _strip_zeros(message.d)
    if len(coefficients) > needs:
        raise InputError(f"{path}: {name} has {needs} coefficients, got {len(message.d)}")
    k = np.array(message.k).reshape(3, 3)
    corner = corner_radius(k, (message.width, message.height))
    distortion, error = lens((*coefficients, *[0.0] * (needs - len(coefficients))), corner)
    fit_px = None if error is None else error * max(fx_px, fy_px)
    if fit_px is not None and not fit_px <= FIT_PX:
        raise InputError(f"{path}: {name}: no lens of a camera file comes within {FIT_PX:g} px of it")
    full = mounting.model_copy(
        update={
            "width_px": message.width,
            "height_px": message.height,
            "fx_px": fx_px,
            "fy_px": fy_px,
            "cx_px": cx_px,
            "cy_px": cy_px,
            "distortion": distortion,
        }
    )
    return ImportedCamera(Camera.model_validate(_read_out(full, message, path).model_dump()), name, fit_px)


def _fault_of_matrix(message: Message) -> str:
    """Why K is no matrix of an image of this size, in words; empty where it is one."""
    fx_px, skew, _, below, fy_px, _, *last = message.k
    width, height = message.width, message.height
    size, focal = f"{width} x {height} px", f"{fx_px:g} x {fy_px:g} px"
    if not (fx_px > 0 and fy_px > 0):
        return f"the focal length is {focal}: the camera is not calibrated"
    if below or any(last[:2]):
        return "the matrix has numbers below its diagonal, as a transposed one: the last row is 0, 0, 1"
    if WIDEST * min(fx_px, fy_px) < min(width, height):
        return (
            f"a focal length of {focal} is none of {size}: is it in shares of the image, or of another size?"
        )
    if abs(skew) * height / fy_px > SKEW_PX:
        return f"a skew of {skew:g} px: only cameras with upright pixels can be imported"
    return _fault_of_point(message)


def _fault_of_point(message: Message) -> str:
    """Why the principal point is none of an image of this size, in words; empty where it is one."""
    cx_px, cy_px, width, height = message.k[2], message.k[5], message.width, message.height
    size, right, down = f"{width} x {height} px", cx_px / width, cy_px / height
    off_px = math.hypot(cx_px - width / 2, cy_px - height / 2)
    turned_px = math.hypot(cx_px - height / 2, cy_px - width / 2)
    wrong = ""
    if off_px > TURNED_SHARE * max(width, height) and TURNED_NEARER * turned_px < off_px:
        wrong = f"is the middle of {height} x {width} px, not of {size}: are width and height swapped?"
    elif not (0 < right < 1 and 0 < down < 1):
        wrong = f"lies outside the image of {size}: the matrix is of another size"
    elif abs(right - 0.5) > FAR_SHARE and abs(right - down) < SAME_SHARE:
        wrong = f"is far from the middle of {size} on both axes alike: the matrix is of another size"
    return f"the principal point ({cx_px:g}, {cy_px:g}) px {wrong}" if wrong else ""


def _read_message(data: Any, path: Path) -> Message:
    """What a file of any of the forms states, as a message. Raises InputError."""
    names = data.keys() if isinstance(data, Mapping) else set()
    chain = sorted(name for name in names if re.fullmatch(r"cam\d+", str(name)))
    if len(chain) > 1:
        raise InputError(f"{path}: holds {', '.join(chain)}: leave one camera, with the name cam0")
    if chain:
        return parse(data, KalibrChain, source=path).cam0.message()
    if names & {"camera_matrix", "Camera_Matrix", "image_width", "image_Width"}:
        return parse(data, CameraInfo, source=path).message()
    return parse(data, Message, source=path)


def _plain_yaml(text: str, path: Path) -> str:
    """``text`` without what OpenCV adds to YAML. Raises InputError for the other form of camera_calibration."""
    if _OST.search(text):
        raise InputError(f"{path}: is no YAML but the text ost.txt: import the file ost.yaml beside it")
    if _XML.match(text):
        raise InputError(f"{path}: is XML: let OpenCV write it as YAML, with a name that ends in .yaml")
    head = _OPENCV_HEAD.match(text)
    if head is None:
        return text
    return "\n" * head.group().count("\n") + _OPENCV_TAG.sub("", text[head.end() :])


def _read_out(camera: Camera, message: Message, path: Path) -> Camera:
    """The camera of the region of interest, binned. Raises InputError for a region beyond the image."""
    roi = message.roi
    if (roi.x_offset and not roi.width) or (roi.y_offset and not roi.height):
        raise InputError(f"{path}: roi: an offset of ({roi.x_offset}, {roi.y_offset}) px, but no size")
    if roi.x_offset + roi.width > camera.width_px or roi.y_offset + roi.height > camera.height_px:
        where = f"{roi.width} x {roi.height} px from ({roi.x_offset}, {roi.y_offset})"
        raise InputError(
            f"{path}: roi: {where} reaches beyond the image of {camera.width_px} x {camera.height_px}"
        )
    region = camera.model_copy(
        update={
            "width_px": roi.width or camera.width_px,
            "height_px": roi.height or camera.height_px,
            "cx_px": camera.cx_px - roi.x_offset,
            "cy_px": camera.cy_px - roi.y_offset,
        }
    )
    return region.resize(
        region.width_px // max(message.binning_x, 1), region.height_px // max(message.binning_y, 1)
    )


Lens = Callable[[Sequence[float], float], tuple[tuple[float, ...], float | None]]
"""Coefficients and the radius of the corner to those of a camera file, and the largest error of the fit."""


def _lens_model(message: Message, path: Path) -> tuple[str, int, Lens]:
    """Name, number of coefficients, and conversion of a lens model. Raises InputError."""
    name = re.sub(r"[\s-]+", "_", (message.distortion_model or "").strip().lower())
    name = OTHER_NAMES.get(name, name)
    if name in ("", "none") and (not name or not any(message.d)):
        name = "plumb_bob"  # of a camera without distortion
    if name not in LENSES:
        known = ", ".join(LENSES)
        raise InputError(f"{path}: distortion_model {message.distortion_model!r}; known: {known}")
    return name, *LENSES[name]


def _as_read_message(coefficients: Sequence[float], _: float) -> tuple[tuple[float, ...], None]:
    return _strip_zeros(coefficients), None


def _strip_zeros(coefficients: Sequence[float]) -> tuple[float, ...]:
    """``coefficients`` without zeros at the end, which some drivers add."""
    count = max((at for at, value in enumerate(coefficients, start=1) if value), default=0)
    return tuple(coefficients[:count])


LENSES: dict[str, tuple[int, Lens]] = {
    "plumb_bob": (5, _as_read_message),
    "rational_polynomial": (8, _as_read_message),
    "equidistant": (4, fit_quotient),
    "fisheye": (4, fit_quotient),
}


OTHER_NAMES = {
    **dict.fromkeys(("radtan", "brown_conrady"), "plumb_bob"),
    **dict.fromkeys(("kannala_brandt", "kannala_brandt4"), "equidistant"),
}
"""Of Kalibr, of RealSense and of the literature."""


def describe(found: ImportedCamera, path: Path, mounting: Path) -> dict[str, str]:
    """Notes on the source of lens and mounting."""
    fit = "" if found.fit_px is None else f", fitted within {found.fit_px:.2g} px"
    return {
        "lens": f"lens: {path.name}, {found.model}{fit}",
        "mounting": f"mounting: of {mounting.name}; camera_info does not state it",
    }
