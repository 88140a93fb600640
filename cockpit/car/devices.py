"""Checks of the processes of a car, of its camera and of its actuator: opened, read for a moment, closed."""

import time
from typing import TYPE_CHECKING

from cockpit.car.checks import Finding
from trepid import plugins
from trepid.car.vehicle import Vehicle
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.config import CONFIG_DIR, InputError, load, read
from trepid.processes.fused import gather_specs
from trepid.processes.settings import check_vehicle, estimators_in, load_processes

if TYPE_CHECKING:
    from vehicle.actuators.actuator import Actuator

CAMERA_NODE, ACTUATOR_NODE = "vehicle.cameras.node", "vehicle.actuators.node"
LISTEN_S = 2.0  # to the camera
REPORT_S = 1.0  # until a car has reported its state
LEAST_HZ = 10.0  # below it the images are too old for driving
SHARE = 0.8  # of the configured rate
CAMERA_PART = plugins.Group.CAMERAS, "camera_source.yaml", "source"
ACTUATOR_PART = plugins.Group.ACTUATORS, "actuator.yaml", "actuator"
"""The group of a part, and the file and field that name it."""
ON_THE_BUS = frozenset({"ackermann"})  # actuators that need the bus of a drive


def _package_remedy(group: plugins.Group, file: str, field: str) -> str:
    """The remedy where another package adds the part that ``field`` of ``file`` names; "" for a part of Trepid."""
    try:
        name = str(read(CONFIG_DIR / file).get(field))
    except InputError:
        return ""  # the fault is in the file
    package = plugins.package_of(group, name)
    if not package:
        return ""
    return f"the package {package} adds {name}: its documentation says what it needs; or another {field} in {file}"


def processes() -> Finding:
    """The programs of all processes exist on this machine, and together they make a drive."""
    from perception.lead.finder import check_lead

    try:
        specs = load_processes()
        check_vehicle(specs)
        if not any(spec.simulates for spec in specs):  # else the scenario names them
            estimators_in(specs)
        check_lead(specs)
        gather_specs(specs)
    except InputError as error:
        return Finding("processes", False, str(error), "correct the entry in processes.yaml")
    return Finding("processes", True, ", ".join(spec.name for spec in specs))


def camera() -> Finding:
    """The camera opens and delivers frames at its rate."""
    process = _process_with(CAMERA_NODE)
    if process is None:
        return Finding("camera", True, "simulated: no process runs vehicle.cameras.node")
    from vehicle.cameras.ros_topic import RosTopicSettings
    from vehicle.cameras.source import SourceContext
    from vehicle.cameras.table import build, configured_source

    try:
        name, settings, _ = configured_source()
        if isinstance(settings, RosTopicSettings) and settings.connect is None:
            return Finding("camera", True, f"{name}: {settings.key} is on the bus of a drive")
        name, source, common = build(SourceContext(bus=None, now_s=epoch_clock(epoch_offset_ns())))
    except InputError as error:
        remedy = "correct camera_source.yaml; `v4l2-ctl --list-devices` lists cameras"
        return Finding("camera", False, str(error), _package_remedy(*CAMERA_PART) or remedy)
    try:
        began_s, stamps = time.monotonic(), list[float]()
        while time.monotonic() - began_s < LISTEN_S and not source.ended:
            frame = source.read(timeout_s=LISTEN_S / 4)
            if frame is not None:
                stamps.append(frame.t_s)
        trouble = source.trouble
    finally:
        source.close()
    return judged_camera(name, stamps, common.rate_hz, trouble)


def judged_camera(name: str, stamps: list[float], rate_hz: float | None, trouble: str) -> Finding:
    """``stamps``: times of capture [s]; ``rate_hz``: the configured rate; ``trouble``: the reported fault."""
    if len(stamps) < 2:
        reason = f": {trouble}" if trouble else ""
        remedy = "check cable and power; end other programs that use the camera"
        remedy = _package_remedy(*CAMERA_PART) or remedy
        return Finding("camera", False, f"{name}: {len(stamps)} frames within {LISTEN_S:g} s{reason}", remedy)
    measured_hz = (len(stamps) - 1) / (stamps[-1] - stamps[0]) if stamps[-1] > stamps[0] else 0.0
    message = f"{name}: {measured_hz:.1f} frames/s"
    wanted_hz = max(LEAST_HZ, SHARE * (rate_hz or 0.0))
    if measured_hz < wanted_hz:
        remedy = "more light or a shorter exposure; a smaller size or fourcc: MJPG"
        remedy = _package_remedy(*CAMERA_PART) or remedy
        return Finding("camera", False, f"{message}, expected {wanted_hz:.0f} or more", remedy)
    return Finding("camera", True, message)


def actuator() -> Finding:
    """The device or bus of the actuator opens, and the car reports its speed and wheel angle."""
    process = _process_with(ACTUATOR_NODE)
    if process is None:
        return Finding("actuator", True, "simulated: no process runs vehicle.actuators.node")
    from vehicle.actuators.actuator import Car
    from vehicle.actuators.table import build, configured_actuator

    try:
        name, _ = configured_actuator()
        if name in ON_THE_BUS:
            return Finding("actuator", True, f"{name}: its driver joins the bus of a drive")
        name, wire = build(Car(load(CONFIG_DIR / "vehicle.yaml", Vehicle), None, time.monotonic))
    except InputError as error:
        remedy = _package_remedy(*ACTUATOR_PART) or "correct actuator.yaml, or connect the device"
        return Finding("actuator", False, str(error), remedy)
    try:
        reported, fault = _reports(wire)
        wire.close()
    except OSError as error:
        reported, fault = False, str(error)
    return judged_actuator(name, reported, fault)


def _reports(wire: "Actuator") -> tuple[bool, str]:
    """True when speed and wheel angle arrive within REPORT_S: without them the limiter brakes; the last fault."""
    began_s, fault = time.monotonic(), ""
    while time.monotonic() - began_s < REPORT_S:
        try:
            state = wire.read(now_s=time.monotonic())
            if state is not None and None not in (state.speed_mps, state.road_wheel_angle_rad):
                return True, ""
        except OSError as error:
            fault = str(error)
        time.sleep(0.01)
    return False, fault


def judged_actuator(name: str, reported: bool, fault: str) -> Finding:
    """``reported``: the car has sent its speed and wheel angle; ``fault``: of the wire."""
    if reported:
        return Finding("actuator", True, f"{name}: open, the car reports its speed and wheel angle")
    message = f"{name}: open, but the car does not report its speed and wheel angle"
    message += f": {fault}" if fault else ""
    remedy = "switch the car on; check channel, bit rate, sensor and wiring"
    return Finding("actuator", False, message, _package_remedy(*ACTUATOR_PART) or remedy)


def _process_with(module: str) -> str | None:
    """Name of the process that runs ``module``; None without one, also when the processes are not valid."""
    try:
        return next((spec.name for spec in load_processes() if spec.module == module), None)
    except InputError:
        return None  # the check of the processes reports it
