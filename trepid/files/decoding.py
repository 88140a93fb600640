"""Bytes of a text file to text: the one decision about its encoding, for every format that Trepid reads.

A byte order mark decides and is no part of the text. Without one, text is UTF-8, or UTF-16 where every other byte
of its beginning is zero: names, numbers and signs of all formats are ASCII. Formats whose tools write in the code
page of Windows may be read as Windows-1252 where they are not UTF-8; this decides about comments and names only.
"""

import codecs
from collections.abc import Mapping
from types import MappingProxyType

_MARKS = (  # UTF-32 first: its mark begins with that of UTF-16
    (codecs.BOM_UTF32_LE, "utf-32-le"),
    (codecs.BOM_UTF32_BE, "utf-32-be"),
    (codecs.BOM_UTF8, "utf-8"),
    (codecs.BOM_UTF16_LE, "utf-16-le"),
    (codecs.BOM_UTF16_BE, "utf-16-be"),
)
_BEGINNING = 4096  # bytes that tell UTF-16 without a mark
_ASCII_SHARE = 0.8  # of its characters there

GIT_LFS = b"version https://git-lfs"
_PAGE = "a web page: download the file itself"
_OTHER_FILES = {
    GIT_LFS: "a Git LFS pointer, not the file: `git lfs pull` gets it",
    b"PK\x03\x04": "a ZIP archive, such as a workbook (.xlsx): save or unpack it as text",
    b"\x1f\x8b": "packed by gzip: unpack it",
    b"%PDF": "a PDF document",
    b"<!doctype html": _PAGE,
    b"<html": _PAGE,
}
"""How files begin that stand where others should, and what to say of them."""
MARK_BYTES = 64  # at least those of every mark, after a few blanks


class UndecodableText(ValueError):
    """Bytes that are no text: ``line`` and ``column``, from 1, of the first wrong one, and ``problem``."""

    def __init__(self, line: int, column: int, problem: str) -> None:
        super().__init__(problem)
        self.line, self.column, self.problem = line, column, problem


def decode_text(data: bytes, *, windows: bool = False, broken_bytes: bool = False) -> str:
    """The text in ``data``, without its byte order mark. Raises UndecodableText.

    ``windows``: what is not UTF-8 is Windows-1252. ``broken_bytes``: bytes that are no UTF-8 become lone
    surrogates, which no text holds, so that only their lines are lost (:func:`is_broken`).
    """
    if data and not data.strip(b"\0"):
        raise UndecodableText(1, 1, "holds only zero bytes, as after a loss of power")
    refuse_packed(data)
    mark, encoding = mark_and_encoding(data)
    body = data[len(mark) :]
    errors = "surrogateescape" if broken_bytes and encoding == "utf-8" else "strict"
    try:
        return body.decode(encoding, errors)
    except UnicodeDecodeError as error:
        if windows and not mark and encoding == "utf-8":
            return body.decode("cp1252", errors="replace")  # a few bytes have no meaning there
        raise _undecodable(body, error, encoding) from error


def refuse_packed(data: bytes) -> None:
    """Raise UndecodableText where ``data`` begins like an archive, a document, or a pointer of Git LFS."""
    if what := other_file(data):
        raise UndecodableText(1, 1, f"is {what}")


def other_file(data: bytes, own: Mapping[bytes, str] = MappingProxyType({})) -> str:
    """What a file is that begins with ``data`` and stands where one of another format should; "" if not known.

    ``own``: what to say, in that format, of further beginnings, or in place of the words for all.
    """
    start = data[:MARK_BYTES].lstrip().lower()
    known = {**_OTHER_FILES, **own}
    return next((what for mark, what in known.items() if start.startswith(mark.lower())), "")


def mark_and_encoding(data: bytes) -> tuple[bytes, str]:
    """The byte order mark of ``data``, empty without one, and the encoding that mark or zero bytes tell."""
    unmarked = b"", _unmarked_encoding(data)
    return next((found for found in _MARKS if data.startswith(found[0])), unmarked)


def is_broken(line: str) -> bool:
    """Whether ``line`` holds bytes that are no UTF-8 (``broken_bytes`` of :func:`decode_text`)."""
    try:
        line.encode()
    except UnicodeEncodeError:
        return True
    return False


def _unmarked_encoding(data: bytes) -> str:
    """UTF-16 by the zero bytes of its ASCII characters, else UTF-8."""
    beginning = data[:_BEGINNING]
    characters = len(beginning) // 2
    if not characters or b"\0" not in beginning:
        return "utf-8"
    high, low = beginning[1 : 2 * characters : 2].count(0), beginning[0 : 2 * characters : 2].count(0)
    if high >= _ASCII_SHARE * characters and not low:
        return "utf-16-le"
    return "utf-16-be" if low >= _ASCII_SHARE * characters and not high else "utf-8"


def _undecodable(data: bytes, error: UnicodeDecodeError, encoding: str) -> UndecodableText:
    before = data[: error.start].decode(encoding, errors="replace")
    line, column = before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1
    bad = f"byte 0x{data[error.start]:02x} is no {encoding.upper()}; save it as UTF-8"
    return UndecodableText(line, column, bad)
