"""Numbers of a YAML file by dotted names, replaced in its text; all other bytes stay the same.

Besides the path of a number, such as ``fear.medium.speed_factor`` or ``inputs.speed.sets.low.1``, there are

* ``inputs.NAME.corner.K``: the K-th corner of the sets of an input, counted from 0 in rising order. Several
  sets meet there; it changes in all of them, so that the sets stay a partition.
* ``rules.N.weight``: the weight of a sentence; 1 when it has none.
"""

import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from ruamel.yaml.error import YAMLError

from trepid.config import InputError, editing_yaml, read_text

_WEIGHT = re.compile(r"\bwith\s+weight\s+([0-9.eE+-]+)")
_BEFORE_WEIGHT = re.compile(r"(\s+because\s+\w+\s*)?$")


class _Spot(NamedTuple):
    """A range of the text and its content."""

    start: int
    end: int
    text: str


class NumberedText:
    """The text of a rule file with replaceable numbers."""

    def __init__(self, path: Path) -> None:
        """Raises InputError when ``path`` is no YAML."""
        self.path = path
        try:
            self.text = read_text(path)
            self._root = editing_yaml().compose(self.text)
        except YAMLError as error:
            raise InputError(f"{path}: not valid YAML: {str(error).splitlines()[0]}") from error

    def value(self, name: str) -> float:
        """The number called ``name``. Raises InputError when there is none."""
        spots = self._spots(name)
        weight = _WEIGHT.search(spots[0].text)
        if name.startswith("rules."):
            return float(weight.group(1)) if weight else 1.0
        return float(spots[0].text)

    def change_numbers(self, values: Mapping[str, float]) -> str:
        """The text with other numbers. Raises InputError for an unknown name."""
        edits: dict[tuple[int, int], str] = {}
        for name, value in values.items():
            for spot in self._spots(name):
                key = spot.start, spot.end
                edits[key] = (
                    _reweight(edits.get(key, spot.text), value) if name.startswith("rules.") else f"{value:g}"
                )
        text = self.text
        for (start, end), new in sorted(edits.items(), reverse=True):
            text = text[:start] + new + text[end:]
        return text

    def _spots(self, name: str) -> list[_Spot]:
        parts = name.split(".")
        if len(parts) == 4 and parts[0] == "inputs" and parts[2] == "corner":
            return self._corner(name, parts[1], parts[3])
        if len(parts) == 3 and parts[0] == "rules" and parts[2] == "weight":
            return [_spot(self._node(name, parts[:2]))]
        return [self._number(name, self._node(name, parts))]

    def _corner(self, name: str, of: str, which: str) -> list[_Spot]:
        """All places of the ``which``-th corner of an input in its sets."""
        sets = self._node(name, ["inputs", of, "sets"])
        if any(points.id != "sequence" for _, points in sets.value):
            raise InputError(f"{self.path}: {name}: the sets of {of} are functions and have no corners")
        spots = [self._number(name, point) for _, points in sets.value for point in points.value]
        corners = sorted({float(spot.text) for spot in spots})
        if not which.isdecimal() or not 0 < int(which) < len(corners) - 1:
            raise InputError(f"{name}: the inner corners of {of} are 1 to {len(corners) - 2}")
        return [spot for spot in spots if float(spot.text) == corners[int(which)]]

    def _node(self, name: str, parts: list[str]) -> Any:
        node, begins = self._root, 0
        for part in parts:
            node, begins = self._below(name, node, part, begins)
        return node

    def _below(self, name: str, node: Any, part: str, begins: int) -> tuple[Any, int]:
        """The node called ``part`` in ``node``, and the position of its entry in the text."""
        if node.id == "mapping":
            for key, value in node.value:
                if key.value == part:
                    at = key.start_mark.index
                    if value.start_mark.index < at:
                        anchor = f"*{value.anchor}" if value.anchor else "an alias"
                        raise InputError(
                            f"{self.path}: {name}: {part} is {anchor}, defined elsewhere: change it there"
                        )
                    return value, at
            known = ", ".join(key.value for key, _ in node.value)
            raise InputError(f"{self.path}: {name}: unknown name {part!r}; known: {known}")
        if node.id == "sequence" and part.isdecimal() and int(part) < len(node.value):
            return node.value[int(part)], begins
        raise InputError(f"{self.path}: {name}: unknown name {part!r}")

    def _number(self, name: str, node: Any) -> _Spot:
        spot = _spot(node)
        try:
            finite = node.id == "scalar" and math.isfinite(float(spot.text))
        except ValueError:
            finite = False
        if not finite:
            raise InputError(f"{self.path}: {name}: is not a number")
        return spot


def _spot(node: Any) -> _Spot:
    start, end = node.start_mark.index, node.end_mark.index
    return _Spot(start, end, node.start_mark.buffer[start:end] if node.start_mark.buffer else str(node.value))


def _reweight(sentence: str, weight: float) -> str:
    """A rule with another weight; quotes around the rule are kept."""
    if _WEIGHT.search(sentence):
        return _WEIGHT.sub(f"with weight {weight:g}", sentence)
    quote = sentence[-1] if sentence[-1:] in "'\"" else ""
    inner = sentence[: len(sentence) - len(quote)]
    return _BEFORE_WEIGHT.sub(lambda m: f" with weight {weight:g}{m.group()}", inner, count=1) + quote
