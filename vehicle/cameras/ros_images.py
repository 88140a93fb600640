"""Images of ROS 2: ``sensor_msgs/Image`` and ``sensor_msgs/CompressedImage`` as BGR."""

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
    }
)
"""Encoding (sensor_msgs/image_encodings.hpp) -> bytes per pixel, and the conversion of OpenCV."""


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
    found = ENCODINGS.get(ros.encoding)
    if found is None:
        raise WireError(f"encoding {ros.encoding!r} of an image; known: {', '.join(ENCODINGS)}")
    pixel_bytes, conversion = found
    width_bytes = ros.width * pixel_bytes
    fits = ros.step >= width_bytes > 0 and ros.height > 0 and len(ros.data) >= ros.step * ros.height
    if not fits or (pixel_bytes == 2 and ros.width % 2):
        size = f"{ros.width} x {ros.height} px, {ros.step} bytes a row, {len(ros.data)} bytes"
        raise WireError(f"an image of {size} is not one of encoding {ros.encoding!r}")
    rows = np.asarray(ros.data)[: ros.step * ros.height].reshape(ros.height, ros.step)[:, :width_bytes]
    image = np.ascontiguousarray(rows).reshape(ros.height, ros.width, pixel_bytes)
    if conversion is None:
        return image
    try:
        return np.asarray(cv2.cvtColor(image, conversion), np.uint8)
    except cv2.error as error:  # such as a Bayer pattern of 1 x 1 px
        size = f"{ros.width} x {ros.height} px"
        raise WireError(f"an image of {size} is too small for encoding {ros.encoding!r}") from error


def _decode_compressed(ros: Any) -> Image:
    """JPEG, PNG or another format of OpenCV."""
    image = decoded_image(np.asarray(ros.data).tobytes())
    if image is None:
        raise WireError(f"a compressed image of format {ros.format!r} cannot be decoded")
    return image
