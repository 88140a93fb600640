"""A report of many runs as one self-contained page: no network, nothing to install, opens in any browser.

In the process of a run: ``result, film = run_filmed(scenario, seed=seed)``, then ``summarise(scenario, result,
film)``, or None instead of the film for no image. In the process of the page, for every run: ``page.add(row,
tags=scenario.tags, command=…, detail=summary)``; at the end: ``page.write(path)``.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sim_harness.judging.metrics import MEANINGS
from sim_harness.report.summary import Detail
from trepid.config import InputError

TEMPLATE = Path(__file__).with_name("page.html")
COLUMNS = (
    "status",
    "scenario",
    "seed",
    "duration_s",
    "distance_m",
    "departures",
    "interventions",
    "collisions",
    "max_lateral_error_m",
    "rms_lateral_error_m",
    "max_lateral_accel_mps2",
    "max_lateral_jerk_mps3",
    "min_time_gap_s",
    "mean_speed_mps",
    "max_fear",
    "mean_fear",
)
"""Columns of the table; the other fields of ``sim run --json`` are listed in the details of the run."""
MAX_FAILED_PICTURES, MAX_OTHER_PICTURES = 200, 12
MAX_FILMS = 12  # runs whose frames follow the cursor, 0.4 MB each: failed and other ones


class Page:
    """Collects runs as they finish, then writes the page."""

    def __init__(
        self,
        title: str,
        *,
        max_failed_pictures: int = MAX_FAILED_PICTURES,
        max_other_pictures: int = MAX_OTHER_PICTURES,
    ) -> None:
        self._title = title
        self._left = {"failed": max_failed_pictures, "passed": max_other_pictures}
        self._limits = {**self._left, "films": MAX_FILMS}
        self._films_left = {"failed": MAX_FILMS // 2, "passed": MAX_FILMS - MAX_FILMS // 2}
        self._runs: list[str] = []
        self._details: list[str] = []
        self._edges: dict[str, int] = {}

    def __len__(self) -> int:
        return len(self._runs)

    def add(
        self,
        row: Mapping[str, Any],
        *,
        tags: Sequence[str] = (),
        command: str | None = None,
        detail: Detail | None = None,
    ) -> None:
        """Add a run: its ``row`` as of ``sim run --json``, and the result of :func:`summarise`.

        ``command`` repeats it; by default the scenario's name with the seed.
        """
        command = command or f"trepid sim run {row['scenario']} --seed {row['seed']}"
        self._runs.append(_json([[row[name] for name in COLUMNS], list(tags)]))
        self._details.append(_json({"row": dict(row), "command": command, "detail": self._pack(row, detail)}))

    def write(self, path: Path) -> None:
        """Write the page. Raises InputError when ``path`` cannot be written."""
        facts = {
            "title": self._title,
            "columns": COLUMNS,
            "pictures": self._limits,
            "meanings": MEANINGS,
        }
        parts = {
            "TITLE": self._title.replace("&", "&amp;").replace("<", "&lt;"),
            "FACTS": _json(facts),
            "RUNS": "[" + ",\n".join(self._runs) + "]",
            "EDGES": "[" + ",\n".join(self._edges) + "]",
            "DETAILS": "\n".join(
                f'<script type="application/json" id="detail-{i}">{detail}</script>'
                for i, detail in enumerate(self._details)
            ),
        }
        text = re.sub(r"%([A-Z]+)%", lambda found: parts[found[1]], TEMPLATE.read_text(encoding="utf-8"))
        try:
            path.write_text(text, encoding="utf-8")
        except OSError as error:
            raise InputError(f"{path}: cannot be written: {error.strerror}") from error

    def _pack(self, row: Mapping[str, Any], detail: Detail | None) -> Detail | None:
        """``detail`` with its lane edges, which many runs share, as a number, and no more pictures than allowed."""
        if detail is None:
            return None
        edges = self._edges.setdefault(_json(detail["edges"]), len(self._edges))
        status = "passed" if row["status"] == "passed" else "failed"
        picture = detail["picture"]
        if picture is not None and self._left[status] > 0:
            self._left[status] -= 1
        else:
            picture = None
        frames = detail["frames"]
        if frames is not None and self._films_left[status] > 0:
            self._films_left[status] -= 1
        else:
            frames = None
        return {**detail, "edges": edges, "picture": picture, "frames": frames}


def _json(value: Any) -> str:
    """Compact JSON that is safe within a script element."""
    text = json.dumps(value, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
