"""XML whose elements know their place in the file, so that a bad value is reported as file:line:column."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

from trepid.config import InputError

LARGEST = 1e9  # beyond any coordinate on Earth [m]


@dataclass(slots=True)
class Element:
    """An XML element; line and column count from 1."""

    source: Path
    tag: str
    attributes: dict[str, str]
    line: int
    column: int
    children: list["Element"] = field(default_factory=list)

    def error(self, message: str) -> InputError:
        """``message`` with the place of this element."""
        return InputError(f"{self.source}:{self.line}:{self.column}: <{self.tag}>: {message}")

    def all(self, path: str) -> list["Element"]:
        """The elements at ``path`` ("lanes/laneSection") below this one, in the order of the file."""
        found = [self]
        for tag in path.split("/"):
            found = [child for element in found for child in element.children if child.tag == tag]
        return found

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
        if name not in self.attributes:
            raise self.error(f"attribute {name!r} is missing")
        return self.attributes[name]

    def number(self, name: str, default: float | None = None, *, most: float = LARGEST) -> float:
        """The attribute ``name`` as a finite number of at most ``most`` either way. Raises InputError."""
        if default is not None and name not in self.attributes:
            return default
        text = self.text(name)
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(f"{name}={text!r}: expected a finite number")
        if abs(value) > most:
            raise self.error(f"{name}={text!r}: expected at most {most:g}")
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
    parser = expat.ParserCreate()
    top = Element(path, "", {}, 1, 1)
    open_elements = [top]

    def start(tag: str, attributes: dict[str, str]) -> None:
        line, column = parser.CurrentLineNumber, parser.CurrentColumnNumber + 1
        element = Element(path, tag, attributes, line, column)
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def end(_tag: str) -> None:
        open_elements.pop()

    parser.StartElementHandler = start
    parser.EndElementHandler = end
    try:
        parser.Parse(data, True)
    except (expat.ExpatError, ValueError, LookupError) as error:  # also encodings that nobody knows
        line, column = parser.ErrorLineNumber, parser.ErrorColumnNumber + 1
        what = expat.errors.messages.get(parser.ErrorCode) or str(error)
        raise InputError(f"{path}:{line}:{column}: not valid XML: {what}") from error
    return top.children[0]
