"""The course of a real car: the road before it, whose true lane is not known."""

from collections.abc import Mapping, Sequence, Set
from typing import Any

from drive.check import check_car_apart
from drive.course import Findings
from drive.plan import Networks, with_estimators
from drive.tally import Tally
from trepid.config import car_folder, default_file
from trepid.messages import SimTruth
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
