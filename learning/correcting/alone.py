"""A driving network alone in the simulator: no other estimator, no supervision, at any stated confidence.

The car follows the arc of the newest angle at a constant set speed; the controller adds the understeer. The
recording also holds the estimates of the expert, computed from the exact lane: the pure pursuit angle that leads
back to its centre (:mod:`sim_harness.lockstep.oracle`).
"""

import json
from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

from perception.net.driver import DriverNetwork, DrivingEstimator
from sim_harness.lockstep.closed_loop import Instant, Result, Witness, build_parts, run
from sim_harness.lockstep.oracle import Oracle
from sim_harness.lockstep.recording import recording
from sim_harness.lockstep.unsupervised import Estimates, FollowedLane, UnsupervisedDriver
from sim_harness.scenarios.chosen_estimators import changes_of
from sim_harness.scenarios.scenario import Scenario, Sight, load_scenario
from supervisor.supervisor import SupervisorSettings
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Decision, EstimateKind, Frame, SteeringEstimate, VehicleState

EXPERT = "expert"
SLACK, START_S = 1.1, 10.0  # of the time for a route, and to get going


class Alone:
    """The angles of a driving network, also for images unlike those of its training."""

    def __init__(self, name: str, driver: DrivingEstimator) -> None:
        self._name, self._driver = name, driver

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The angle for ``frame``; none where the output is not finite."""
        nothing = SteeringEstimate.nothing(
            frame.t_s,
            estimator=self._name,
            lookahead_m=0.0,
            reason="the network's output is not finite",
            kind=EstimateKind.ANGLE,
        )
        found = self._driver.steer(frame.image, frame.t_s)
        if found is None:
            return nothing
        return replace(nothing, road_wheel_angle_rad=found.road_wheel_rad, confidence=1.0, reason="")


def scenario_for(source: str, network: Path, changes: Mapping[str, str]) -> Scenario:
    """The scenario ``source`` with the network as its only estimator, for as long as its route takes.

    Raises InputError.
    """
    check(source, network.stem, changes)
    scenario = load_scenario(source, {**changes, **changes_of([str(network)])})
    if scenario.world is not None:  # its route has no length that is known before
        return scenario
    route_s = scenario.route_m(scenario.build_road()) / (scenario.speed_mps or _cruise_mps())
    return scenario.model_copy(update={"duration_s": max(scenario.duration_s, SLACK * route_s + START_S)})


def check(source: str, network: str, changes: Mapping[str, str]) -> Scenario:
    """The scenario; raises InputError where a network called ``network`` cannot drive it alone."""
    if network == EXPERT:
        raise InputError(f"{network!r} is the name of the estimates of the exact lane; rename the network")
    scenario = load_scenario(source, {**changes, "estimators": json.dumps([network])}, check=False)
    if scenario.sight is Sight.TRUTH:
        raise InputError(f"scenario {scenario.name}: a network needs images, and sight: truth renders none")
    return scenario


def _cruise_mps() -> float:
    return load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).cruise_speed_mps


def drive_alone(scenario: Scenario, *, seed: int, record: Path | None = None) -> Result:
    """Drive a scenario of :func:`scenario_for` by its network alone; ``record``: file of the recording.

    Raises InputError.
    """
    ((name, file),) = scenario.networks.items()
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    parts = build_parts(scenario, seed=seed)

    def choice(_: Decision, estimates: Estimates) -> FollowedLane | None:
        newest = estimates[name]
        return None if newest is None else FollowedLane.arc(newest, wheelbase_m=vehicle.wheelbase_m)

    driver = UnsupervisedDriver(
        parts.supervisor, name, choice, cruise_speed_mps=scenario.speed_mps or _cruise_mps()
    )
    parts = replace(
        parts,
        supervisor=driver,  # type: ignore[arg-type]
        estimators={name: Alone(name, DrivingEstimator(name, DriverNetwork(Path(file)), vehicle))},
        lead=None,
    )
    with recording(record, scenario) if record else nullcontext() as witness:
        with_expert = _with_expert(witness, Oracle(EXPERT, parts.vehicle.road, vehicle)) if witness else None
        return run(scenario, seed=seed, parts=parts, witness=with_expert)


def _with_expert(witness: Witness, oracle: Oracle) -> Witness:
    """``witness``, with the estimates of the expert for every frame whose exact lane is the present one."""
    newest: SteeringEstimate | None = None

    def watch(now: Instant) -> None:
        nonlocal newest
        if now.frame is not None and now.frame.t_s == now.truth.t_s:
            newest = oracle.step(now.truth)
        witness(replace(now, estimates={**now.estimates, EXPERT: newest}))

    return watch
