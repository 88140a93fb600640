"""Checks of the software and the settings of a car: packages, files, models, endpoint; and what a check finds."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from trepid.car.vehicle import ALONG_THE_MIDDLE, Corridor, Vehicle
from trepid.config import CONFIG_DIR, InputError, car_folder, load, read
from trepid.packages import PACKAGES, check_packages
from trepid.plugins import Group, added_entry_points, package_of


@dataclass(frozen=True, slots=True)
class Finding:
    """The result of one check, and the remedy of a fault."""

    check: str
    ok: bool
    message: str
    remedy: str = ""  # of a failed check, or advice


def packages() -> Finding:
    """The packages of Trepid are those of this installation: their names also exist on PyPI."""
    try:
        check_packages(wholly=True)
    except InputError as error:
        return Finding(
            "packages", False, str(error), "uninstall the other package, or use a fresh environment"
        )
    return Finding("packages", True, f"{len(PACKAGES)} packages of this installation")


def configuration() -> Finding:
    """Every file of settings and rules, with the fields of the car, fits its class."""
    faults = dict.fromkeys(fault for check in SETTINGS if (fault := _fault(check)))
    if faults:
        return Finding("configuration", False, "; ".join(faults), "correct the fields at these places")
    return Finding("configuration", True, f"{car_folder() or 'the defaults'}: valid{_corridor()}")


def _corridor() -> str:
    """What a car drives in the middle of, where it is not its lane."""
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    if vehicle.corridor is Corridor.LANE:
        return ""
    where = f"{ALONG_THE_MIDDLE} of {vehicle.road_width_m:g} m"
    return f"; it drives {where}: on closed paths without other traffic only"


def _fault(check: Callable[[], object]) -> str:
    try:
        check()
    except InputError as error:
        return str(error)
    return ""


def _vehicle() -> None:
    load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def _camera() -> None:
    from trepid.car.camera import Camera

    load(CONFIG_DIR / "camera.yaml", Camera)


def _limiter() -> None:
    import controller.limiter

    controller.limiter.build()


def _controller() -> None:
    import controller.controller

    controller.controller.build()


def _supervisor() -> None:
    import supervisor.supervisor

    supervisor.supervisor.build()


def _estimators() -> None:
    from perception.estimators import estimators, lane_cv_settings

    lane_cv_settings()
    estimators()


def _security() -> None:
    from trepid.security import load_security

    load_security()


def _drive() -> None:
    from trepid.processes.drive_settings import DriveSettings

    load(CONFIG_DIR / "drive.yaml", DriveSettings)


def _driver() -> None:
    from vehicle.driver.settings import load_driver

    load_driver()


def _lead() -> None:
    from perception.lead.finder import lead_settings

    lead_settings()


def _ros() -> None:
    from vehicle.ros.bridge import load_settings

    load_settings()


def _files() -> None:
    """All other files of the car are at least YAML."""
    car = car_folder()
    for path in sorted(car.glob("*.yaml")) if car is not None else ():
        read(CONFIG_DIR / path.name if (CONFIG_DIR / path.name).is_file() else path)


SETTINGS: tuple[Callable[[], None], ...] = (
    _vehicle,
    _camera,
    _limiter,
    _controller,
    _supervisor,
    _estimators,
    _security,
    _drive,
    _driver,
    _lead,
    _ros,
    _files,
)


def models() -> Finding:
    """The networks of the drive exist, agree with their records (SHA-256) and start."""
    try:
        loaded = list(_loaded_models())
    except InputError as error:
        return Finding("models", False, str(error), _model_remedy(str(error)))
    return Finding("models", True, "; ".join(loaded))


def _model_remedy(fault: str) -> str:
    """The remedy: the package, where the fault names an estimator that another one adds."""
    for name in added_entry_points(Group.ESTIMATORS):
        if fault.startswith(f"{Group.ESTIMATORS} {name!r}"):
            package = package_of(Group.ESTIMATORS, name)
            return f"mend or reinstall the package {package}, which adds {name}, or leave its process out"
    return "name other files, install Trepid again, or train: `trepid train`"


def _loaded_models() -> Iterator[str]:
    import perception.estimators
    import perception.lead.finder
    from trepid.processes.settings import load_processes

    specs = load_processes()
    given = {
        spec.options["estimator"]: spec.options.get("network")
        for spec in specs
        if spec.module == "perception.node" and "estimator" in spec.options
    }
    unused = perception.estimators.misfits()
    for name, why in unused.items():
        yield f"the estimator {name} does not run: {why}"
    if any(spec.simulates for spec in specs):  # the scenario names the estimators that run
        given = {name: network for name, network in given.items() if name not in unused}
    if "cnn" not in unused:
        given = {"cnn": None} | given
    for name, network in given.items():
        perception.estimators.build(name, network=network)
        yield f"{name} starts" + (f" ({network})" if network else "")
    if any(spec.module == perception.lead.finder.NODE for spec in specs):
        yield f"lead starts ({perception.lead.finder.build().detector_text})"
    else:
        yield "no process detects vehicles ahead"


def people() -> Finding:
    """Whether the car sees people, cyclists and animals. A car that does not may drive where there are none."""
    from perception.lead.finder import blindness
    from trepid.processes.settings import load_processes

    try:
        blind, _, remedy = blindness(load_processes()).partition(": ")
    except InputError as error:
        return Finding("people", False, str(error), "correct `detector` in lead.yaml, or get its file")
    return Finding("people", True, blind or "people, cyclists and animals are detected", remedy)


def endpoint() -> Finding:
    """The port on which the processes of a drive meet is free; keys of all processes are there and private."""
    from trepid.processes.endpoint import usable_endpoint
    from trepid.processes.settings import FILE, ProcessesFile
    from trepid.security import LAUNCHER, session_settings
    from vehicle.keys_check import check_keys

    try:
        found = usable_endpoint()
        session_settings(LAUNCHER, listen=found)
        check_keys(load(FILE, ProcessesFile).processes)
    except InputError as error:
        remedy = (
            "correct the machine or security.yaml, make keys (`trepid keys create`), or end the other drive"
        )
        return Finding("endpoint", False, str(error), remedy)
    return Finding("endpoint", True, f"{found} is free")
