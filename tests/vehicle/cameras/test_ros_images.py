"""Images of ROS 2 in every encoding, written by foreign code."""

import cv2
import foreign_ros_rig as foreign
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from image_file_rig import png_of_size

from trepid.types import Image
from trepid.wire import WireError
from vehicle.cameras.ros_images import COMPRESSED, ENCODINGS, IMAGE, ros_image

BGR = np.dstack(
    [np.tile(np.linspace(20, 220, 32), (16, 1)), np.full((16, 32), 90.0), np.full((16, 32), 160.0)]
).astype(np.uint8)


def packed_yuv(picture: np.ndarray, *, luma_first: bool) -> np.ndarray:
    """Y, U and V of ITU-R BT.601 (studio range), by the printed equations; a pair of pixels shares U and V."""
    b, g, r = (picture[:, :, n].astype(float) for n in range(3))
    y = 16 + 0.257 * r + 0.504 * g + 0.098 * b
    u = (128 - 0.148 * r - 0.291 * g + 0.439 * b).reshape(16, 16, 2).mean(axis=2)
    v = (128 + 0.439 * r - 0.368 * g - 0.071 * b).reshape(16, 16, 2).mean(axis=2)
    chroma = np.stack([u, v], axis=2).reshape(16, 32)
    return np.round(np.stack([y, chroma] if luma_first else [chroma, y], axis=2)).astype(np.uint8)


def grey_of(picture: np.ndarray) -> np.ndarray:
    return picture[:, :, :1]


@pytest.mark.parametrize(
    ("encoding", "data", "expected", "tolerance"),
    [
        ("bgr8", BGR, BGR, 0),
        ("rgb8", BGR[:, :, ::-1], BGR, 0),
        ("bgra8", np.dstack([BGR, BGR[:, :, :1]]), BGR, 0),
        ("mono8", grey_of(BGR), np.repeat(grey_of(BGR), 3, axis=2), 0),
        ("yuv422", packed_yuv(BGR, luma_first=False), BGR, 5),
        ("yuv422_yuy2", packed_yuv(BGR, luma_first=True), BGR, 5),
    ],
)
@pytest.mark.parametrize("padding", [0, 12])
def test_every_encoding_becomes_the_same_picture(
    encoding: str, data: np.ndarray, expected: np.ndarray, tolerance: int, padding: int
) -> None:
    message = ros_image(foreign.image(data, encoding, padding=padding, stamp_ns=1_500_000_000), IMAGE)
    assert message.stamp_s == 1.5
    assert np.abs(message.decode().astype(int) - expected).max() <= tolerance


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_compressed_images_are_decoded(suffix: str) -> None:
    picture = ros_image(foreign.compressed_image(BGR, suffix), COMPRESSED).decode()
    assert np.abs(picture.astype(int) - BGR).mean() < 4


def test_a_zero_stamp_is_no_stamp() -> None:
    assert ros_image(foreign.image(BGR, "bgr8"), IMAGE).stamp_s is None


def planes(picture: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Y of every pixel, U and V of every second one in both directions, as in :func:`packed_yuv`."""
    packed = packed_yuv(picture, luma_first=True)
    return packed[:, :, 0], packed[::2, ::2, 1], packed[::2, 1::2, 1]


@pytest.mark.parametrize("encoding", ["nv12", "nv21", "i420", "yv12"])
def test_colours_of_half_the_resolution_become_the_same_picture(encoding: str) -> None:
    y, u, v = planes(BGR)
    first, second = (u, v) if encoding in ("nv12", "i420") else (v, u)
    chroma = np.stack([first, second], axis=2) if encoding.startswith("nv") else np.stack([first, second])
    data = np.concatenate([y.reshape(-1), chroma.reshape(-1)])
    message = foreign.image(data.reshape(24, 32, 1), encoding)
    message = message.replace(np.uint32(24).tobytes() + np.uint32(32).tobytes(), SIZE)
    picture = ros_image(message, IMAGE).decode()
    assert np.abs(picture.astype(int) - BGR).max() <= 8


SIZE = np.uint32(16).tobytes() + np.uint32(32).tobytes()


@pytest.mark.parametrize(
    ("encoding", "data"), [("bgr16", BGR), ("rgb16", BGR[:, :, ::-1]), ("mono16", grey_of(BGR))]
)
def test_of_samples_of_two_bytes_the_higher_one_counts(encoding: str, data: np.ndarray) -> None:
    samples = (data.astype("<u2") << 8) + 7
    picture = ros_image(foreign.image(samples.view(np.uint8), encoding), IMAGE).decode()
    expected = BGR if data.shape[2] == 3 else np.repeat(grey_of(BGR), 3, axis=2)
    assert np.array_equal(picture, expected)


def test_the_name_of_an_encoding_counts_in_any_case() -> None:
    assert np.array_equal(ros_image(foreign.image(BGR, "BGR8"), IMAGE).decode(), BGR)


@pytest.mark.parametrize("encoding", ["16UC1", "32FC1"])
def test_images_of_depth_are_refused_as_such(encoding: str) -> None:
    with pytest.raises(WireError, match=f"'{encoding}' of an image: depth or heat"):
        ros_image(foreign.image(BGR, encoding), IMAGE).decode()


@pytest.mark.parametrize("form", ["16UC1; compressedDepth png", "16UC1; png compressed "])
def test_compressed_images_of_depth_are_refused_as_such(form: str) -> None:
    depth = cv2.imencode(".png", np.full((16, 32), 1234, np.uint16))[1].tobytes()
    with pytest.raises(WireError, match="is depth or heat, not the light of a road"):
        ros_image(foreign.compressed_bytes(depth, form), COMPRESSED).decode()


@pytest.mark.parametrize("encoding", ["32FC1", "jpeg", "nv12", ""])
def test_an_unknown_encoding_is_named(encoding: str) -> None:
    with pytest.raises(WireError, match=f"'{encoding}'"):
        ros_image(foreign.image(BGR, encoding), IMAGE).decode()


def test_an_image_with_too_few_bytes_is_refused() -> None:
    with pytest.raises(WireError, match="is not one of encoding"):
        ros_image(foreign.image(BGR[:, :, :2], "bgr8"), IMAGE).decode()


def test_a_compressed_image_of_too_many_pixels_is_refused() -> None:
    huge = foreign.compressed_bytes(png_of_size(60000, 60000), ".png")
    with pytest.raises(WireError, match="'png' cannot be decoded"):
        ros_image(huge, COMPRESSED).decode()


@pytest.mark.parametrize("encoding", sorted(ENCODINGS))
@pytest.mark.parametrize("size", [(1, 1), (1, 2), (2, 2), (3, 3), (1, 640)])
def test_an_image_of_any_size_is_decoded_or_refused(encoding: str, size: tuple[int, int]) -> None:
    pixels = np.zeros((*size, ENCODINGS[encoding][0]), np.uint8)
    image = decode(foreign.image(pixels, encoding), IMAGE)
    assert image is None or image.shape == (*size, 3)


def decode(data: bytes, ros_type: str) -> Image | None:
    try:
        return ros_image(data, ros_type).decode()
    except WireError:
        return None


@given(
    at=st.integers(0, 10**6),
    value=st.integers(0, 255),
    keep=st.floats(0, 1),
    encoding=st.sampled_from(sorted(ENCODINGS)),
)
def test_broken_bytes_give_an_image_or_one_clear_error(
    at: int, value: int, keep: float, encoding: str
) -> None:
    for data, ros_type in (
        (foreign.image(BGR, encoding), IMAGE),
        (foreign.compressed_image(BGR), COMPRESSED),
    ):
        broken = bytearray(data)
        broken[at % 80] = value
        image = decode(bytes(broken[: round(keep * len(broken))]), ros_type)
        assert image is None or (image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8)


def test_the_tests_write_what_opencv_reads() -> None:
    assert cv2.cvtColor(packed_yuv(BGR, luma_first=False), cv2.COLOR_YUV2BGR_UYVY).shape == BGR.shape
