"""A scenario as the course of a live drive: its processes, duration, rules, faults and judge.

The judge keeps a trace of the true lane, its scores and conditions.
"""

from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import asdict, replace
from typing import Any

from drive.course import Findings, Verdict
from drive.log import DriveLog
from drive.plan import LEAD, is_simulated, with_estimators
from drive.tally import Takeovers, autonomy_percent
from perception.estimators import misfits
from perception.lead.finder import blindness, check_lead
from sim_harness.judging.conditions.expect import is_driven, judge
from sim_harness.judging.metrics import Metrics, measure
from sim_harness.judging.trace import Recorder, Trace
from sim_harness.lockstep.closed_loop import check_configuration
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.events import with_events
from sim_harness.scenarios.faults import EstimatorBias, LostLane
from sim_harness.scenarios.road_users import UserSensor
from sim_harness.scenarios.scenario import LeadSensor, Scenario, Sight, load_scenario
from trepid.config import InputError
from trepid.messages import SimTruth, VehicleState
from trepid.processes.fused import gather_specs
from trepid.processes.settings import ProcessSpec, Restart
from trepid.topics import (
    CAMERA_COMPRESSED,
    CAMERA_IMAGE,
    LEAD_VEHICLE,
    ROAD_USERS,
    SIM_TRUTH,
    VEHICLE_STATE,
)


class ScenarioJudge:
    """One trace sample for each truth of the simulated vehicle, judged by the conditions of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._recorder = Recorder(scenario.estimators, on_disk=True)
        self._takeovers = Takeovers()
        self._begun = False
        self._manoeuvres: dict[tuple[str, ...], int] = {}  # of the other vehicles, and a number for each ...
        self._under_way = array("H")  # ... of which one belongs to each sample of the trace

    def add(self, message: SimTruth | VehicleState, log: DriveLog) -> None:
        """Append a sample for a truth from the time 0 on, once a state of the vehicle is known."""
        if isinstance(message, VehicleState):
            if self._begun:
                self._takeovers.add(message, log.decision)
        elif has_begun(message) and log.state is not None:
            self._begun = True
            self._recorder.add(message, log.state, log.command, log.decision, log.estimates)
            number = self._manoeuvres.setdefault(message.manoeuvres, len(self._manoeuvres))
            self._under_way.append(number)

    def verdict(self, problems: Sequence[str], *, elapsed_s: float) -> Verdict:
        """The scores of the trace; ``problems`` and unsatisfied conditions fail the drive."""
        trace = self._trace()
        if len(trace) < 2:
            return Verdict([*problems] or ["no samples were recorded"], {})
        metrics = with_takeovers(measure(trace), self._takeovers)
        scores = asdict(metrics) | {
            "realtime_factor": round(metrics.duration_s / elapsed_s, 3),
            "trace_sha256": trace.sha256,
        }
        reasons = [*problems, *judge(self._scenario.expect, metrics, trace)]
        return Verdict(
            reasons, scores, is_driven(self._scenario.expect, metrics), tuple(self._takeovers.notes)
        )

    def _trace(self) -> Trace:
        """The drive so far, with its events."""
        trace = self._recorder.trace()
        if not len(trace):
            return trace
        known = list(self._manoeuvres)
        manoeuvres = [known[number] for number in self._under_way]
        return with_events(trace, self._scenario, self._scenario.build_road(), manoeuvres)


def with_takeovers(metrics: Metrics, takeovers: Takeovers) -> Metrics:
    """``metrics`` with the interventions by a person."""
    interventions = metrics.interventions + takeovers.count
    autonomy = metrics.autonomy_percent
    if autonomy is not None:
        autonomy = autonomy_percent(interventions, metrics.duration_s)
    return replace(metrics, interventions=interventions, autonomy_percent=autonomy)


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


class ScenarioCourse:
    """A live drive of ``scenario``: it ends at the end of the route, after the duration, or at a signal."""

    stops_at_end = False
    endings = ()

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self.name = self.scenario = scenario.name
        self.duration_s = scenario.duration_s

    def processes(self, specs: tuple[ProcessSpec, ...]) -> tuple[ProcessSpec, ...]:
        """``specs`` with the simulated car and the estimators of the scenario.

        Where the scenario gives the vehicle ahead or the people itself, no process detects them.
        """
        scenario = self._scenario
        if not is_simulated(specs):
            names = {spec.name for spec in SIMULATED}
            specs = (*SIMULATED, *(spec for spec in specs if spec.name not in names))
        if scenario.leads_by is not LeadSensor.CAMERA:
            finds = {LEAD_VEHICLE.key, ROAD_USERS.key}
            specs = tuple(
                s for s in specs if LEAD_VEHICLE.key not in s.publishes or not finds.issuperset(s.publishes)
            )
        elif scenario.road_users_by is not UserSensor.CAMERA:
            specs = tuple(_without_road_users(spec) if spec.module == LEAD else spec for spec in specs)
        return with_estimators(specs, {name: scenario.networks.get(name) for name in scenario.estimators})

    def estimators(self, specs: Sequence[ProcessSpec]) -> tuple[str, ...]:
        """Those of the scenario, in its order."""
        return self._scenario.estimators

    def check(self, specs: Sequence[ProcessSpec]) -> Findings:
        """Load what a run of the scenario reads. Raises InputError, also for a fault of no process of its own."""
        check_lead(specs)
        check_configuration([self._scenario])
        self._check_losable(gather_specs(specs))
        senses = self._scenario.road_users_by is not UserSensor.CAMERA
        return Findings(misfits(), "" if senses else blindness(specs))

    def _check_losable(self, specs: Iterable[ProcessSpec]) -> None:
        """Raise InputError when a fault of the scenario concerns a process that does not run by itself."""
        names = {spec.name for spec in specs}
        for fault in self._scenario.faults:
            process = getattr(fault, "process", None)
            if process is not None and process not in names:
                raise InputError(
                    f"the fault {fault.kind} of the scenario concerns {process!r}, which is "
                    f"no process of its own in this drive; there are {', '.join(sorted(names))}"
                )

    def options(self) -> Mapping[str, Any]:
        """The scenario, its set speed and its rules."""
        return {
            "scenario": self._scenario.model_dump(mode="json"),
            "cruise_speed_mps": self._scenario.speed_mps,
            "rules": str(self._scenario.rules_file.resolve()),  # processes run in the root
        }

    def has_begun(self, truth: SimTruth | None) -> bool:
        """True from the time 0 of the scenario on: a start at speed follows a run-up."""
        return truth is not None and has_begun(truth)

    def lost(self, elapsed_s: float) -> Set[str]:
        """The processes that a fault of the scenario stops now."""
        return self._scenario.lost_processes(elapsed_s)

    def judge(self) -> ScenarioJudge:
        """A judge by the conditions of the scenario."""
        return ScenarioJudge(self._scenario)


def has_begun(truth: SimTruth) -> bool:
    """True from the time 0 of a scenario on."""
    return truth.elapsed_s is not None and truth.elapsed_s >= 0.0


def course_of(
    scenario: str, changes: Mapping[str, str], estimators: Sequence[str], *, duration_s: float | None
) -> ScenarioCourse:
    """See :func:`drive.open_road.course_for`, which calls it. Raises InputError."""
    found = load_scenario(scenario, {**changes, **changes_of(estimators)})
    found.check()
    found = found if duration_s is None else found.shorten(duration_s)
    for what in lockstep_only(found):
        raise InputError(f"scenario {found.name}: {what} acts in lock-step only: trepid sim run")
    return ScenarioCourse(found)


def lockstep_only(scenario: Scenario) -> Iterator[str]:
    """The parts of ``scenario`` that a live drive cannot simulate."""
    if scenario.sight is Sight.TRUTH:
        yield "sight: truth"
    if scenario.world is not None:
        yield "a world of another package"
    if scenario.leads_by is LeadSensor.MODELLED:
        yield "lead_sensor: modelled"
    yield from (fault.kind for fault in scenario.faults if isinstance(fault, EstimatorBias | LostLane))


def _without_road_users(spec: ProcessSpec) -> ProcessSpec:
    """The process of the lead detector where the simulated car gives the road users."""
    publishes = tuple(key for key in spec.publishes if key != ROAD_USERS.key)
    return replace(spec, publishes=publishes, options={**spec.options, "road_users": False})
