"""The settings of a live drive: ``config/drive.yaml``."""

from pathlib import Path
from typing import Annotated, ClassVar

from pydantic import Field

from trepid.config import Settings
from trepid.types import NonNegative, Positive

VehicleName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_][\w.-]*$")]
"""One part of a key of Zenoh: the access rules (:mod:`trepid.security`) are for ``trepid/*/…``."""


class RingSettings(Settings):
    """The last minutes of every drive (:mod:`trepid.recording.ring`)."""

    max_mb: NonNegative  # of the parts of all drives; 0: no ring
    part_s: Positive  # length of one part
    after_s: NonNegative  # what is kept by an event lasts so long beyond it
    max_kept_mb: NonNegative  # beyond it, events keep nothing more


class DriveSettings(Settings):
    """``drive.yaml``."""

    moved_fields: ClassVar = {"standstill_mps": "standstill_mps of vehicle.yaml"}

    vehicle_name: VehicleName
    scenario: str
    ready_timeout_s: Positive
    silence_s: Positive
    stop_timeout_s: Positive
    status_period_s: Positive
    ring: RingSettings
    record_folder: Path
    page_host: str
    page_port: Annotated[int, Field(ge=0, le=65535)]
    foxglove_port: Annotated[int, Field(ge=0, le=65535)]
