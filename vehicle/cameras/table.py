"""The table of camera sources, and the source that ``config/camera_source.yaml`` names."""

from collections.abc import Callable, Mapping
from functools import partial
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any

from trepid import plugins
from trepid.config import CONFIG_DIR, InputError, Settings, parse, place, read
from trepid.spelling import did_you_mean
from vehicle.cameras.source import CameraKind, CameraSource, SourceContext
from vehicle.cameras.working import WorkingSettings

FILE = CONFIG_DIR / "camera_source.yaml"
OWN: Mapping[str, str] = MappingProxyType(
    {
        "v4l2": "vehicle.cameras.opencv:V4l2Camera",
        "picamera": "vehicle.cameras.picamera:PicameraCamera",
        "gstreamer": "vehicle.cameras.opencv:GstreamerCamera",
        "video": "vehicle.cameras.files:VideoFile",
        "folder": "vehicle.cameras.files:ImageFolder",
        "mcap": "vehicle.cameras.files:McapFile",
        "ros2": "vehicle.cameras.ros_topic:RosTopic",
    }
)
"""Name -> module and class; imported when chosen."""
LEADING = ("device", "path", "pipeline", "connect", "key")
"""Fields that lead to a source; a fault at its opening is reported at the first that its block has."""
_LOADERS: Mapping[str, Callable[[], Any]] = {name: partial(resolve_name, at) for name, at in OWN.items()}


def names() -> list[str]:
    """Names of all sources: those of Trepid, then those of other packages."""
    return plugins.names(plugins.Group.CAMERAS, _LOADERS)


def kind(name: str) -> CameraKind:
    """The class of sources called ``name``. Raises InputError for an unknown name."""
    found = plugins.part(plugins.Group.CAMERAS, name, _LOADERS)
    return found() if name in OWN else found  # type: ignore[return-value]


def configured_source() -> tuple[str, Settings, WorkingSettings]:
    """Name and settings of the source in ``config/camera_source.yaml``, and the settings of every source.

    Raises InputError with the place of the fault.
    """
    data = read(FILE)
    common = parse(_part(data, keep=WorkingSettings.model_fields), WorkingSettings, source=FILE)
    known = names()
    for key in data:
        if key not in WorkingSettings.model_fields and key not in known:
            hint = did_you_mean(str(key), [*WorkingSettings.model_fields, *known])
            raise InputError(f"{place(data, [key], FILE)}: unknown field {str(key)!r}; {hint}")
    if common.source not in known:
        where, hint = place(data, ["source"], FILE), did_you_mean(common.source, known)
        raise InputError(f"{where}: source: unknown camera source {common.source!r}; {hint}")
    if not isinstance(data.get(common.source), dict):
        where = place(data, [common.source], FILE)
        raise InputError(f"{where}: {common.source}: expected a block with the settings of this source")
    return common.source, parse(data[common.source], kind(common.source).Settings, source=FILE), common


def _part(data: Any, *, keep: Mapping[str, Any]) -> Any:
    """``data`` without the other fields; the remaining ones keep their places in the file."""
    part = data.copy()
    part.lc.data, vars(part)["sources"] = data.lc.data, vars(data).get("sources", {})
    for key in data.keys() - keep.keys():
        del part[key]
    return part


def build(drive: SourceContext) -> tuple[str, CameraSource, WorkingSettings]:
    """Name of the configured source, the open source, and the settings of every source. Raises InputError."""
    name, settings, common = configured_source()
    try:
        with plugins.beginning(plugins.Group.CAMERAS, name):
            return name, kind(name)(settings, drive), common
    except InputError as error:
        data = read(FILE)
        field = next((field for field in LEADING if field in data[name]), "")
        raise InputError(f"{place(data, [name, field], FILE)}: {name}: {error}") from error
