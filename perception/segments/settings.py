"""``config/segments.yaml``, and where a segmentation network and its description lie."""

from pathlib import Path
from typing import Annotated

from pydantic import Field

from perception.lane.settings import ConfidenceSettings, LaneCvSettings
from perception.lane.street.settings import SearchedWeights, StreetWeights
from perception.net.published_files import data_file
from perception.segments.network import SegmentNetwork
from trepid.config import CONFIG_DIR, InputError, Settings, default_file, default_names, load, resource
from trepid.spelling import did_you_mean_or_list
from trepid.types import NonNegative, Share

FOLDER = "networks"  # of descriptions in config/ or the folder of a car, and of fetched files


class SegmentSettings(Settings):
    """``config/segments.yaml``."""

    network: Annotated[str, Field(pattern=r"^[A-Za-z0-9][\w.-]*$")]
    file: str | None = None
    confidence: ConfidenceSettings
    line_within: NonNegative
    bounded: Share
    searched: SearchedWeights
    pair: StreetWeights


def segment_settings() -> SegmentSettings:
    """``config/segments.yaml``. Raises InputError."""
    return load(CONFIG_DIR / "segments.yaml", SegmentSettings)


def lane_settings(lane_cv: LaneCvSettings, own: SegmentSettings) -> LaneCvSettings:
    """``lane_cv`` of the finder without a camera file, with what ``own`` states for pictures of masks."""
    pairs = lane_cv.street.pairs.model_copy(update={"line_within": own.line_within})
    stated = {"pairs": pairs, "bounded": own.bounded, "searched": own.searched, "pair": own.pair}
    return lane_cv.model_copy(update={"street": lane_cv.street.model_copy(update=stated), "drawn_step_px": 1})


def network_description(name: str) -> SegmentNetwork:
    """The description of the network ``name``. Raises InputError, with the nearest name for an unknown one."""
    known = default_names(FOLDER)
    if name not in known:
        raise InputError(f"no network {name!r}; {did_you_mean_or_list(name, known, 'trepid networks list')}")
    return load(default_file(f"{FOLDER}/{name}.yaml"), SegmentNetwork)


def fetched_file(name: str) -> Path:
    """Where the fetched network ``name`` is kept."""
    return data_file(FOLDER, f"{name}.onnx")


def network_file(settings: SegmentSettings) -> Path:
    """The file of the network that ``settings`` choose. Raises InputError where there is none."""
    if settings.file is not None:
        return resource(Path(settings.file))
    path = fetched_file(settings.network)
    if not path.is_file():
        raise InputError(
            f"network {settings.network}: not on this machine; `trepid networks fetch {settings.network}` gets it"
        )
    return path
