"""Bytes of text files to text: marks, encodings without marks, and what is refused by its name."""

import codecs
import gzip

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.files.decoding import UndecodableText, decode_text, is_broken

TEXT = 'VERSION "1.0"\nBreite: 0,32 m – größer\n'
MARKED = {
    "utf-8": codecs.BOM_UTF8,
    "utf-16-le": codecs.BOM_UTF16_LE,
    "utf-16-be": codecs.BOM_UTF16_BE,
    "utf-32-le": codecs.BOM_UTF32_LE,
    "utf-32-be": codecs.BOM_UTF32_BE,
}


@pytest.mark.parametrize("encoding", MARKED)
def test_a_byte_order_mark_decides_and_is_no_part_of_the_text(encoding: str) -> None:
    assert decode_text(MARKED[encoding] + TEXT.encode(encoding)) == TEXT


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16-le", "utf-16-be"])
def test_text_without_a_mark_is_told_by_its_zero_bytes(encoding: str) -> None:
    assert decode_text(TEXT.encode(encoding)) == TEXT


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0\ufeff")))
def test_any_text_in_utf_8_is_read_as_it_was_written(text: str) -> None:
    assert decode_text(text.encode()) == text


def test_the_code_page_of_windows_is_read_where_a_format_allows_it() -> None:
    data = TEXT.encode("cp1252")
    assert decode_text(data, windows=True) == TEXT
    with pytest.raises(UndecodableText, match="byte 0x96 is no UTF-8; save it as UTF-8") as refused:
        decode_text(data)
    assert (refused.value.line, refused.value.column) == (2, 16)


def test_utf_8_is_never_taken_for_the_code_page_of_windows() -> None:
    assert decode_text(TEXT.encode(), windows=True) == TEXT


def test_broken_bytes_cost_only_their_line() -> None:
    lines = decode_text(b"first\nsec\xff\xfend\nthird\n", broken_bytes=True).split("\n")
    assert [is_broken(line) for line in lines] == [False, True, False, False]
    assert (lines[0], lines[2]) == ("first", "third")


def test_a_file_of_zero_bytes_is_called_so() -> None:
    with pytest.raises(UndecodableText, match="only zero bytes, as after a loss of power"):
        decode_text(bytes(512))


@pytest.mark.parametrize(
    ("data", "what"),
    [
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n", "a Git LFS pointer"),
        (b"PK\x03\x04\x14\0", "a ZIP archive"),
        (gzip.compress(b"t_s,image\n", mtime=0), "packed by gzip: unpack it"),
        (b"%PDF-1.7\n%\xe2\xe3", "a PDF document"),
    ],
)
@pytest.mark.parametrize("windows", [True, False])
def test_what_stands_where_a_text_should_is_refused_by_its_name(
    data: bytes, what: str, windows: bool
) -> None:
    with pytest.raises(UndecodableText, match=what):
        decode_text(data, windows=windows)
