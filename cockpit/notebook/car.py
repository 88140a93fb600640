"""The settings of a car from Python: ``trepid.load``."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from supervisor.rules.inference import FearRules
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, car_folder, default_file, read, using_car
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
