"""XML elements that report errors with file:line:column, read by lxml.

lxml gives a line but no column, and the line where a start tag ends rather than where it begins. The place is
therefore taken from the text: the n-th start tag of the file belongs to the n-th element of the tree. Elements are
found by local name, whatever namespace the file declares.
"""

import math
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from lxml import etree

from trepid.config import InputError
from trepid.files.decoding import UndecodableText, decode_text, mark_and_encoding, refuse_packed

MAX_COORDINATE = 1e9  # beyond any coordinate on Earth [m]
_DECLARED = re.compile(rb"""\s*<\?xml[^>]*?\sencoding\s*=\s*["']([\w.:-]+)""")
_LATE_DECLARATION = re.compile(r"\A(\s+)(<\?xml[^>\n]*\?>)")
_START_TAG = re.compile(
    r"<!--.*?-->|<!\[CDATA\[.*?\]\]>|<\?.*?\?>|<!DOCTYPE[^\[>]*(?:\[.*?\]\s*)?>|<(?=[^/!?])", re.S
)


@dataclass(frozen=True, slots=True)
class Element:
    """An XML element of the file ``source``, whose text is ``text_of_file``."""

    source: Path
    text_of_file: str
    node: Any  # an lxml element

    @property
    def tag(self) -> str:
        """The local name."""
        return str(etree.QName(self.node).localname)

    @property
    def attributes(self) -> dict[str, str]:
        """The attributes by name."""
        return dict(self.node.attrib)

    def error(self, message: str) -> InputError:
        """``message`` with the place of this element, in the file and in the road."""
        number = next(n for n, node in enumerate(self.node.getroottree().iter("*")) if node is self.node)
        starts = [m.start() for m in _START_TAG.finditer(self.text_of_file) if m.group() == "<"]
        before = self.text_of_file[: starts[number]]
        line, column = before.count("\n") + 1, len(before) - before.rfind("\n")
        whose = self._whose()
        place = f"{self.source}:{line}:{column}: <{self.tag}>"
        return InputError(f"{place}{f' of {whose}' if whose else ''}: {message}")

    def _whose(self) -> str:
        """The road, the lane and the station of this element; "" outside a road."""
        chain = [self.node, *self.node.iterancestors()]
        known = {str(etree.QName(node).localname): node for node in reversed(chain)}
        parts = [
            f"{tag} {known[tag].get('id')}"
            for tag in ("road", "lane")
            if tag in known and known[tag].get("id")
        ]
        for tag in ("geometry", "laneSection", "laneOffset"):
            if tag in known and known[tag].get("s"):
                parts.append(f"s = {known[tag].get('s')} m")
        return ", ".join(parts)

    def all(self, path: str) -> list["Element"]:
        """The elements at ``path`` ("lanes/laneSection", "*") below this one, in the order of the file."""
        anywhere = "/".join(f"{{*}}{tag}" for tag in path.split("/"))
        return [Element(self.source, self.text_of_file, node) for node in self.node.findall(anywhere)]

    def first(self, path: str) -> "Element | None":
        """The first element at ``path``, None without one."""
        return next(iter(self.all(path)), None)

    def need(self, path: str) -> "Element":
        """The first element at ``path``. Raises InputError without one."""
        found = self.first(path)
        if found is None:
            raise self.error(f"expected a <{path}> in here")
        return found

    def text(self, name: str) -> str:
        """The attribute ``name``. Raises InputError when it is missing."""
        value = self.node.get(name)
        if value is None:
            raise self.error(f"attribute {name!r} is missing")
        return str(value)

    def number(
        self, name: str, default: float | None = None, *, max_magnitude: float = MAX_COORDINATE
    ) -> float:
        """The attribute ``name`` as a finite number. Raises InputError."""
        if default is not None and name not in self.node.attrib:
            return default
        text = self.text(name)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(f"{name}={text!r}: expected a finite number")
        if abs(value) > max_magnitude:
            raise self.error(f"{name}={text!r}: expected at most {max_magnitude:g}")
        return value

    def integer(self, name: str) -> int:
        """The attribute ``name`` as a whole number. Raises InputError."""
        text = self.text(name)
        try:
            return int(text)
        except ValueError:
            raise self.error(f"{name}={text!r}: expected a whole number") from None


def read_xml(path: Path) -> Element:
    """The root element of the XML file ``path``. Raises InputError with file:line:column."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror or error}") from error
    try:
        refuse_packed(data)
        text = _text_by_bytes(data)
        encoding = None if text is None else "utf-8"
        parser = etree.XMLParser(resolve_entities=False, no_network=True, encoding=encoding)
        root = etree.fromstring(data if text is None else text.encode(), parser)
        text = data.decode(root.getroottree().docinfo.encoding) if text is None else text
    except etree.XMLSyntaxError as error:
        line, column = error.position
        what = parser.error_log[0].message if len(parser.error_log) else str(error)
        raise InputError(f"{path}:{line}:{max(column, 1)}: not valid XML: {what.strip()}") from error
    except UndecodableText as error:
        raise InputError(f"{path}:{error.line}:{error.column}: {error.problem}") from error
    except (LookupError, ValueError) as error:
        raise InputError(f"{path}:1:1: not valid XML: {error}") from error
    return Element(path, text.replace("\r\n", "\n"), root)


def _text_by_bytes(data: bytes) -> str | None:
    """The text in ``data``, where a mark, zero bytes or UTF-8 decide; None where another encoding is declared.

    Text that is called UTF-8 and is none is in the code page of Windows. Blanks and lines above the declaration
    stay, and the declaration, which XML allows in the first place only, is blanked. Raises UndecodableText.
    """
    mark, encoding = mark_and_encoding(data)
    is_marked = bool(mark) or encoding != "utf-8" or b"\0" in data
    declared = _DECLARED.match(data)
    if not is_marked and declared is not None and declared[1].lower() not in (b"utf-8", b"utf8"):
        return None
    text = decode_text(data, windows=True)
    return _LATE_DECLARATION.sub(lambda found: found[1] + " " * len(found[2]), text)
