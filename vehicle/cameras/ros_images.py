"""Images of ROS 2: ``sensor_msgs/Image`` and ``sensor_msgs/CompressedImage`` as BGR."""

import re
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

import cv2
import numpy as np

from trepid.clock import NANO, seconds
from trepid.images.files import decoded_image
from trepid.types import Image
from trepid.wire import STORE, WireError

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
TYPES = (IMAGE, COMPRESSED)
BAYER = ("rggb", "bggr", "gbrg", "grbg")
ENCODINGS: Mapping[str, tuple[int, int | None]] = MappingProxyType(
    {
        "bgr8": (3, None),
        "8UC3": (3, None),
        "rgb8": (3, cv2.COLOR_RGB2BGR),
        "bgra8": (4, cv2.COLOR_BGRA2BGR),
        "rgba8": (4, cv2.COLOR_RGBA2BGR),
        "mono8": (1, cv2.COLOR_GRAY2BGR),
        "8UC1": (1, cv2.COLOR_GRAY2BGR),
        "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
        "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
        "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
        "yuyv": (2, cv2.COLOR_YUV2BGR_YUY2),
        "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2BGR),
        "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2BGR),
        "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2BGR),
        "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2BGR),
        "8UC4": (4, cv2.COLOR_BGRA2BGR),
    }
)
"""Encoding (sensor_msgs/image_encodings.hpp) -> bytes per pixel, and the conversion of OpenCV."""
HALVED: Mapping[str, int] = MappingProxyType(
    {
        "nv12": cv2.COLOR_YUV2BGR_NV12,
        "nv21": cv2.COLOR_YUV2BGR_NV21,
        "i420": cv2.COLOR_YUV2BGR_I420,
        "yv12": cv2.COLOR_YUV2BGR_YV12,
    }
)
"""Encodings whose colours have half the resolution and follow the lightness: 3/2 of the rows of the picture."""
WIDE: Mapping[str, str] = MappingProxyType(
    {
        f"{name}16": f"{name}8"
        for name in ("mono", "bgr", "rgb", "bgra", "rgba", *(f"bayer_{tiles}" for tiles in BAYER))
    }
)
"""Encodings of two bytes a sample, of which the higher byte counts -> those of one."""
MEASURED = re.compile(r"(16|32|64)[USF]C\d")  # depth or heat: numbers without a lightness
COMPRESSED_FITS = "expected one JPEG, PNG or WebP a message, as image_transport's `compressed` writes it"


class RosImage(NamedTuple):
    """An image message that is not decoded yet."""

    stamp_s: float | None  # of the header; None: a zero stamp
    decode: Callable[[], Image]  # raises WireError


def ros_image(data: bytes, ros_type: str) -> RosImage:
    """The image message in CDR bytes; ``ros_type`` is one of :data:`TYPES`. Raises WireError."""
    try:
        ros: Any = STORE.deserialize_cdr(data, ros_type)
    except Exception as error:  # rosbags does not catch the exceptions of numpy and struct for foreign bytes
        raise WireError(f"not a {ros_type}: {type(error).__name__}") from error
    stamp_ns = ros.header.stamp.sec * NANO + ros.header.stamp.nanosec
    decode = _raw if ros_type == IMAGE else _decode_compressed
    return RosImage(seconds(stamp_ns) if stamp_ns else None, lambda: decode(ros))


def _raw(ros: Any) -> Image:
    """Shape (height, width, 3); rows may be padded to ``step`` bytes."""
    name = ros.encoding if ros.encoding in ENCODINGS else ros.encoding.lower()
    sample_bytes = 2 if name in WIDE else 1
    pixel_bytes, conversion = _packing(name, ros.encoding)
    width_bytes = ros.width * pixel_bytes * sample_bytes
    rows = ros.height + ros.height // 2 if name in HALVED else ros.height
    fits = ros.step >= width_bytes > 0 and rows > 0 and len(ros.data) >= ros.step * rows
    if (
        not fits
        or (pixel_bytes == 2 and ros.width % 2)
        or (name in HALVED and (ros.width % 2 or ros.height % 2))
    ):
        size = f"{ros.width} x {ros.height} px, {ros.step} bytes a row, {len(ros.data)} bytes"
        raise WireError(f"an image of {size} is not one of encoding {ros.encoding!r}")
    data = np.asarray(ros.data)[: ros.step * rows].reshape(rows, ros.step)[:, :width_bytes]
    if name in WIDE:
        data = data[:, 0 if ros.is_bigendian else 1 :: 2]
    image = np.ascontiguousarray(data).reshape(rows, ros.width, pixel_bytes)
    if conversion is None:
        return image
    try:
        return np.asarray(cv2.cvtColor(image, conversion), np.uint8)
    except cv2.error as error:  # such as a Bayer pattern of 1 x 1 px
        size = f"{ros.width} x {ros.height} px"
        raise WireError(f"an image of {size} is too small for encoding {ros.encoding!r}") from error


def _packing(name: str, written: str) -> tuple[int, int | None]:
    """Samples a pixel, and the conversion of OpenCV. Raises WireError for an encoding that is no picture."""
    if name in HALVED:
        return 1, HALVED[name]
    if MEASURED.fullmatch(written):
        what = "depth or heat, not the light of a road; choose the topic of the colour or grey image"
        raise WireError(f"encoding {written!r} of an image: {what}")
    found = ENCODINGS.get(WIDE.get(name, name))
    if found is None:
        known = ", ".join((*ENCODINGS, *HALVED, *WIDE))
        raise WireError(f"encoding {written!r} of an image; known: {known}")
    return found


def _decode_compressed(ros: Any) -> Image:
    """JPEG, PNG or another format of OpenCV."""
    measured = MEASURED.match(ros.format) is not None or "compressedDepth" in ros.format
    image = None if measured else decoded_image(np.asarray(ros.data).tobytes())
    if image is None:
        what = "is depth or heat, not the light of a road" if measured else "cannot be decoded"
        raise WireError(f"a compressed image of format {ros.format!r} {what}: {COMPRESSED_FITS}")
    return image
