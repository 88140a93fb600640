"""The choice of a course by the command line or from Python."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path

from drive.course import Course
from drive.open_road import OpenRoad
from trepid.packages import courses


def course_for(
    scenario: str | None, changes: Mapping[str, str], estimators: Sequence[str], *, duration_s: float | None
) -> Course:
    """The course of ``scenario``, a name or a file; None: the open road of the car in use.

    ``changes``: of the scenario, as of ``--set``. ``estimators``: names, or files of driving networks, instead of
    the usual ones; none: those. ``duration_s`` ends the drive. Only a scenario imports the simulator, by its name.
    Raises InputError for an invalid scenario, and for one that only the lock-step loop can simulate.
    """
    if scenario is not None:
        made: Course = import_module(courses()).course_of(
            scenario, changes, estimators, duration_s=duration_s
        )
        return made
    return OpenRoad(duration_s=duration_s, chosen=networks_of(estimators) if estimators else None)


def networks_of(designations: Sequence[str]) -> dict[str, str | None]:
    """The names of estimators given by names or files, and the file of each driving network. Raises InputError."""
    from perception.estimators import NETWORK_SUFFIX, name_of  # heavy; a car mostly drives with its own

    return {
        name_of(text): str(Path(text).resolve()) if text.endswith(NETWORK_SUFFIX) else None
        for text in designations
    }
