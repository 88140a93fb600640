"""The processes of one drive: those of the car, and in a simulated drive those that its scenario asks for."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from sim_harness.scenarios.road_users import UserSensor
from sim_harness.scenarios.scenario import LeadSensor, Scenario
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, default_file, load, resource
from trepid.processes.page_door import FOXGLOVE, PAGE
from trepid.processes.settings import RECORDER, ProcessSpec, Restart, estimators_in
from trepid.topics import (
    CAMERA_COMPRESSED,
    CAMERA_IMAGE,
    DRIVER_INPUT,
    IMAGE_STATISTICS,
    LEAD_VEHICLE,
    ROAD_USERS,
    SIM_TRUTH,
    VEHICLE_STATE,
    estimate_topic,
)

Networks = Mapping[str, str | None]
"""Name of an estimator -> file of its driving network; None: the estimator of that name."""
ESTIMATOR, LEAD = "perception.node", "perception.lead.node"
SIMULATED = (
    ProcessSpec(
        "vehicle",
        "sim_harness.live.vehicle_node",
        publishes=(VEHICLE_STATE.key, SIM_TRUTH.key),
        restart=Restart.NEVER,
    ),
    ProcessSpec(
        "camera", "sim_harness.live.camera_node", publishes=(CAMERA_IMAGE.key, CAMERA_COMPRESSED.key)
    ),
)
"""Processes that replace those of the same name when a car without simulator drives a scenario."""


def is_simulated(specs: Iterable[ProcessSpec]) -> bool:
    """True when a process is part of the simulator: the drive then needs a scenario."""
    return any(spec.simulates for spec in specs)


def planned(
    specs: tuple[ProcessSpec, ...],
    scenario: Scenario | None,
    *,
    recorded: bool = False,
    chosen: Networks | None = None,
    page: bool = False,
    foxglove: bool = False,
) -> tuple[ProcessSpec, ...]:
    """The processes that run in a drive of ``scenario``; None: of a real car, with the ``chosen`` estimators.

    A scenario gives the estimators, and where it gives the vehicle ahead or the people itself, no process detects
    them. An estimator without an entry of its own runs as ``perception.node``. The first ``perception.node`` also
    judges the image, unless a process publishes ``perception/image_statistics``. The recorder runs when the drive
    is recorded, and where a process publishes ``driver/input``, because its record button starts recordings. The
    process PAGE runs with ``page``, FOXGLOVE with ``foxglove``. Raises InputError where the car leaves out the
    asked FOXGLOVE.
    """
    if foxglove and all(spec.name != FOXGLOVE for spec in specs):
        raise InputError(f"--foxglove: processes.yaml of the car leaves out the process {FOXGLOVE}")
    unasked = {name for name, asked in ((PAGE, page), (FOXGLOVE, foxglove)) if not asked}
    specs = tuple(spec for spec in specs if spec.name not in unasked)
    recorded = recorded or any(DRIVER_INPUT.key in spec.publishes for spec in specs)
    specs = tuple(spec for spec in specs if recorded or spec.name != RECORDER)
    if scenario is not None:
        specs = _of_scenario(specs, scenario)
        chosen = {name: scenario.networks.get(name) for name in scenario.estimators}
    if chosen is not None:
        specs = _estimating(specs, chosen)
    return _with_statistics(specs)


def _of_scenario(specs: tuple[ProcessSpec, ...], scenario: Scenario) -> tuple[ProcessSpec, ...]:
    if not is_simulated(specs):
        names = {spec.name for spec in SIMULATED}
        specs = (*SIMULATED, *(spec for spec in specs if spec.name not in names))
    if scenario.leads_by is not LeadSensor.CAMERA:
        finds = {LEAD_VEHICLE.key, ROAD_USERS.key}
        return tuple(
            s for s in specs if LEAD_VEHICLE.key not in s.publishes or not finds.issuperset(s.publishes)
        )
    if scenario.road_users_by is not UserSensor.CAMERA:
        specs = tuple(_without_road_users(spec) if spec.module == LEAD else spec for spec in specs)
    return specs


def _without_road_users(spec: ProcessSpec) -> ProcessSpec:
    """The process of the lead detector where the simulated car gives the road users."""
    publishes = tuple(key for key in spec.publishes if key != ROAD_USERS.key)
    return replace(spec, publishes=publishes, options={**spec.options, "road_users": False})


def _estimating(specs: tuple[ProcessSpec, ...], chosen: Networks) -> tuple[ProcessSpec, ...]:
    """``specs`` with the processes of the ``chosen`` estimators, and of no other ones."""
    specs = tuple(
        spec for spec in specs if not spec.estimators or not set(spec.estimators).isdisjoint(chosen)
    )
    missing = [name for name in chosen if not any(name in spec.estimators for spec in specs)]
    return specs + tuple(
        ProcessSpec(
            name,
            ESTIMATOR,
            {"estimator": name, **({"network": str(Path(file).resolve())} if (file := chosen[name]) else {})},
            publishes=(estimate_topic(name).key,),
        )
        for name in missing
    )


def _with_statistics(specs: tuple[ProcessSpec, ...]) -> tuple[ProcessSpec, ...]:
    """Of the processes of estimators exactly one judges the image, if no other process does."""
    judged = any(IMAGE_STATISTICS.key in spec.publishes for spec in specs)
    judged = judged or any(spec.options.get("statistics") for spec in specs)
    judges = [spec.name for spec in specs if spec.module == ESTIMATOR][: 0 if judged else 1]
    return tuple(
        replace(spec, options={"statistics": spec.name in judges, **spec.options})
        if spec.module == ESTIMATOR
        else spec
        for spec in specs
    )


def estimators_of(specs: Iterable[ProcessSpec], scenario: Scenario | None) -> tuple[str, ...]:
    """Names of the estimators of the drive. Raises InputError without any."""
    if scenario is not None:
        return scenario.estimators
    return estimators_in(specs)


def check_car(specs: Iterable[ProcessSpec]) -> None:
    """Load every file of settings, rules and weights that these processes of a real car read.

    Raises InputError with file:line:column for the first invalid value.
    """
    import controller.controller
    import controller.limiter
    import perception.estimators
    import perception.lead.finder
    import supervisor.supervisor

    load(CONFIG_DIR / "camera.yaml", Camera)
    controller.limiter.build()
    controller.controller.build()
    supervisor.supervisor.build(rules=default_file("fear.yaml"))
    for spec in specs:
        if spec.module == ESTIMATOR and "estimator" in spec.options:
            perception.estimators.build(spec.options["estimator"], network=spec.options.get("network"))
        elif spec.module == LEAD:
            perception.lead.finder.build()


def networks_in(specs: Iterable[ProcessSpec]) -> dict[str, str]:
    """File of each driving network among the processes, by the name of its estimator."""
    asked = (spec.options for spec in specs if spec.module == ESTIMATOR and spec.options.get("network"))
    return {options["estimator"]: str(resource(Path(options["network"]))) for options in asked}


def context_of(
    scenario: Scenario | None,
    estimators: tuple[str, ...],
    seed: int,
    networks: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The options that describe the drive to every process; ``networks``: as :func:`networks_in`."""
    rules: Path = default_file("fear.yaml") if scenario is None else scenario.rules_file
    return {
        "scenario": None if scenario is None else scenario.model_dump(mode="json"),
        "seed": seed,
        "estimators": estimators,
        "networks": dict(networks or {}),
        "cruise_speed_mps": None if scenario is None else scenario.speed_mps,
        "rules": str(rules.resolve()),  # processes run in the root
    }
