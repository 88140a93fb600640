"""The choice of a course, and the course of a real car: the road before it, whose true lane is not known."""

from collections.abc import Mapping, Sequence, Set
from importlib import import_module
from pathlib import Path
from typing import Any

from drive.check import check_car_apart
from drive.course import Course, Findings
from drive.plan import Networks, with_estimators
from drive.tally import Tally
from trepid.config import car_folder, default_file
from trepid.messages import SimTruth
from trepid.packages import courses
from trepid.processes.settings import ProcessSpec, estimators_in


class OpenRoad:
    """A drive of the car in use, until its duration or a signal; the car stops before the processes end."""

    scenario = None
    stops_at_end = True
    endings = ("stopped by SIGINT", "stopped by SIGTERM")

    def __init__(self, *, duration_s: float | None = None, chosen: Networks | None = None) -> None:
        """``chosen``: estimators instead of those of the car's processes; None: those."""
        self.duration_s = duration_s
        self._chosen = chosen
        car = car_folder()
        self.name = car.name if car is not None else "the car"

    def processes(self, specs: tuple[ProcessSpec, ...]) -> tuple[ProcessSpec, ...]:
        """``specs``, with the processes of the chosen estimators."""
        return specs if self._chosen is None else with_estimators(specs, self._chosen)

    def estimators(self, specs: Sequence[ProcessSpec]) -> tuple[str, ...]:
        """Names of the estimators among ``specs``. Raises InputError without any."""
        return estimators_in(specs)

    def check(self, specs: Sequence[ProcessSpec]) -> Findings:
        """See :func:`~drive.check.check_car_apart`. Raises InputError."""
        return check_car_apart(specs)

    def options(self) -> Mapping[str, Any]:
        """No scenario, the cruise speed of supervisor.yaml, the rules of the car."""
        return {
            "scenario": None,
            "cruise_speed_mps": None,
            "rules": str(default_file("fear.yaml").resolve()),  # processes run in the root
        }

    def has_begun(self, truth: SimTruth | None) -> bool:
        """True: a real car starts from standstill, without a run-up."""
        return True

    def lost(self, elapsed_s: float) -> Set[str]:
        """No process is lost on purpose."""
        return frozenset()

    def judge(self) -> Tally:
        """The sums over the states of the car."""
        return Tally()


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
