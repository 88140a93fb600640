"""The active faults, disturbances and manoeuvres of a run, as columns of its trace."""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from sim_harness.judging.trace import USER_GAP, Trace
from sim_harness.scenarios.scenario import Scenario
from trepid.types import Column


class Round(Protocol):
    """A road, or the lane of a world of another package, by what stations need."""

    closed: bool  # stations continue over laps of ...
    length_m: float


def with_events(
    trace: Trace,
    scenario: Scenario,
    road: Round,
    manoeuvres: Sequence[Sequence[str]] = (),
    *,
    user_gaps_m: Sequence[float | None] = (),
) -> Trace:
    """``trace`` with the columns of the events that conditions may name.

    They are ``fault.<kind>`` (0 or 1), ``disturbance.<kind>`` (grade) and ``traffic.<kind>`` (0 or 1). Of several
    of a kind the greatest counts. A disturbance is active while the rear axle is in its stretch, on a closed road
    in every lap. ``manoeuvres``: those under way at each sample. ``user_gaps_m``: the distance of the nearest
    person, cyclist or animal at each sample; a scenario that has some gets the column USER_GAP.
    """
    columns: dict[str, Column] = {}

    def put(name: str, values: Sequence[float]) -> None:
        column = np.array(values, dtype=np.float64)
        columns[name] = np.maximum(columns.get(name, column), column)

    elapsed_s = (trace["t_s"] - trace["t_s"][0]).tolist()
    stations_m = (trace["station_m"] % road.length_m if road.closed else trace["station_m"]).tolist()
    for fault in scenario.faults:
        put(f"fault.{fault.kind}", [fault.active(t) for t in elapsed_s])
    for disturbance in scenario.disturbances:
        put(f"disturbance.{disturbance.kind.value}", [disturbance.grade_at(at_m) for at_m in stations_m])
    for kind in sorted({*scenario.manoeuvres}):
        put(f"traffic.{kind}", [kind in now for now in manoeuvres])
    if scenario.road_users and len(user_gaps_m):
        columns[USER_GAP] = np.array(user_gaps_m, dtype=np.float64)
    return trace.with_columns(columns)
