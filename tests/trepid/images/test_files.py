"""The order of image files in a folder, and complete images from them."""

from pathlib import Path

import cv2
import image_file_rig as rig
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.config import InputError
from trepid.images.files import is_upright_jpeg, natural_order, read_image


def order(*names: str) -> list[str]:
    return [path.name for path in natural_order(map(Path, names))]


def test_numbers_in_names_count_by_value() -> None:
    assert order("100.jpg", "2.jpg", "10.jpg", "1.jpg") == ["1.jpg", "2.jpg", "10.jpg", "100.jpg"]
    assert order("run2_frame10.png", "run10_frame1.png", "run2_frame9.png") == [
        "run2_frame9.png",
        "run2_frame10.png",
        "run10_frame1.png",
    ]


def test_names_without_numbers_are_in_alphabetical_order() -> None:
    assert order("b.png", "A.jpg", "c.png") == ["A.jpg", "b.png", "c.png"]


@given(st.lists(st.integers(0, 10**9), unique=True, min_size=1))
def test_plain_counters_are_in_order_of_their_values(numbers: list[int]) -> None:
    assert order(*(f"{n}_cam-image_array_.jpg" for n in numbers)) == [
        f"{n}_cam-image_array_.jpg" for n in sorted(numbers)
    ]


@given(st.sets(st.text("ab01.é²", min_size=1), min_size=1))
def test_the_order_is_total_for_any_names(names: set[str]) -> None:
    assert order(*sorted(names)) == order(*sorted(names, reverse=True))


PICTURE = np.random.default_rng(3).integers(0, 255, (120, 160, 3)).astype(np.uint8)


def encode(suffix: str, picture: np.ndarray = PICTURE, *parameters: int) -> bytes:
    return bytes(cv2.imencode(suffix, picture, parameters)[1])


def with_thumbnail(jpeg: bytes) -> bytes:
    """The JPEG with another one in its segment APP1, as cameras write it."""
    body = b"Exif\0\0" + encode(".jpg", PICTURE[:30, :40])
    return jpeg[:2] + b"\xff\xe1" + (len(body) + 2).to_bytes(2, "big") + body + jpeg[2:]


JPEGS = {
    "baseline": encode(".jpg"),
    "progressive": encode(".jpg", PICTURE, cv2.IMWRITE_JPEG_PROGRESSIVE, 1),
    "with restart marks": encode(".jpg", PICTURE, cv2.IMWRITE_JPEG_RST_INTERVAL, 2),
    "with a thumbnail": with_thumbnail(encode(".jpg")),
}


@pytest.mark.parametrize("kind", JPEGS)
def test_a_jpeg_is_complete_with_its_own_end_mark_whatever_follows_it(kind: str, tmp_path: Path) -> None:
    whole, path = JPEGS[kind], tmp_path / "a.jpg"
    for trailer in (
        b"",
        b"\0\0",
        b"ftypmp42" + bytes(range(256)) * 1000,
    ):  # such as the film of a motion photo
        path.write_bytes(whole + trailer)
        assert read_image(path).shape == PICTURE.shape
    for share in (0.02, 0.4, 0.9):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError, match="truncated"):
            read_image(path)


def test_a_png_may_be_followed_by_other_data(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(encode(".png") + bytes(100_000))
    assert (read_image(path) == PICTURE).all()


def test_an_image_of_too_many_pixels_is_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "huge.png"
    path.write_bytes(rig.png_of_size(60000, 60000))
    with pytest.raises(InputError, match=r"huge\.png: not an image that can be decoded$"):
        read_image(path)


@pytest.mark.parametrize("name", ["photo.heic", "renamed.jpg"])
def test_a_heic_photograph_is_refused_with_the_command_that_converts_it(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    path.write_bytes(b"\0\0\0\x18ftypheic\0\0\0\0mif1heic")
    with pytest.raises(InputError, match=r"is a HEIC photograph[^\n]*heif-convert[^\n]*$"):
        read_image(path)


@pytest.mark.parametrize("big_endian", [False, True])
@pytest.mark.parametrize("orientation", range(10))
def test_a_jpeg_is_upright_as_stored_where_its_exif_turns_nothing(orientation: int, big_endian: bool) -> None:
    turned = rig.turned_jpeg(encode(".jpg"), orientation, big_endian=big_endian)
    assert is_upright_jpeg(turned) == (orientation not in range(2, 9))


@pytest.mark.parametrize("kind", JPEGS)
def test_a_jpeg_without_orientation_is_upright(kind: str) -> None:
    assert is_upright_jpeg(JPEGS[kind])


@pytest.mark.parametrize("data", [b"", encode(".png")], ids=["empty", "PNG"])
def test_other_files_are_no_upright_jpeg(data: bytes) -> None:
    assert not is_upright_jpeg(data)
