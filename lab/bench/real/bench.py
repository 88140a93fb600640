"""`trepid bench real`: every sequence of the real sets, estimators, supervisor and trivial baselines."""

import shutil
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from lab.bench.real.baselines import fit_trapezoid
from lab.bench.real.ego_lane import fixed_lane
from lab.bench.real.judgement import judgements
from lab.bench.real.labels import SURFACES
from lab.bench.real.look import Row, answers, look_at_frames, supervised_estimators
from lab.bench.real.scores import figures, wrong
from lab.bench.real.sets import SETS, data_folder
from lab.bench.real.sheets import evenly, reliability, sheet, worst
from lab.bench.real.supervision import supervision_figures
from perception.estimators import estimators as all_estimators
from perception.estimators import estimators_here, no_estimator
from sim_harness.sweep.fingerprint import estimator_fingerprint, fingerprint, import_closure
from sim_harness.sweep.store import Store
from trepid.config import ROOT, InputError
from trepid.files.cache import cache_file
from trepid.loudness import note

FOLDER = Path("out/bench_real")
QUICK = 6  # every sixth still or stretch
ALL = ("all",)
SUPERVISOR = "supervisor"  # row of the supervised car beside those of its estimators
Rows = dict[tuple[str, str], list[Row]]


def bench_real(
    *,
    quick: bool = False,
    data: Path | None = None,
    out: Path | None = None,
    sets: tuple[str, ...] = (),
    estimators: tuple[str, ...] = (),
) -> dict[str, Any]:
    """Set -> sequence -> estimator or supervisor -> figures; "left out" in place of those of an absent set.

    Contact sheets, the reliability diagram and small pictures go to ``out``, by default a folder of the user's
    cache: they hold pictures of the sets. ``estimators`` are scored beside those of the supervised car; ALL are all
    that run here. Stored sequences are not computed again. Raises InputError.
    """
    for name in sets:
        if name not in SETS:
            raise InputError(f"no set {name!r} in bench real; there are {', '.join(SETS)}")
    supervised = supervised_estimators()
    others = _further(estimators, supervised)
    out, found, absent = _pictures_folder(out), {}, {}
    with Store(FOLDER / "real.jsonl") as store:
        for set_name in sets or SETS:
            folder = data_folder(data) / set_name
            if not folder.is_dir():
                absent[set_name] = {"left out": f"no folder {set_name} in the data folder"}
                continue
            for name in SETS[set_name]:
                every = QUICK if quick else 1
                rows = _rows(set_name, name, folder, store, out, supervised, every=every)
                for one, found_by in _answers(set_name, name, folder, store, others, every=every).items():
                    for row, answer in zip(rows, found_by, strict=True):
                        row["estimates"][one] = answer
                found[set_name, name] = rows
    _draw(found, out, supervised)
    note(f"real: contact sheets and reliability diagram in {out}")
    return _table(found, (*supervised, *others)) | absent


def _further(names: tuple[str, ...], supervised: Sequence[str]) -> list[str]:
    """``names`` without those that run anyway. Raises InputError for an unknown one."""
    known = all_estimators()
    for name in names:
        if name not in known and names != ALL:
            raise InputError(no_estimator(name, known))
    return [name for name in (estimators_here() if names == ALL else names) if name not in supervised]


def _pictures_folder(out: Path | None) -> Path:
    """``out``, or a folder of the user's cache. Raises InputError for a folder of the repository."""
    if out is None:
        kept = cache_file("bench-real", "pictures", "")
        if kept is None:
            raise InputError("no folder for caches: name one with --out")
        out = kept
    if out.resolve().is_relative_to(ROOT) and not out.resolve().is_relative_to(ROOT / "out"):
        raise InputError(f"{out}: real pictures do not belong into the repository; name a folder elsewhere")
    out.mkdir(parents=True, exist_ok=True)
    return out


def _rows(
    set_name: str, name: str, folder: Path, store: Store, out: Path, supervised: Sequence[str], *, every: int
) -> list[Row]:
    """The rows of a sequence, stored or computed now."""
    case = f"{set_name}, {name}"
    code, tiles = _code(supervised, every), _tiles(out, set_name, name)
    stored = store.get(case, code)
    if stored is None or not tiles.is_dir():
        shutil.rmtree(tiles, ignore_errors=True)
        frames = look_at_frames(SETS[set_name][name], folder, every, tiles, supervised, says=case)
        stored = {"frames": list(frames)}
        store.add(case, code, stored)
    return list(stored["frames"])


def _answers(
    set_name: str, name: str, folder: Path, store: Store, names: Sequence[str], *, every: int
) -> dict[str, list[Row]]:
    """The answers of each estimator in the frames of a sequence, stored or computed now."""
    keys = {one: (f"{set_name}, {name}, {one}", _code([one], every)) for one in names}
    missing = [one for one in names if store.get(*keys[one]) is None]
    says = f"{set_name}, {name}, {len(missing)} further estimators"
    found = list(answers(SETS[set_name][name], folder, every, missing, says=says)) if missing else []
    for one in missing:
        store.add(*keys[one], {"answers": [row[one] for row in found]})
    return {one: (store.get(*keys[one]) or {})["answers"] for one in names}


def _code(names: Sequence[str], every: int) -> str:
    """Hash of what the rows of a frame depend on."""
    code = fingerprint(*import_closure(["lab.bench.real.look"]), "config")
    return f"{' '.join(map(estimator_fingerprint, names))} {code} {every}"


def _tiles(out: Path, set_name: str, name: str) -> Path:
    return out / "frames" / f"{set_name}-{name}"


def _table(found: Rows, names: Sequence[str]) -> dict[str, Any]:
    judged = judgements()
    table: dict[str, Any] = {}
    for (set_name, name), rows in found.items():
        labels = SETS[set_name][name].labels
        others = [
            row
            for (other_set, other), there in found.items()
            if other_set == set_name and _drive_of(other) != _drive_of(name)
            for row in there
        ]
        trapezoid = fit_trapezoid(others) if labels in SURFACES else None
        own = judged.get(set_name, {})
        lane = fixed_lane((row["file"] for row in others), own)
        table.setdefault(set_name, {})[name] = {
            one: figures(rows, one, labels, trapezoid=trapezoid, judged=own, other_lane=lane) for one in names
        } | {SUPERVISOR: supervision_figures(rows)}
    return table


def _drive_of(sequence: str) -> str:
    """The first word of its name: the stills and a clip of one drive share it."""
    return sequence.partition(" ")[0]


def _draw(found: Rows, out: Path, supervised: Sequence[str]) -> None:
    """Sheets of each sequence, and the reliability diagram of all labelled frames."""
    answers: Mapping[str, list[tuple[float, bool]]] = {name: [] for name in supervised}
    for (set_name, name), rows in found.items():
        tiles, labels = _tiles(out, set_name, name), SETS[set_name][name].labels
        sheet(rows, evenly(len(rows)), tiles, out / f"{set_name}-{name}-spread.png")
        if labels not in SURFACES:
            continue
        for one in supervised:
            bad = wrong(rows, one).tolist()
            sheet(rows, worst(rows, one, bad), tiles, out / f"{set_name}-{name}-worst-{one}.png")
            looks = [row["estimates"][one] for row in rows]
            answers[one] += [
                (look["confidence"], not off)
                for look, off in zip(looks, bad, strict=True)
                if look["answered"]
            ]
    if any(answers.values()):
        reliability(answers, out / "reliability.png")
