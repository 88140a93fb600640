"""Cars, recordings and explanations from Python: ``trepid.load``, ``open_recording`` and ``explain``."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from cockpit.export.drive import Drive
from cockpit.export.table import Table, table, times
from cockpit.logbook.explain_drive import is_recording
from cockpit.logbook.recall import Recall, recall
from cockpit.logbook.story import Story, overview, story
from cockpit.rulebook.explanation import explanation
from supervisor.rules.inference import FearRules
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, car_folder, default_file, read, refuse, using_car
from trepid.config import load as load_settings


@dataclass(frozen=True)
class Car:
    """The settings of a car: those of its folder, and the defaults for all others."""

    folder: Path | None
    """None: that of the defaults."""
    vehicle: Vehicle
    """Dimensions, steering and dynamics [SI]."""
    camera: Camera
    """Lens and mounting."""
    rules: FearRules
    """Its fuzzy rules: ``rules.evaluate({...})``."""

    def settings(self, name: str) -> dict[str, Any]:
        """The fields of the file ``name`` of ``config/``, such as ``"supervisor"``, as plain values.

        Raises InputError for an unknown name.
        """
        known = {path.stem for path in CONFIG_DIR.glob("*.yaml")}
        if name not in known:
            raise InputError(f"no settings {name!r}; there are {', '.join(sorted(known))}")
        with using_car(self.folder):
            return dict(_plain(read(CONFIG_DIR / f"{name}.yaml")))


def load(folder: str | Path | None = None) -> Car:
    """The settings of the car in ``folder``, made by ``trepid init``.

    Without a folder those of the car that the environment variable TREPID_CAR names, else the defaults. Other
    functions take the same folder as ``car``. Raises InputError with file:line:column.
    """
    path = car_folder() if folder is None else Path(folder).resolve()
    with using_car(path):
        return Car(
            path,
            load_settings(CONFIG_DIR / "vehicle.yaml", Vehicle),
            load_settings(CONFIG_DIR / "camera.yaml", Camera),
            FearRules.load(default_file("fear.yaml")),
        )


def _plain(data: Any) -> Any:
    if isinstance(data, Mapping):
        return {str(key): _plain(value) for key, value in data.items()}
    return [_plain(value) for value in data] if isinstance(data, list) else data


class OpenRecording(Drive):
    """A recorded drive: its messages by topic, its images, its table and its slow-downs.

    ``newest(topic, at_s)``, ``images()``, ``frames_s`` and the messages themselves (``recorded.of(topic)``) have
    times of the recorder [s]; ``table()`` and the explanations count from the start of the drive, ``zero_s``.
    """

    def table(self, rate_hz: float | None = None) -> Table:
        """One row per camera frame, or ``rate_hz`` rows a second: name of a column -> its values, None for missing.

        The columns are those of ``trepid export drive.csv``; ``pandas.DataFrame(table)`` takes them as they are.
        """
        return table(self, times(self, rate_hz))

    def slow_downs(self) -> list[Story]:
        """Every slow-down by the supervisor, as ``trepid fear explain drive.mcap --json`` lists them."""
        return overview(self._recall)

    def explain(self, at_s: float, *, rules: str | Path | None = None) -> Story:
        """Why the vehicle drove as it did at ``at_s``; see :func:`trepid.explain`. Raises InputError."""
        return _tell(self._recall if rules is None else recall(self.path, Path(rules)), at_s)

    @cached_property
    def _recall(self) -> Recall:
        return recall(self.path)


def open_recording(path: str | Path) -> OpenRecording:
    """The recording (.mcap) at ``path``. Raises InputError when it is none, or holds neither image nor estimate."""
    return OpenRecording(Path(path))


def explain(
    source: str | Path | FearRules,
    values: Mapping[str, float | None] | None = None,
    *,
    at_s: float | None = None,
    rules: str | Path | None = None,
) -> dict[str, Any]:
    """Why fear is as it is, as ``trepid fear explain --json`` prints it.

    ``source`` is a rule file, or the ``rules`` of a car, with ``values`` of its inputs (None: a missing value;
    inputs that are not given are calm): the result has ``fear``, ``level``, ``cause``, ``rules`` with their
    strengths, ``mode``, ``speed_factor``, ``memberships`` and ``trust``. Or it is a recording, with a time
    ``at_s`` from its start [s] and, where given, other ``rules`` than the recorded ones: docs/recordings.md lists
    the fields of the result. Raises InputError.
    """
    for_drive = at_s is not None or rules is not None
    if isinstance(source, FearRules):
        refuse("at_s and rules are for recordings, and the source is a set of rules", for_drive)
        return explanation(source, values or {})
    path = Path(source)
    if is_recording(path):
        if values is not None or at_s is None:
            raise InputError(f"{path}: a recording is explained at a time: give at_s, and no values")
        return _tell(recall(path, None if rules is None else Path(rules)), at_s)
    refuse(f"{path}: at_s and rules are for recordings, and this is no MCAP file", for_drive)
    return explanation(FearRules.load(path), values or {})


def _tell(drive: Recall, at_s: float) -> Story:
    try:
        return story(drive, at_s)
    except ValueError as error:
        raise InputError(f"{drive.recorded.path}: at_s {at_s:g}: {error}") from error
