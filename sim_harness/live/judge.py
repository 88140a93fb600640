"""The judge of a live drive of a scenario: a trace of the true lane, its scores and conditions."""

from array import array
from collections.abc import Sequence
from dataclasses import asdict

from drive.course import Verdict
from drive.log import DriveLog
from sim_harness.judging.conditions.expect import judge
from sim_harness.judging.metrics import measure
from sim_harness.judging.trace import Recorder, Trace
from sim_harness.scenarios.events import with_events
from sim_harness.scenarios.scenario import Scenario
from trepid.messages import SimTruth, VehicleState


class ScenarioJudge:
    """One trace sample for each truth of the simulated vehicle, judged by the conditions of the scenario."""

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._recorder = Recorder(scenario.estimators, on_disk=True)
        self._manoeuvres: dict[tuple[str, ...], int] = {}  # of the other vehicles, and a number for each ...
        self._under_way = array("H")  # ... of which one belongs to each sample of the trace

    def add(self, message: SimTruth | VehicleState, log: DriveLog) -> None:
        """Append a sample for a truth, once a state of the vehicle is known."""
        if isinstance(message, SimTruth) and log.state is not None:
            self._recorder.add(message, log.state, log.command, log.decision, log.estimates)
            number = self._manoeuvres.setdefault(message.manoeuvres, len(self._manoeuvres))
            self._under_way.append(number)

    def verdict(self, problems: Sequence[str], *, elapsed_s: float) -> Verdict:
        """The scores of the trace; ``problems`` and unsatisfied conditions fail the drive."""
        trace = self._trace()
        if len(trace) < 2:
            return Verdict([*problems] or ["no samples were recorded"], {})
        metrics = measure(trace)
        scores = asdict(metrics) | {
            "realtime_factor": round(metrics.duration_s / elapsed_s, 3),
            "trace_sha256": trace.sha256,
        }
        return Verdict([*problems, *judge(self._scenario.expect, metrics, trace)], scores)

    def _trace(self) -> Trace:
        """The drive so far, with its events."""
        trace = self._recorder.trace()
        if not len(trace):
            return trace
        known = list(self._manoeuvres)
        manoeuvres = [known[number] for number in self._under_way]
        return with_events(trace, self._scenario, self._scenario.build_road(), manoeuvres)
