"""The ``sim road`` verbs: show, export and import roads."""

from pathlib import Path
from typing import Annotated

import typer
from ruamel.yaml import YAML

from sim_harness.report.road_facts import show_verb
from sim_harness.world.opendrive.reader import read_opendrive
from sim_harness.world.road_file import load_road
from sim_harness.world.roads.road import Road, RoadSettings
from trepid.config import InputError
from trepid.loudness import warn
from trepid.options import Car

app = typer.Typer(no_args_is_help=True, add_completion=False)
app.command("show")(show_verb)


@app.command("export")
def export_verb(
    road: Annotated[str, typer.Argument(help="A name in config/roads/, or a .yaml file.")],
    out: Annotated[Path, typer.Argument(metavar="OUT.xodr")],
    car: Car = None,
) -> None:
    """Write a road as an OpenDRIVE 1.7 file."""
    from sim_harness.world.opendrive.export import write_opendrive  # needs the extra `roads`

    write_opendrive(load_road(road).settings, out)


@app.command("import")
def import_verb(
    source: Annotated[Path, typer.Argument(metavar="FILE.xodr")],
    out: Annotated[Path, typer.Argument(metavar="OUT.yaml")],
    road: Annotated[str | None, typer.Option(help="Id of the road; default: the first one.")] = None,
    lane: Annotated[
        int | None,
        typer.Option(help="Id of the lane to keep; default: the innermost along the reference line."),
    ] = None,
) -> None:
    """Convert one lane of an OpenDRIVE road to a road file."""
    imported = read_opendrive(source, road=road, lane=lane)
    write_road(imported.settings, out)
    for note in imported.notes:
        warn(f"{source}: {note}")
    settings = imported.settings
    length_m = Road(settings).length_m
    print(
        f"{out}: {settings.name}, {length_m:.1f} m, {len(settings.segments)} segments,"
        f" {len(settings.sections)} sections, {'closed' if settings.closed else 'open'}"
    )


def write_road(settings: RoadSettings, path: Path) -> None:
    """Write ``settings`` as YAML without default values. Raises InputError."""
    data = settings.model_dump(mode="json", exclude_defaults=True)
    yaml = YAML()
    yaml.default_flow_style = None  # the innermost mappings on one line each
    try:
        with path.open("w", encoding="utf-8") as file:
            yaml.dump(data, file)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror or error}") from error
