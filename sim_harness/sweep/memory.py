"""Rows of figures on disk, each good for as long as the code that it hangs on."""

import json
from pathlib import Path
from typing import Any

Row = dict[str, Any]


class Memory:
    """One JSON file: name -> key and row."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._known: dict[str, Any] = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}

    def row(self, name: str, key: str) -> Row | None:
        """What was put there with the same key."""
        found = self._known.get(name, {})
        return found["row"] if found.get("key") == key else None

    def put(self, name: str, key: str, row: Row) -> None:
        """Keep a row; the file is whole at any time."""
        self._known[name] = {"key": key, "row": row}
        self._path.parent.mkdir(parents=True, exist_ok=True)
        part = self._path.with_suffix(".part")
        part.write_text(json.dumps(self._known), encoding="utf-8")
        part.replace(self._path)
