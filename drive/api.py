"""A live drive from Python: ``trepid.drive``."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from drive.launcher import drive as drive_course
from drive.open_road import course_for
from drive.plan import has_simulator
from trepid.config import CONFIG_DIR, load, refuse, using_car
from trepid.processes.drive_settings import DriveSettings


def drive(
    scenario: str | Path | None = None,
    *,
    duration_s: float | None = None,
    seed: int = 0,
    settings: Mapping[str, object] | None = None,
    estimators: Sequence[str] = (),
    car: str | Path | None = None,
    record: str | Path | None = None,
    raw_images: bool = False,
) -> dict[str, Any]:
    """Drive live with all processes over Zenoh, as ``trepid drive --no-page`` does, until the end of the drive.

    ``scenario``: a name or file; without one that of ``drive.yaml``, and none where the car has no simulator.
    The result is the dictionary that ``trepid drive --json`` prints. Call it in the main thread: SIGINT and
    SIGTERM stop the car. Raises InputError for wrong input, and for a process that does not start.
    """
    refuse("raw_images needs record", raw_images and record is None)
    with using_car(None if car is None else Path(car)):
        given = load(CONFIG_DIR / "drive.yaml", DriveSettings)
        name = given.scenario if scenario is None and has_simulator() else scenario
        refuse("settings change a scenario: give scenario too", name is None and bool(settings))
        changes = {field: json.dumps(value) for field, value in (settings or {}).items()}  # JSON is YAML
        course = course_for(None if name is None else str(name), changes, estimators, duration_s=duration_s)
        return drive_course(
            course,
            given,
            seed=seed,
            show=lambda *_: None,
            record=None if record is None else Path(record),
            raw_images=raw_images,
        )
