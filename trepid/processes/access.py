"""Permitted publishers of the topics of a drive, from its processes."""

from collections.abc import Iterable

from trepid.processes.settings import ProcessSpec
from trepid.topics import IMAGE_STATISTICS, LEAD_VEHICLE, ROAD_USERS, SIM_TRUTH


def published_by(specs: Iterable[ProcessSpec]) -> dict[str, tuple[str, ...]]:
    """Keys of the topics that each process may publish, by its name, for the access control of Zenoh.

    These are the topics in ``processes.yaml``, the image statistics of the estimator that judges the image, and the
    vehicle ahead and the road users where the simulated car gives them.
    """
    return {spec.name: (*spec.publishes, *_implied(spec)) for spec in specs}


def _implied(spec: ProcessSpec) -> tuple[str, ...]:
    judges = (IMAGE_STATISTICS.key,) if spec.options.get("statistics") else ()
    sensed = (LEAD_VEHICLE.key, ROAD_USERS.key) if SIM_TRUTH.key in spec.publishes else ()
    return (*judges, *sensed)
