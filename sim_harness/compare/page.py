"""A comparison as one self-contained page (.html)."""

import base64
import io
from collections.abc import Iterator, Mapping
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

from trepid.config import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNITS = {
    "_mps3": "m/s³",
    "_mps2": "m/s²",
    "_mps": "m/s",
    "_percent": "%",
    "_per_km": "1/km",
    "_per_min": "1/min",
    "_rad": "rad",
    "_m": "m",
    "_s": "s",
}
STYLE = """
:root { color-scheme: light dark; }
body { font: 14px/1.45 system-ui, sans-serif; margin: 24px; max-width: 1000px; }
table { border-collapse: collapse; margin: 12px 0; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 3px 14px 3px 0; border-bottom: 1px solid #8884; vertical-align: top; }
td.n, th.n { text-align: right; }
img { width: 100%; max-width: 900px; background: #fff; }
code { overflow-wrap: anywhere; }
.faint { opacity: .7; }
"""


def unit_of(name: str) -> str:
    """The unit in the name of a figure; "" for a pure number."""
    return next((unit for end, unit in UNITS.items() if name.endswith(end)), "")


def write_page(
    out: Path,
    found: Mapping[str, Any],
    lines: list[str],
    meanings: Mapping[str, str],
    figure: "Figure | None",
) -> None:
    """Write the comparison ``found`` to ``out``; ``lines``: what the command line prints beside the tables.

    ``meanings``: a sentence by name of a figure. Raises InputError when ``out`` exists or cannot be written.
    """
    body = "\n".join(_body(found, lines, meanings, figure))
    title = f"{Path(found['a']).name} and {Path(found['b']).name}"
    text = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        "<meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline';"
        f' img-src data:"><title>{escape(title)}</title><style>{STYLE}</style></head><body>\n{body}\n'
        "</body></html>\n"
    )
    try:
        with out.open("x", encoding="utf-8") as file:
            file.write(text)
    except FileExistsError as error:
        raise InputError(f"{out}: exists already and is kept; give another name") from error
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror}") from error


def _body(
    found: Mapping[str, Any], lines: list[str], meanings: Mapping[str, str], figure: "Figure | None"
) -> Iterator[str]:
    yield f"<h1>{escape(Path(found['a']).name)} and {escape(Path(found['b']).name)}</h1>"
    yield f"<p>A <code>{escape(found['a'])}</code><br>B <code>{escape(found['b'])}</code></p>"
    yield from (f"<p>{escape(line)}</p>" for line in lines)
    if figure is not None:
        image = io.BytesIO()
        figure.savefig(image, format="png")
        uri = base64.b64encode(image.getvalue()).decode()
        yield f'<img alt="fear, speed and lateral offset of both over time" src="data:image/png;base64,{uri}">'
    if "figures" in found:
        head = ["figure", "A", "B", "B - A", "unit", "meaning"]
        yield _table(head, [_figure(row, meanings) for row in found["figures"]])
    for run in found.get("changed", ()):
        yield f"<h2>{escape(run['scenario'])} seed {run['seed']}</h2>"
        rows = [
            [name, value_text(a), value_text(b), change_text(a, b), unit_of(name), meanings.get(name, "")]
            for name, (a, b) in run["changed"].items()
        ]
        yield _table(["figure", "A", "B", "B - A", "unit", "meaning"], rows)


def _figure(row: Mapping[str, Any], meanings: Mapping[str, str]) -> list[str]:
    name = row["name"]
    time_in = {"mode_": "time in this mode", "cause_": "time with this cause of fear"}
    meaning = meanings.get(name) or next(
        (text for start, text in time_in.items() if name.startswith(start)), ""
    )
    return [name, *(value_text(row[key]) for key in ("a", "b", "change")), unit_of(name), meaning]


def _table(head: list[str], rows: list[list[str]]) -> str:
    def cells(row: list[str], tag: str) -> str:
        opened = [f'<{tag} class="n">' if 1 <= number <= 3 else f"<{tag}>" for number in range(len(row))]
        return "".join(f"{start}{escape(cell)}</{tag}>" for start, cell in zip(opened, row, strict=True))

    lines = [f"<tr>{cells(head, 'th')}</tr>", *(f"<tr>{cells(row, 'td')}</tr>" for row in rows)]
    return "<table>" + "\n".join(lines) + "</table>"


def value_text(value: Any) -> str:
    """A value of a comparison as text."""
    if value is None:
        return "unknown"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def change_text(a: Any, b: Any) -> str:
    """B - A of two numbers as text; "" for anything else."""
    numbers = all(isinstance(one, int | float) and not isinstance(one, bool) for one in (a, b))
    return f"{b - a:+z.4g}" if numbers else ""
