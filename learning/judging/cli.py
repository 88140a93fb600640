"""``trepid evaluate``: models of steering on the frames of a data set."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trepid.config import InputError, load
from trepid.options import Car

if TYPE_CHECKING:
    from learning.judging.evaluate import Bench
    from learning.judging.predictions import JudgedModel, Predictions

COLUMNS = ("model", "frames", "MAE °", "95 %", "RMSE °", "mean °", "R²", "slope", "cover 90", "ms", "weights")


def evaluate(
    models: Annotated[
        list[str], typer.Argument(metavar="F…", help="Driving networks (.onnx), or names such as cv and cnn.")
    ],
    data: Annotated[Path, typer.Option("--data", metavar="D", help="Data set: `trepid dataset build`.")],
    split: Annotated[str, typer.Option(help="train, validation or test.")] = "test",
    ratio: Annotated[
        float | None,
        typer.Option(
            min=1.0, max=40.0, help="Degrees of a steering wheel with this ratio; default: of the road wheel."
        ),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(help="Camera of the data set, for cv and cnn; default: self-calibrated for each route."),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            metavar="F.png",
            help="Draw record and prediction of one model over time, their scatter, and its worst frames.",
        ),
    ] = None,
    car: Car = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object for each model.")] = False,
) -> int:
    """Judge driving networks on recorded angles, beside predictions without an image, on one core."""
    import cv2

    from cockpit.footage.frames import print_json, print_table
    from learning.dataset.dataset import SPLITS, Dataset
    from learning.judging.evaluate import Bench
    from learning.judging.predictions import JudgedModel
    from sim_harness.sweep.progress import SweepProgress
    from trepid.car.camera import Camera
    from trepid.images.files import IMAGE_SUFFIXES

    if picture is not None and len(models) > 1:
        raise InputError(f"{picture}: shows one model, not {len(models)}")
    if split not in SPLITS:
        raise InputError(f"--split {split}: expected {', '.join(SPLITS)}")
    if picture is not None and picture.suffix.lower() not in IMAGE_SUFFIXES:
        raise InputError(f"--picture {picture}: expected the name of an image, such as worst.png")
    if picture is not None and not picture.parent.is_dir():
        raise InputError(f"{picture}: there is no folder {picture.parent}")
    cv2.setNumThreads(1)
    bench = Bench(Dataset.open(data), split, ratio=ratio)
    known = load(camera, Camera) if camera else None
    judged = [JudgedModel(text, known) for text in dict.fromkeys(models)]
    rows: list[dict[str, Any]] = []
    frames = len(bench.rows) * len(judged)
    with SweepProgress(frames, float(frames), noun="frames") as progress:
        for model in judged:
            found = model.predict(bench.dataset, bench.rows, lambda: progress.step(1.0))
            rows.append(bench.row(model, found))
            if picture is not None:
                draw(picture, bench, model, found)
    if as_json:
        print_json(rows)
    else:
        print_table(COLUMNS, {"model", "weights"}, [*map(cells, rows), *baseline_cells(bench.baselines)])
        for row in rows:
            for line in closing_lines(row):
                typer.echo(line)
    return 0


def draw(picture: Path, bench: "Bench", model: "JudgedModel", found: "Predictions") -> None:
    """Write both angles over time, their scatter, and the worst frames of ``model`` below.

    Raises InputError without any frame that it answers, and when the picture cannot be written.
    """
    import numpy as np

    from learning.judging.course import as_image, course_figure
    from learning.judging.sheet import COLUMNS_OF_SHEET, TILE_PX, frames_sheet
    from trepid.images.files import write_image

    worst = bench.worst(found)
    if not worst:
        raise InputError(f"{picture}: {model.name} gives no angle for any frame")
    predicted_deg = found.angle_rad * bench.unit_deg
    figure = course_figure(
        bench.rows,
        bench.true_deg,
        predicted_deg,
        found.interval_rad * bench.unit_deg,
        worst=worst,
        wheel=bench.wheel,
    )
    sheet = frames_sheet(
        bench.dataset,
        bench.rows[worst],
        bench.true_deg[worst],
        predicted_deg[worst],
        found.angle_rad[worst],
        model.network,
    )
    write_image(picture, np.vstack([as_image(figure, COLUMNS_OF_SHEET * TILE_PX[0]), sheet]))


def closing_lines(row: dict[str, Any]) -> list[str]:
    """What the comparison with the baselines says about a model: its findings, its speeds, then the conclusion."""
    lines = [f"{row['model']}: finding: {one['sentence']}" for one in row["findings"]]
    if speed := row["speed"]:
        beside = speed.get("mean_speed_rmse_mps")
        mean = "" if beside is None else f"; of the mean speed of the training {beside:.2f} m/s"
        error = f"rms error of the speed {speed['rmse_mps']:.2f} m/s on {speed['frames']} frames{mean}"
        lines.append(f"{row['model']}: {error}")
    return [*lines, f"{row['model']}: {row['conclusion']}"]


def cells(row: dict[str, Any]) -> list[str]:
    """The row of a model as cells of the table."""
    interval = row["intervals_95"].get("mae_deg")
    return [
        row["model"],
        str(row["frames"]),
        number(row["mae_deg"]),
        "-" if interval is None else f"{interval[0]:.2f} to {interval[1]:.2f}",
        number(row["rmse_deg"]),
        number(row["mean_error_deg"], "{:+z.2f}"),
        number(row["r2"]),
        number(row["slope"]),
        number(row.get("uncertainty", {}).get("coverage_90"), "{:.0%}"),
        number(row["latency_ms"]),
        str(row.get("parameters", "-")),
    ]


def baseline_cells(baselines: dict[str, Any]) -> list[list[str]]:
    """The baselines as rows of the table."""
    return [
        [name, str(one["frames"]), number(one["mae_deg"]), *["-"] * (len(COLUMNS) - 3)]
        for name, one in baselines.items()
    ]


def number(value: float | None, form: str = "{:.2f}") -> str:
    """``value`` as text, "-" without one."""
    return "-" if value is None else form.format(value)
