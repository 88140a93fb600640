"""``trepid dataset``: recorded drives to data sets."""

import json
import math
from collections import Counter
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from trepid.config import InputError, parse_overrides
from trepid.options import Car, typed_command

app = typer.Typer(no_args_is_help=True)


class Form(StrEnum):
    """The layouts of ``trepid dataset export``."""

    TUB = "tub"
    LEROBOT = "lerobot"


AsJson = Annotated[bool, typer.Option("--json", help="Print JSON only.")]


@app.callback()
def dataset() -> None:
    """Data sets of recorded drives: build, look at, convert."""


@app.command()
def build(
    out: Annotated[Path, typer.Argument(metavar="OUT", help="Folder of the data set.")],
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="SOURCE…",
            help="Recordings (.mcap), donkeycar tubs, comma2k19 segments, Udacity logs, tables (.csv).",
        ),
    ],
    lock_deg: Annotated[
        float | None,
        typer.Option(
            min=1.0, max=60.0, help="Road-wheel angle of full steering [deg]; default: that of --car."
        ),
    ] = None,
    positive: Annotated[
        str | None,
        typer.Option(
            "--sign",
            metavar="left|right",
            help="Side of positive steering; default: logged_positive of --car, or by the format.",
        ),
    ] = None,
    wheelbase_m: Annotated[
        float | None,
        typer.Option(min=0.05, max=10.0, help="Distance of the axles [m]; default: that of --car."),
    ] = None,
    steering_ratio: Annotated[
        float | None,
        typer.Option(min=1.0, max=40.0, help="Steering-wheel angle / road-wheel angle; default: of --car."),
    ] = None,
    split: Annotated[
        str, typer.Option(metavar="time|route", help="Divide each route in time, or by routes.")
    ] = "time",
    shares: Annotated[
        str, typer.Option(metavar="A,B,C", help="Shares of train, validation and test.")
    ] = "0.65,0.15,0.2",
    gap_s: Annotated[
        float, typer.Option(min=0.0, max=600.0, help="Time left out at a border between two splits [s].")
    ] = 2.0,
    test_route: Annotated[
        list[str] | None,
        typer.Option(help="Route for the test of --split route, may be repeated; default: chosen at random."),
    ] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of this choice.")] = 0,
    leave_out: Annotated[
        list[str] | None,
        typer.Option(
            metavar="RULE",
            help="Leave out frames that are frozen, dark, bright, standing or suspicious (the label contradicts the"
            " motion of the car); may be repeated.",
        ),
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME=COLUMN", help="Column of a table that holds NAME, such as t_s."),
    ] = None,
    fps: Annotated[
        float | None, typer.Option(min=0.1, max=1000.0, help="Rate of a table without times [1/s].")
    ] = None,
    video: Annotated[
        Path | None, typer.Option(help="Video whose frames the rows of a table describe.")
    ] = None,
    side_camera_m: Annotated[
        float | None,
        typer.Option(
            min=0.01,
            max=5.0,
            help="Train on the left and right cameras of a table too, this far from the middle one [m]; their angle"
            " leads back to the recorded path.",
        ),
    ] = None,
    strict: Annotated[
        bool,
        typer.Option(
            "--strict",
            help="End with exit code 2 at a row or image that cannot be used; without it they are named and left"
            " out, with exit code 1 at the end.",
        ),
    ] = False,
    car: Car = None,
    as_json: AsJson = False,
) -> int:
    """Build a data set from recorded drives: frames, road-wheel angles, splits. The images stay where they are."""
    from learning.dataset import build as building
    from learning.dataset.cleaning import RULES
    from learning.dataset.dataset import Dataset, Split, need_arrow
    from learning.dataset.sources.log import Faults
    from learning.dataset.sources.table import TableOptions
    from learning.dataset.wheel import WheelOptions
    from sim_harness.sweep.progress import SweepProgress

    need_arrow()
    options = building.BuildOptions(
        wheel=WheelOptions(lock_deg, _side(positive), wheelbase_m, steering_ratio),
        split=Split(
            by=_choice("--split", split, ("time", "route")),  # type: ignore[arg-type]
            seed=seed,
            gap_s=gap_s,
            shares=_shares(shares),  # type: ignore[arg-type]
            test_routes=tuple(test_route or ()),
        ),
        table=TableOptions(parse_columns(column or []), fps, video, side_camera_m),
        leave_out=tuple(_choice("--leave-out", rule, tuple(RULES)) for rule in leave_out or ()),
        command=typed_command(),
    )
    faults = Faults(strict=strict)
    logs = building.read_logs(sources, faults, options.table)
    total = sum(len(log) for log in logs)
    with SweepProgress(total, float(total), noun="frames") as progress:
        building.build(out, logs, options, faults, lambda _: progress.step(1.0))
    faults.close()
    _print_summary(Dataset.open(out), faults.rows, as_json=as_json)
    return 1 if faults.count else 0


@app.command()
def show(
    folder: Annotated[Path, typer.Argument(metavar="D", help="Folder of a data set.")],
    picture: Annotated[
        Path | None,
        typer.Option(help="Draw images by angle, distribution and course of the labels into this file."),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Card of a data set: drives, labels, light, likeness, delay, suspicious labels, and what to do about them."""
    from learning.dataset.card import as_text, card_of
    from learning.dataset.dataset import Dataset

    opened = Dataset.open(folder)
    card = card_of(opened)
    if picture is not None:
        from learning.dataset.sheet import draw

        draw(opened, picture)
    print(json.dumps(card, allow_nan=False) if as_json else "\n".join(as_text(card)))


@app.command()
def export(
    folder: Annotated[Path, typer.Argument(metavar="D", help="Folder of a data set.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="New folder. It is never overwritten.")],
    to: Annotated[Form, typer.Option("--as", help="Layout of the folder.")],
    split: Annotated[
        str | None, typer.Option(help="Only train, validation or test; default: one after the other.")
    ] = None,
    car: Car = None,
    as_json: AsJson = False,
) -> None:
    """Write the frames and angles of a data set as a tub of donkeycar (version 2) or a LeRobot data set (v3)."""
    from cockpit.export.place import new_place
    from learning.dataset.dataset import SPLITS, Dataset
    from learning.dataset.export import write_as
    from sim_harness.sweep.progress import SweepProgress

    opened = Dataset.open(folder)
    splits = SPLITS if split is None else (_choice("--split", split, SPLITS),)
    total = sum(len(opened.rows(name)) for name in splits)
    with new_place(out) as work, SweepProgress(total, float(total), noun="frames") as progress:
        frames = write_as(str(to), opened, splits, work, lambda: progress.step(1.0))
    summary = {"folder": str(out), "format": str(to), "frames": frames}
    print(json.dumps(summary) if as_json else f"{out}: {frames} frames as {to}")


def parse_columns(texts: list[str]) -> dict[str, str]:
    """The NAME=COLUMN texts of ``--column``. Raises InputError."""
    try:
        return parse_overrides(texts)
    except InputError as error:
        raise InputError(
            str(error).replace("--set", "--column").replace("KEY=VALUE", "NAME=COLUMN")
        ) from error


def _choice(option: str, text: str, known: tuple[str, ...]) -> str:
    if text not in known:
        raise InputError(f"{option} {text}: expected {' or '.join(known)}")
    return text


def _side(text: str | None) -> bool | None:
    return None if text is None else _choice("--sign", text, ("left", "right")) == "left"


def _shares(text: str) -> dict[str, float]:
    from learning.dataset.dataset import SPLITS

    try:
        shares = [float(part) for part in text.split(",")]
    except ValueError:
        shares = []
    if len(shares) != len(SPLITS) or not all(0.0 <= share <= 1.0 for share in shares):
        raise InputError(f"--shares {text}: expected three shares such as 0.65,0.15,0.2")
    if abs(sum(shares) - 1.0) > 1e-6:
        raise InputError(f"--shares {text}: expected the sum 1, got {sum(shares):g}")
    return dict(zip(SPLITS, shares, strict=True))


def _print_summary(made, left_out: int, *, as_json: bool) -> None:  # type: ignore[no-untyped-def]
    from learning.dataset.card import count_phrase
    from learning.dataset.dataset import middle_rows

    rows = made.rows()
    routes = len(set(middle_rows(rows)["route"].tolist()))
    splits, wheel = Counter(rows["split"].tolist()), made.wheel
    if as_json:
        summary = dict(
            frames=len(rows),
            splits=splits,
            routes=routes,
            left_out=left_out,
            wheel=wheel.model_dump(mode="json"),
            data_sha256=made.sha256,
        )
        print(json.dumps(summary))
        return
    print(f"{made.folder}: {len(rows)} frames of {count_phrase(routes, 'route')}")
    print("  " + ", ".join(f"{name} {splits[name]}" for name in ("train", "validation", "test", "none")))
    for why, count in Counter(rows["why"].tolist()).most_common():
        if why:
            print(f"  left out: {count} {why}")
    lock = "" if wheel.lock_rad is None else f"{math.degrees(wheel.lock_rad):.1f}° at full lock, "
    print(
        f"  steering: {lock}{wheel.how}; positive to the {'left' if wheel.sign > 0 else 'right'} in the log"
    )
    for number, source in enumerate(made.file.sources):
        for note in source.notes:
            print(f"  source {number}: {note}")
