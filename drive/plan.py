"""The processes of one drive: those of the car, and what its course and the command line ask for."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drive.course import Course
from trepid.config import InputError, place_of_edit, resource
from trepid.processes.page_door import FOXGLOVE, PAGE
from trepid.processes.settings import RECORDER, ProcessSpec, load_processes
from trepid.topics import DRIVER_INPUT, IMAGE_STATISTICS, estimate_topic

Networks = Mapping[str, str | None]
"""Name of an estimator -> file of its driving network; None: the estimator of that name."""
ESTIMATOR, LEAD = "perception.node", "perception.lead.node"


def is_simulated(specs: Iterable[ProcessSpec]) -> bool:
    """True when a process is part of the simulator: the drive then needs a scenario."""
    return any(spec.simulates for spec in specs)


def has_simulator() -> bool:
    """True when the processes of the car in use contain a simulator, so that a drive needs a scenario."""
    return is_simulated(load_processes())


def plan_processes(
    specs: tuple[ProcessSpec, ...],
    course: Course,
    *,
    recorded: bool = False,
    page: bool = False,
    foxglove: bool = False,
) -> tuple[ProcessSpec, ...]:
    """The processes that run in a drive of ``course`` by the car with the processes ``specs``.

    The first ``perception.node`` also judges the image, unless a process publishes
    ``perception/image_statistics``. The recorder runs when the drive is recorded, and where a process publishes
    ``driver/input``, because its record button starts recordings. The process PAGE runs with ``page``, FOXGLOVE
    with ``foxglove``. Raises InputError where the car leaves out the asked FOXGLOVE.
    """
    if foxglove and all(spec.name != FOXGLOVE for spec in specs):
        raise InputError(f"--foxglove: processes.yaml of the car leaves out the process {FOXGLOVE}")
    unasked = {name for name, asked in ((PAGE, page), (FOXGLOVE, foxglove)) if not asked}
    specs = tuple(spec for spec in specs if spec.name not in unasked)
    recorded = recorded or any(DRIVER_INPUT.key in spec.publishes for spec in specs)
    specs = tuple(spec for spec in specs if recorded or spec.name != RECORDER)
    return _with_statistics(course.processes(specs))


def with_estimators(specs: tuple[ProcessSpec, ...], chosen: Networks) -> tuple[ProcessSpec, ...]:
    """``specs`` with the processes of the ``chosen`` estimators, and of no other ones.

    An estimator without an entry of its own runs as ``perception.node``.
    """
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


def networks_in(specs: Iterable[ProcessSpec]) -> dict[str, str]:
    """File of each driving network among the processes, by the name of its estimator."""
    asked = (spec.options for spec in specs if spec.module == ESTIMATOR and spec.options.get("network"))
    return {options["estimator"]: str(resource(Path(options["network"]))) for options in asked}


def context_of(
    course: Course,
    estimators: tuple[str, ...],
    seed: int,
    networks: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """The options that describe the drive to every process; ``networks``: as :func:`networks_in`."""
    named = {"seed": seed, "estimators": estimators, "networks": dict(networks or {})}
    options = course.options()
    return {**options, "edited_rules": str(place_of_edit(Path(options["rules"]))), **named}
