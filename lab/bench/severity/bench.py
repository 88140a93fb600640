"""Whether fear grows with the severity of every disturbance and fault, and names the right cause.

Every stress is driven at every grade, on a straight and in a bend, at several speeds, on rails
(:mod:`lab.bench.severity.drive`). Fear *falls* where its mean over the seeds is less than at a lower grade
of the same stress, road and speed by more than the hysteresis band of the rules, within which modes do not change.

Every drive is one line in ``runs/severity_<seed>.jsonl``: an interrupted benchmark continues.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from statistics import fmean
from typing import Any

from lab.bench.chosen import known_names
from lab.bench.severity.drive import StressedDrive, driven_row
from lab.bench.severity.stresses import GRADES, NOTHING, STRESSES
from sim_harness.sweep.store import Row, stored_rows
from supervisor.rules.inference import FearRules
from trepid.config import WORK_DIR, default_file
from trepid.images.figure_style import MAP, new_figure, save

ROADS, SPEEDS_MPS = ("straight", "bend"), (5.0, 8.0, 12.0, 20.0)
QUICK_GRADES, QUICK_SPEEDS_MPS = (0, 1, 3, 5), (8.0, 20.0)
SEEDS = 2
DETAILS = "fear by road and speed"
TARGET = 95.0  # percent of right causes
Cells = Mapping[tuple[str, str, float, int], list[Row]]
"""Rows of all seeds by stress, road, speed and grade."""


def bench_severity(
    seed: int,
    *,
    count: int | None = None,
    jobs: int = 1,
    quick: bool = False,
    faults: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Falls of fear, right causes, and mean fear of every stress.

    ``count``: roads of each kind and speed; ``faults``: names of the stresses, by default all of STRESSES.
    Raises InputError for an unknown name.
    """
    names = known_names(faults, STRESSES, "disturbance or fault") or tuple(STRESSES)
    grades, speeds_mps = (QUICK_GRADES, QUICK_SPEEDS_MPS) if quick else (GRADES, SPEEDS_MPS)
    tasks = {
        task.key: task
        for number in range(count or SEEDS)
        for road in ROADS
        for speed_mps in speeds_mps
        for task in _tasks(names, grades, road, speed_mps, 1000 * seed + number)
    }
    path = WORK_DIR / "runs" / f"severity_{seed}.jsonl"
    return summary(stored_rows(path, driven_row, tasks, jobs=jobs))


def _tasks(
    names: Iterable[str], grades: Iterable[int], road: str, speed_mps: float, seed: int
) -> Iterator[StressedDrive]:
    """The drives on one road; those that share their images follow each other."""
    yield StressedDrive(NOTHING, 0, road, speed_mps, seed)
    in_turn = sorted(names, key=lambda name: not STRESSES[name].behind_camera)
    yield from (
        StressedDrive(name, grade, road, speed_mps, seed) for name in in_turn for grade in grades if grade
    )


def summary(rows: list[Row]) -> dict[str, Any]:
    """The tables of the benchmark from its rows."""
    cells = _cells(rows)
    grades = sorted({grade for *_, grade in cells})
    places = sorted({(road, speed) for _, road, speed, _ in cells})
    names = [name for name in STRESSES if any(cell[0] == name for cell in cells)]
    table: dict[str, Row] = {name: {} for name in names}
    details: dict[str, Row] = {}
    named, right = Counter[str](), Counter[str]()
    for name in names:
        drops: list[float] = []
        worst: list[float] = []
        for road, speed in places:
            levels = {g: _fear(cells, name, road, speed, g) for g in grades}
            details[f"{name}, {road}, {speed:g} m/s"] = {f"grade {g}": round(f, 3) for g, f in levels.items()}
            drops += falls(levels.values())
            worst += falls(_fear(cells, name, road, speed, g, "worst") for g in grades)
        found = _causes(cells, name)
        named[name], right[name] = found.total(), sum(found[cause] for cause in STRESSES[name].causes)
        wrong = {cause: number for cause, number in found.items() if cause not in STRESSES[name].causes}
        table[name] = {
            **{f"grade {g}": _mean(details, name, g) for g in grades},
            "falls": len(drops),
            "greatest_fall": round(max(drops, default=0.0), 3),
            "falls_of_p95": len(worst),
            "right_cause_percent": _percent(right[name], named[name]),
            "wrong_causes": ", ".join(
                f"{c} {_percent(n, named[name]):.0f} %" for c, n in _sort_by_count(wrong)
            )
            or None,
        }
    return {
        "falls": f"{sum(row['falls'] for row in table.values())}, target 0",
        "falls of the 95th percentile": sum(row["falls_of_p95"] for row in table.values()),
        "right causes": f"{_percent(right.total(), named.total())} %, target {TARGET:.0f} %",
        "stresses with fewer right causes": ", ".join(n for n in names if 100 * right[n] < TARGET * named[n])
        or "none",
        "": table,
        DETAILS: details,
    }


def falls(fears: Iterable[float]) -> list[float]:
    """How far each fear of a rising grade is below the greatest one before, where that is more than the band."""
    band = FearRules.load(default_file("fear.yaml")).file.hysteresis.band
    known = list(fears)
    return [
        most - fear for most, fear in zip(accumulate(known, max), known, strict=True) if most - fear > band
    ]


def _cells(rows: list[Row]) -> Cells:
    cells: dict[tuple[str, str, float, int], list[Row]] = {}
    for row in rows:
        cells.setdefault((row["stress"], row["road"], row["speed_mps"], row["grade"]), []).append(row)
    return cells


def _fear(cells: Cells, name: str, road: str, speed_mps: float, grade: int, of: str = "mean") -> float:
    """Fear over the seeds: the mean of their means, or of their 95th percentiles (``worst``)."""
    return fmean(row[of] for row in cells[name if grade else NOTHING, road, speed_mps, grade])


def _causes(cells: Cells, name: str) -> Counter[str]:
    """How often each cause was named in all drives of a stress."""
    found = Counter[str]()
    for (stress, *_), rows in cells.items():
        for row in rows:
            found.update(row["causes"] if stress == name else {})
    return found


def _mean(details: Mapping[str, Row], name: str, grade: int) -> float:
    return round(
        fmean(row[f"grade {grade}"] for key, row in details.items() if key.startswith(f"{name}, ")), 3
    )


def _percent(part: int, whole: int) -> float | None:
    return round(100 * part / whole, 1) if whole else None


def _sort_by_count(counts: Mapping[str, int]) -> list[tuple[str, int]]:
    return sorted(counts.items(), key=lambda item: -item[1])


def draw(measured: Mapping[str, Any], path: Path) -> None:
    """A heat map of mean fear: rows are the stresses, columns the grades, panels the roads and speeds."""
    details: Mapping[str, Row] = measured[DETAILS]
    places = list(dict.fromkeys(key.split(", ", 1)[1] for key in details))
    names = list(dict.fromkeys(key.split(", ", 1)[0] for key in details))
    grades = list(next(iter(details.values())))
    figure = new_figure(2.2 + 1.15 * len(places), 1.0 + 0.19 * len(names), layout="constrained")
    panels = figure.subplots(1, len(places), sharey=True, squeeze=False)[0]
    for panel, place in zip(panels, places, strict=True):
        fears = [[details[f"{name}, {place}"][grade] for grade in grades] for name in names]
        image = panel.imshow(fears, vmin=0.0, vmax=1.0, cmap=MAP, aspect="auto")
        panel.set_title(place.replace(", ", "\n"), fontsize=8)
        panel.set_xticks(range(len(grades)), [grade.removeprefix("grade ") for grade in grades], fontsize=7)
        panel.set_yticks(range(len(names)), names, fontsize=7)
        panel.set_xlabel("grade", fontsize=7)
    figure.colorbar(image, ax=panels, label="mean fear", fraction=0.05, pad=0.01)
    save(figure, path)
