"""Loads roads from YAML files, in ``config/roads/`` or elsewhere, and from OpenDRIVE files."""

from pathlib import Path

from sim_harness.world.roads.road import Road, RoadSettings
from trepid.config import InputError, default_file, load

ROAD_SUFFIXES = (".yaml", ".xodr")


def load_road(source: str | Path) -> Road:
    """The road in the .yaml or .xodr file ``source``, or ``roads/<source>.yaml`` (car, config/) for a bare name.

    Raises InputError when the file does not describe a road, or when a closed road does not close.
    """
    path = Path(source)
    if isinstance(source, str) and not source.endswith(ROAD_SUFFIXES):
        path = default_file(f"roads/{source}.yaml")
    try:
        return Road(load_road_settings(path))
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def load_road_settings(path: Path) -> RoadSettings:
    """The road in a .yaml file, or the first driving lane of an OpenDRIVE file (.xodr). Raises InputError."""
    if path.suffix != ".xodr":
        return load(path, RoadSettings)
    from sim_harness.world.opendrive.reader import read_opendrive  # lxml and scipy, for OpenDRIVE files only

    return read_opendrive(path).settings
