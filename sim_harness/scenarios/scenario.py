"""Scenarios: where a run starts, what goes wrong on the way, and what is expected of it.

A scenario is a YAML file (``config/scenarios/*.yaml``) or a Python script that leaves a :class:`Scenario`, or a
list of them, in the variable ``scenarios``.
"""

import runpy
from collections.abc import Mapping
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from perception.estimators import ESTIMATORS
from sim_harness.lockstep.metrics import Metrics
from sim_harness.lockstep.trace import Trace
from sim_harness.roads.appearance import Marking, Surface, Verge
from sim_harness.roads.light import Light, NonNegative, Positive, Share
from sim_harness.roads.road import Road, RoadSettings, Segment
from sim_harness.scenarios.vary import Variation, check_vary
from trepid.config import CONFIG_DIR, InputError, Settings, load, parse, read
from trepid.vehicle import Vehicle

SCENARIO_DIR = CONFIG_DIR / "scenarios"
STANDSTILL_MPS = 0.01


class Tag(StrEnum):
    """What a scenario is about."""

    NOMINAL = "nominal"
    CURVE = "curve"
    UNMARKED = "unmarked"
    ILLUMINATION = "illumination"
    WEATHER = "weather"
    MARKING = "marking"
    TRAFFIC = "traffic"
    FAULT = "fault"
    LATENCY = "latency"
    SPEED = "speed"


class Start(Settings):
    """Where the vehicle stands at the beginning."""

    station_m: float = 0.0
    offset_m: float = 0.0  # + = left of the lane centre
    heading_rad: float = 0.0  # relative to the lane


class CameraTiming(Settings):
    """When frames are taken and when their estimates are there."""

    rate_hz: Annotated[float, Field(gt=0, le=100)] = 25.0
    latency_s: NonNegative = 0.02  # capture to estimate; live median on two cores


class LeadSettings(Settings):
    """A vehicle ahead, on the lane centre at constant speed."""

    gap_m: Positive  # bumper to bumper at the start
    speed_mps: NonNegative


class Appearance(Settings):
    """What differs from the road's own sections, in all of them; absent: as the road has it."""

    left: Marking | None = None
    right: Marking | None = None
    far_left: Marking | None = None
    paved_left_m: NonNegative | None = None
    paved_right_m: NonNegative | None = None
    surface: Surface | None = None
    surface_grey: Share | None = None
    patchiness: Share | None = None
    verge: Verge | None = None
    shadows: Share | None = None
    light: Light | None = None


class Span(Settings):
    """A stretch of time, from the start of the run; without an end it lasts."""

    from_s: NonNegative
    to_s: Positive | None = None

    def active(self, elapsed_s: float) -> bool:
        """True within the span."""
        return self.from_s <= elapsed_s and (self.to_s is None or elapsed_s < self.to_s)


class FrozenCamera(Span):
    """The camera repeats its last image with fresh time stamps."""

    kind: Literal["frozen_camera"]


class BlackFrames(Span):
    """The camera sends black images."""

    kind: Literal["black_frames"]


class LateFrames(Span):
    """Frames arrive ``delay_s`` after their capture, rounded up to whole frames, with honest time stamps."""

    kind: Literal["late_frames"]
    delay_s: Positive


class LostProcess(Span):
    """A process is gone: it publishes nothing."""

    kind: Literal["lost_process"]
    process: str  # "camera", "supervisor", "controller" or the name of an estimator


class EstimatorBias(Span):
    """An estimator sees the lane beside where it is, and is as sure as ever."""

    kind: Literal["estimator_bias"]
    estimator: str
    lateral_m: float


Fault = Annotated[
    FrozenCamera | BlackFrames | LateFrames | LostProcess | EstimatorBias, Field(discriminator="kind")
]


class Expect(Settings):
    """What a run must satisfy to pass; absent: not judged."""

    max_departures: Annotated[int, Field(ge=0)] = 0
    max_interventions: Annotated[int, Field(ge=0)] = 0
    max_collisions: Annotated[int, Field(ge=0)] = 0
    max_lateral_error_m: Positive | None = None
    max_lateral_accel_mps2: Positive | None = None
    max_lateral_jerk_mps3: Positive | None = None
    max_decel_mps2: Positive | None = None
    min_mean_speed_mps: Positive | None = None
    min_time_gap_s: Positive | None = None
    must_finish: bool = False  # drive the whole route
    must_stop_by_s: Positive | None = None  # drive, and stand still from this time of the run to its end


class Scenario(Settings):
    """One run, complete but for the seed."""

    name: str = ""  # default: the name of the file
    description: str
    tags: Annotated[tuple[Tag, ...], Field(min_length=1)]
    road: str  # a name in config/roads/, or a .yaml file beside the scenario
    segments: tuple[Segment, ...] | None = None  # this line instead of the road's, as an open road
    lane_width_m: Annotated[float, Field(ge=2.0, le=6.0)] | None = None
    appearance: Appearance = Appearance()
    start: Start = Start()
    duration_s: Positive  # at most; the run also ends when the route is driven
    distance_m: Positive | None = None  # length of the route; default: one round, or to the end of the road
    camera: CameraTiming = CameraTiming()
    estimators: Annotated[tuple[str, ...], Field(min_length=1)] = ("cv", "cnn")
    plant: dict[str, float] = Field(default_factory=dict)  # fields of the vehicle file that differ in reality
    lead: LeadSettings | None = None
    faults: tuple[Fault, ...] = ()
    expect: Expect = Expect()
    vary: dict[str, Variation] = Field(default_factory=dict)  # what sampling changes; see scenarios/vary.py

    @model_validator(mode="after")
    def _faults_hit_something(self) -> Self:
        victims = {"camera", "supervisor", "controller", *self.estimators}
        for fault in self.faults:
            victim = getattr(fault, "process", None) or getattr(fault, "estimator", None)
            if victim is not None and victim not in victims:
                raise ValueError(f"no process {victim!r}; there are {', '.join(sorted(victims))}")
        return self

    def build_road(self) -> Road:
        """The road as this scenario has it. Raises InputError."""
        path = Path(self.road) if self.road.endswith(".yaml") else CONFIG_DIR / "roads" / f"{self.road}.yaml"
        settings = load(path, RoadSettings)
        changes = {name: value for name, value in self.appearance if value is not None}
        sections = tuple(section.model_copy(update=changes) for section in settings.sections)
        update: dict[str, object] = {"sections": sections}
        if self.lane_width_m is not None:
            update["lane_width_m"] = self.lane_width_m
        if self.segments is not None:
            update |= {"segments": self.segments, "closed": False, "sections": sections[:1]}
        try:
            return Road(RoadSettings.model_validate({**dict(settings), **update}))
        except ValueError as error:
            raise InputError(f"scenario {self.name}: road {self.road}: {_message(error)}") from error

    def check(self) -> None:
        """Raise InputError when the scenario names what is not there."""
        for name in self.estimators:
            if name not in ESTIMATORS:
                raise InputError(
                    f"scenario {self.name}: no estimator {name!r}; there are {', '.join(ESTIMATORS)}"
                )
        self.build_road()
        self.build_plant_vehicle(load(CONFIG_DIR / "vehicle.yaml", Vehicle))

    def build_plant_vehicle(self, vehicle: Vehicle) -> Vehicle:
        """``vehicle`` with what differs in reality. Raises InputError."""
        try:
            return Vehicle.model_validate({**dict(vehicle), **self.plant})
        except ValueError as error:
            raise InputError(f"scenario {self.name}: plant: {_message(error)}") from error

    def shortened(self, duration_s: float) -> "Scenario":
        """This scenario cut off after ``duration_s``, without the expectations that need the whole run."""
        if duration_s >= self.duration_s:
            return self
        dropped: dict[str, object] = {"must_finish": False, "min_mean_speed_mps": None}
        if self.expect.must_stop_by_s is not None and self.expect.must_stop_by_s > duration_s:
            dropped["must_stop_by_s"] = None
        expect = self.expect.model_copy(update=dropped)
        return self.model_copy(update={"duration_s": duration_s, "expect": expect})

    def route_m(self, road: Road) -> float:
        """Length of the route [m]."""
        if self.distance_m is not None:
            return self.distance_m
        return road.length_m if road.closed else road.length_m - self.start.station_m


def list_scenarios() -> list[Scenario]:
    """The scenarios of ``config/scenarios/``, by name. Raises InputError."""
    return [load_scenario(path.stem) for path in sorted(SCENARIO_DIR.glob("*.yaml"))]


def load_scenario(source: str, overrides: Mapping[str, str] | None = None) -> Scenario:
    """The scenario called ``source``, or in the YAML file ``source``. Raises InputError."""
    path = Path(source)
    if path.suffix not in (".yaml", ".yml"):
        path = SCENARIO_DIR / f"{source}.yaml"
        if not path.is_file():
            names = ", ".join(sorted(p.stem for p in SCENARIO_DIR.glob("*.yaml")))
            raise InputError(f"no scenario {source!r}; there are {names}, or give a .yaml or .py file")
    data = read(path)
    scenario = parse(data, Scenario, source=path, overrides=overrides)
    check_vary(scenario, scenario.vary, data, path)
    update = {"name": scenario.name or path.stem}
    if scenario.road.endswith(".yaml"):
        update["road"] = str(path.parent / scenario.road)
    return scenario.model_copy(update=update)


def load_scenarios(source: str, overrides: Mapping[str, str] | None = None) -> list[Scenario]:
    """All scenarios of ``source``: a name, a YAML file, or a Python script. Raises InputError."""
    if Path(source).suffix != ".py":
        return [load_scenario(source, overrides)]
    if overrides:
        raise InputError(f"{source}: --set changes YAML scenarios; a script sets its own values")
    return _run_script(Path(source))


def _run_script(path: Path) -> list[Scenario]:
    if not path.is_file():
        raise InputError(f"{path}: cannot be read: no such file")
    try:
        found = runpy.run_path(str(path)).get("scenarios")
    except Exception as error:
        raise InputError(f"{path}:{_script_line(error, path)}: {_message(error)}") from error
    listed = [found] if isinstance(found, Scenario) else list(found or [])
    if not listed or not all(isinstance(scenario, Scenario) for scenario in listed):
        raise InputError(f"{path}: must leave a Scenario or a list of them in the variable `scenarios`")
    return [
        scenario if scenario.name else scenario.model_copy(update={"name": f"{path.stem}.{number}"})
        for number, scenario in enumerate(listed)
    ]


def _script_line(error: Exception, path: Path) -> int:
    """The last line of the script that the error passed through."""
    if isinstance(error, SyntaxError):
        return error.lineno or 1
    line, trace = 1, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == str(path):
            line = trace.tb_lineno
        trace = trace.tb_next
    return line


def _message(error: Exception) -> str:
    """One line for an error of pydantic or of a script."""
    return " ".join(str(error).split()) or type(error).__name__


def judge(expect: Expect, metrics: Metrics, trace: Trace) -> list[str]:
    """Why a run failed what was expected of it; empty when it passed."""
    most = {
        "departures": expect.max_departures,
        "interventions": expect.max_interventions,
        "collisions": expect.max_collisions,
        "max_lateral_error_m": expect.max_lateral_error_m,
        "max_lateral_accel_mps2": expect.max_lateral_accel_mps2,
        "max_lateral_jerk_mps3": expect.max_lateral_jerk_mps3,
        "max_decel_mps2": expect.max_decel_mps2,
    }
    least = {"mean_speed_mps": expect.min_mean_speed_mps, "min_time_gap_s": expect.min_time_gap_s}
    reasons = []
    for name, limit in most.items():
        value = getattr(metrics, name)
        if limit is not None and value > limit:
            reasons.append(f"{name} {value:.4g}: at most {limit:.4g} expected")
    for name, limit in least.items():
        value = getattr(metrics, name)
        if limit is not None and (value is None or value < limit):
            found = "unknown" if value is None else f"{value:.4g}"
            reasons.append(f"{name} {found}: at least {limit:.4g} expected")
    if expect.must_finish and not trace["finished"][-1]:
        reasons.append("the route was not driven to its end")
    if expect.must_stop_by_s is not None:
        reasons += _judge_stop(expect.must_stop_by_s, trace)
    return reasons


def _judge_stop(by_s: float, trace: Trace) -> list[str]:
    """Whether the vehicle drove, and stood still from ``by_s`` after the start to the end."""
    elapsed_s = trace["t_s"] - trace["t_s"][0]
    moving = elapsed_s[trace["speed_mps"] > STANDSTILL_MPS]
    if elapsed_s[-1] < by_s:
        return [f"the run ended before {by_s:.4g} s, by when the vehicle had to stand"]
    if len(moving) == 0:
        return ["the vehicle never moved, so that it stands shows nothing"]
    if moving[-1] >= by_s:
        return [f"the vehicle moved at {moving[-1]:.2f} s: expected to stand from {by_s:.4g} s on"]
    return []
