"""The active faults, disturbances and manoeuvres of a run, as columns of its trace."""

from collections.abc import Iterable, Sequence

import numpy as np

from sim_harness.judging.trace import Trace
from sim_harness.scenarios.faults import Fault
from sim_harness.world.roads.disturbances import Disturbance
from trepid.types import Column


def with_events(
    trace: Trace,
    *,
    faults: Sequence[Fault],
    disturbances: Sequence[Disturbance] = (),
    lap_m: float | None = None,
) -> Trace:
    """``trace`` with ``fault.<kind>`` (0 or 1) and ``disturbance.<kind>`` (grade).

    Of several of one kind the greatest counts. A disturbance is active while the rear axle is in its stretch;
    ``lap_m`` is the length of a closed road, on which it recurs with every lap.
    """
    elapsed_s = trace["t_s"] - trace["t_s"][0]
    stations_m = trace["station_m"] if lap_m is None else trace["station_m"] % lap_m
    columns: dict[str, Column] = {}
    for fault in faults:
        there = np.array([fault.active(t) for t in elapsed_s.tolist()], dtype=np.float64)
        _raise_to(columns, f"fault.{fault.kind}", there)
    for disturbance in disturbances:
        grade = np.array([disturbance.grade_at(station) for station in stations_m.tolist()], dtype=np.float64)
        _raise_to(columns, f"disturbance.{disturbance.kind.value}", grade)
    return trace.joined(columns)


def with_manoeuvres(trace: Trace, kinds: Iterable[str], samples: Sequence[Sequence[str]]) -> Trace:
    """``trace`` with ``traffic.<kind>`` (0 or 1) of every kind; ``samples``: the manoeuvres under way."""
    columns = {
        f"traffic.{kind}": np.array([float(kind in now) for now in samples]) for kind in sorted({*kinds})
    }
    return trace.joined(columns)


def _raise_to(columns: dict[str, Column], name: str, values: Column) -> None:
    columns[name] = np.maximum(columns.get(name, values), values)
