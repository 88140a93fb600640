"""Wrong measurements of speed, wheel angle and yaw rate: whether the car stays in its lane and names the quantity.

Every form of a fault is injected into every quantity that a wire carries, at 5 and 15 m/s, on a straight road and
in a bend with a lateral acceleration of ``BEND_MPS2``, in the course of it and before it. The lane is the true one
behind the latency of a camera, so that nothing but the measurements is wrong.

A fault is *observable* where the error that it puts into a quantity, e = wrong value - true value, both without
noise, has in some second a root mean square above the standard deviation of the sensor's noise. Otherwise the noise
hides the error: such as the sign of a yaw rate on a straight road. The criterion knows the true motion only, and no
answer of the check. Whether the quantity is named is counted for the observable faults; the others have a row of
their own.

Every drive is one line in ``runs/measured_<seed>.jsonl``: an interrupted benchmark continues.
"""

import json
import math
from collections import defaultdict
from collections.abc import Iterator
from statistics import fmean
from typing import Any, NamedTuple

from lab.bench.measured.wires import WIRES, after_epoch
from sim_harness.lockstep.closed_loop import ClosedLoop, Instant, build_parts
from sim_harness.lockstep.sensors import NoiseSettings
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.faults import FIELDS, Sensors, WrongMeasurement
from sim_harness.scenarios.scenario import load_scenario
from sim_harness.sweep.store import Row, stored_rows
from trepid.causes import Cause
from trepid.config import WORK_DIR
from trepid.messages import VehicleState
from vehicle.measurement.check import build as build_check

SPEEDS_MPS, ROADS = (5.0, 15.0), ("straight", "bend", "before the bend")
BEND_MPS2 = 1.8
DURATION_S, FAULT_S, EARLY_S = 12.0, 5.0, 2.5  # EARLY_S: of the fault before the bend
BLOCK_S = 1.0  # of the root mean square of the error of a fault
TARGET = 95.0  # percent named
OFFSETS = {"speed": 2.0, "wheel_angle": 0.05, "yaw_rate": 0.15}  # [SI]
SPIKES = {"speed": 5.0, "wheel_angle": 0.2, "yaw_rate": 0.5}
FACTORS = {"speed": 3.6, "wheel_angle": 57.29578, "yaw_rate": 57.29578}  # km/h and degrees for SI units
FORMS = ("absent", "stuck", "offset", "sign", "factor", "spike", "swapped")
NEXT = {"speed": "wheel_angle", "wheel_angle": "yaw_rate", "yaw_rate": "speed"}


class MeasuredDrive(NamedTuple):
    """One drive."""

    wire: str
    quantity: str
    form: str
    road: str
    speed_mps: float
    seed: int

    @property
    def key(self) -> str:
        return (
            f"{self.wire}, {self.quantity} {self.form}, {self.road}, {self.speed_mps:g} m/s, seed {self.seed}"
        )

    @property
    def wrong(self) -> tuple[str, ...]:
        """The quantities with a wrong value."""
        return (self.quantity, NEXT[self.quantity]) if self.form == "swapped" else (self.quantity,)

    @property
    def fault(self) -> dict[str, Any]:
        """The fault of the scenario."""
        by = {"offset": OFFSETS, "spike": SPIKES, "factor": FACTORS}.get(self.form, {}).get(self.quantity)
        from_s = EARLY_S if self.road == "before the bend" else FAULT_S
        fault = {"kind": "wrong_measurement", "quantity": self.quantity, "form": self.form, "from_s": from_s}
        other = {"other": NEXT[self.quantity]} if self.form == "swapped" else {}
        return fault | other | ({} if by is None else {"by": by})


def bench_measured_faults(seed: int, *, jobs: int = 1, quick: bool = False) -> dict[str, Any]:
    """Departures and named quantities by wire, by form and by quantity; ``quick``: CAN and the simulator only."""
    wires = ("simulator", "can") if quick else tuple(WIRES)
    tasks = {task.key: task for task in _tasks(wires, seed)}
    path = WORK_DIR / "runs" / f"measured_{seed}.jsonl"
    return summary(stored_rows(path, driven_row, tasks, jobs=jobs))


def _tasks(wires: tuple[str, ...], seed: int) -> Iterator[MeasuredDrive]:
    for wire in wires:
        for quantity, field in FIELDS.items():
            for form in FORMS if field not in WIRES[wire].computed else ():
                for road in ROADS:
                    for speed_mps in SPEEDS_MPS:
                        yield MeasuredDrive(wire, quantity, form, road, speed_mps, seed)


class Errors:
    """The error of a fault relative to the noise of its sensor. Call with every true state of the car."""

    def __init__(self, task: MeasuredDrive, fault: WrongMeasurement, noise: NoiseSettings) -> None:
        self._sensors, self._from_s = Sensors([fault]), fault.from_s
        self._noise = {
            "speed_mps": noise.speed_noise_ratio * task.speed_mps,
            "road_wheel_angle_rad": noise.road_wheel_angle_noise_rad,
            "yaw_rate_radps": noise.yaw_rate_noise_radps,
        }
        self._squares = {FIELDS[name]: defaultdict[int, list[float]](list) for name in task.wrong}
        self._absent = False

    def __call__(self, true: VehicleState, elapsed_s: float) -> None:
        """Take the state of the car at ``elapsed_s``."""
        wrong = self._sensors.step(true, elapsed_s=elapsed_s)
        block = math.floor((elapsed_s - self._from_s) / BLOCK_S)
        for field, squares in self._squares.items():
            value = getattr(wrong, field)
            if value is None:
                self._absent = True
            else:
                squares[block].append(((value - getattr(true, field)) / self._noise[field]) ** 2)

    @property
    def greatest(self) -> float | None:
        """The greatest root mean square in a second, in deviations of the noise; None for an absent value."""
        if self._absent:
            return None
        return math.sqrt(max(fmean(block) for blocks in self._squares.values() for block in blocks.values()))


class Observer:
    """What is published from the fault on."""

    def __init__(self, task: MeasuredDrive) -> None:
        self._from_s: float = task.fault["from_s"]
        self._fields = {FIELDS[name] for name in task.wrong}
        self.named_s: float | None = None
        self.caused_s: float | None = None
        self.last_mps: float | None = None

    def __call__(self, instant: Instant) -> None:
        """Take the newest messages."""
        since_s = instant.now_s - self._from_s
        if since_s < 0.0:
            return
        if self.named_s is None and self._fields & {*instant.state.doubted}:
            self.named_s = since_s
        decision = instant.decision
        if self.caused_s is None and decision is not None and decision.cause == Cause.DOUBTED_STATE:
            self.caused_s = since_s
        self.last_mps = instant.truth.speed_mps


def driven_row(task: MeasuredDrive) -> Row:
    """One drive under ``task``."""
    curvature_1pm = 0.0 if task.road == "straight" else BEND_MPS2 / task.speed_mps**2
    early_m = (FAULT_S if task.road == "before the bend" else -1.0) * task.speed_mps
    straight_m = 30.0 + 5.0 + max(early_m, 0.0)
    segments = [
        {"length_m": straight_m},
        {"length_m": 1.5 * task.speed_mps, "curvature_1pm": [0, curvature_1pm]},
        {"length_m": 20.0 * task.speed_mps, "curvature_1pm": curvature_1pm},
    ]
    scenario = load_scenario(
        "straight",
        {
            "segments": json.dumps(segments),
            "speed_mps": str(task.speed_mps),
            "start": json.dumps({"speed_mps": task.speed_mps, "station_m": 30}),
            "faults": json.dumps([task.fault]),
            "duration_s": str(DURATION_S),
            "sight": "truth",
            "expect": "{}",
        },
    )
    parts, simulator, observer = build_parts(scenario, seed=task.seed), load_simulator(), Observer(task)
    vehicle, sensors = parts.vehicle.nominal, parts.vehicle.sensors
    wire = WIRES[task.wire](vehicle)
    (fault,) = (fault for fault in scenario.faults if isinstance(fault, WrongMeasurement))
    sensors.watch = errors = Errors(task, fault, simulator)
    sensors.put_wire(after_epoch(wire), build_check(vehicle, computed=wire.computed))
    trace = ClosedLoop(scenario, parts, simulator, observer).drive()
    return {
        **task._asdict(),
        "lateral_error_m": round(float(abs(trace["lateral_offset_m"]).max()), 3),
        "departures": int(trace["departures"][-1]),
        "error_of_noise": None if errors.greatest is None else round(errors.greatest, 2),
        "named_s": observer.named_s,
        "caused_s": observer.caused_s,
        "last_mps": observer.last_mps,
    }


def summary(rows: list[Row]) -> dict[str, Any]:
    """The tables of the benchmark from its rows."""
    by: dict[str, dict[str, Row]] = {}
    for column in ("wire", "quantity", "form", "road"):
        values = dict.fromkeys(row[column] for row in rows)
        by[f"by {column}"] = {
            value: figures([row for row in rows if row[column] == value]) for value in values
        }
    hidden = [row for row in rows if not is_observable(row)]
    unnamed = [
        f"{row['wire']}: {row['quantity']} {row['form']}, {row['road']}, {row['speed_mps']:g} m/s"
        for row in rows
        if row["named_s"] is None and is_observable(row)
    ]
    return {
        "all": {
            "all": figures(rows),
            **({"not observable: error < noise": figures(hidden)} if hidden else {}),
        },
        **by,
        "wheels outside the lane: target": 0,
        "named [%]: target": TARGET,
        "not named": unnamed,
    }


def is_observable(row: Row) -> bool:
    """Whether the error of the fault exceeds the noise in some second; an absent value does."""
    return row["error_of_noise"] is None or row["error_of_noise"] > 1.0


def figures(rows: list[Row]) -> Row:
    """Counts of drives, and the greatest and median values."""
    seen = [row for row in rows if is_observable(row)]
    times_s = sorted(row["named_s"] for row in seen if row["named_s"] is not None)
    stopped = sum(row["last_mps"] < 0.5 * row["speed_mps"] for row in seen)
    return {
        "drives": len(rows),
        "with a wheel outside": sum(row["departures"] > 0 for row in rows),
        "greatest error [m]": max(row["lateral_error_m"] for row in rows),
        "observable": len(seen),
        "named [%]": round(100.0 * len(times_s) / len(seen), 1) if seen else None,
        "named after, median [s]": round(times_s[len(times_s) // 2], 2) if times_s else None,
        "named after, longest [s]": round(times_s[-1], 2) if times_s else None,
        "slower than half": stopped,
    }
