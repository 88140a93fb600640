"""The table of actuators, and the actuator that ``config/actuator.yaml`` names."""

from collections.abc import Mapping
from pkgutil import resolve_name
from types import MappingProxyType
from typing import Any, cast

from pydantic import ConfigDict, create_model
from ruamel.yaml.comments import CommentedMap

from trepid import plugins
from trepid.config import CONFIG_DIR, InputError, Settings, parse, place, read
from trepid.packages import simulated_car
from trepid.spelling import did_you_mean
from vehicle.actuators.actuator import Actuator, ActuatorKind, Car

OWN: Mapping[str, str] = MappingProxyType(
    {
        "ackermann": "vehicle.actuators.ackermann:AckermannActuator",
        "can": "vehicle.actuators.can.actuator:CanActuator",
        "motor_hat": "vehicle.actuators.rc.motors:MotorActuator",
        "pca9685": "vehicle.actuators.rc.actuator:PcaActuator",
        "serial": "vehicle.actuators.rc.actuator:SerialActuator",
    }
)
"""Name -> module and class; imported when chosen, because the libraries of a wire are extras."""
SIMULATED = "sim"
FILE = CONFIG_DIR / "actuator.yaml"


def names() -> list[str]:
    """Names of all actuators: those of Trepid, then those of other packages."""
    return plugins.names(plugins.Group.ACTUATORS, {SIMULATED: None, **OWN})


def kind(name: str) -> ActuatorKind:
    """The class of actuators called ``name``. Raises InputError for an unknown name or a missing library."""
    if name not in OWN:
        return cast(ActuatorKind, plugins.part(plugins.Group.ACTUATORS, name, {}))
    try:
        return cast(ActuatorKind, resolve_name(OWN[name]))
    except ImportError as error:
        missing = error.name or str(error)
        raise InputError(
            f"actuator {name!r} needs the package {missing}: pip install 'trepid[{name}]'"
        ) from error


def configured_actuator() -> tuple[str, Settings | None]:
    """Name and settings of the actuator in ``config/actuator.yaml``; no settings for the simulated car.

    Raises InputError with the place of the fault.
    """
    data = read(FILE)
    known = names()
    for key in data:
        if key != "actuator" and key not in known:
            hint = did_you_mean(str(key), ["actuator", *known])
            raise InputError(f"{place(data, [key], FILE)}: unknown actuator {str(key)!r}; {hint}")
    name = str(data.get("actuator"))
    if name not in known:
        where = place(data, ["actuator"], FILE)
        raise InputError(f"{where}: actuator: unknown actuator {name!r}; {did_you_mean(name, known)}")
    if name == SIMULATED:
        return name, None
    if name not in data:
        raise InputError(f"{place(data, ['actuator'], FILE)}: actuator: {name!r} has no block of settings")
    return name, settings_in(data, name)


def settings_in(data: CommentedMap, name: str) -> Settings:
    """The block ``name`` of ``data``, the mapping of ``FILE``, as settings. Raises InputError."""
    block: dict[str, Any] = {name: (kind(name).Settings, ...)}
    model = create_model("ActuatorFile", __config__=ConfigDict(extra="ignore"), **block)
    found: Settings = getattr(parse(data, model, source=FILE), name)
    return found


def build(car: Car) -> tuple[str, Actuator]:
    """Name of the configured actuator, and the actuator with its wire open. Raises InputError."""
    name, settings = configured_actuator()
    if settings is None:
        where = place(read(FILE), ["actuator"], FILE)
        raise InputError(
            f"{where}: actuator: {SIMULATED!r} is the car of the process {simulated_car()}: run that module in "
            f"processes.yaml, or choose one of {', '.join(names()[1:])}"
        )
    try:
        with plugins.beginning(plugins.Group.ACTUATORS, name):
            return name, kind(name)(settings, car)
    except InputError as error:
        if str(error).startswith(f"{name}: "):  # of the device or bus; others name their own place
            raise InputError(f"{place(read(FILE), ['actuator'], FILE)}: {error}") from error
        raise
