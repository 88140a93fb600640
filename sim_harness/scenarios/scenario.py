"""Scenarios: where a run starts, what goes wrong on the way, and what is expected of it.

A scenario is a YAML file (``config/scenarios/*.yaml``) or a Python script that leaves a :class:`Scenario`, or a
list of them, in the variable ``scenarios``.
"""

import math
import runpy
from collections.abc import Mapping, Set
from enum import StrEnum
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Self, get_type_hints

from pydantic import Field, ValidationError, create_model, model_validator

from perception.estimators import ESTIMATORS, estimators
from sim_harness.judging.conditions.conditions import parse_condition
from sim_harness.judging.conditions.expect import Expect
from sim_harness.scenarios.faults import BlackFrames, Fault, FrozenCamera
from sim_harness.scenarios.traffic import TrafficVehicle
from sim_harness.scenarios.vary import Variation, check_vary
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.road_file import ROAD_SUFFIXES, load_road_settings
from sim_harness.world.roads.appearance import Section
from sim_harness.world.roads.disturbances import Disturbance, disturbed
from sim_harness.world.roads.features import Junction, RoadMark
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from supervisor.rules.rule_file import RuleFile
from trepid.config import CONFIG_DIR, InputError, Settings, load, located, parse, read
from trepid.types import NonNegative, Positive
from trepid.vehicle import Vehicle

SCENARIO_DIR = CONFIG_DIR / "scenarios"
ROAD_DIR = CONFIG_DIR / "roads"
RULES_FILE = CONFIG_DIR / "fear.yaml"
Problem = tuple[tuple[str | int, ...], str]
"""A field, as the way to it, and what is wrong with it."""


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
    """Where the vehicle is at t = 0, and how fast.

    A car that rolls at t = 0 has been driven there by a driver, who hands over to the supervisor at that moment.
    """

    station_m: float = 0.0
    offset_m: Annotated[float, Field(ge=-10, le=10)] = 0.0  # + = left of the lane centre
    heading_rad: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.0  # relative to the lane
    speed_mps: Annotated[float, Field(ge=0, le=60)] = 0.0
    drift_mps: float = 0.0  # lateral speed, + = to the left; turns the heading by asin(drift/speed)

    @model_validator(mode="after")
    def _drifts_slower_than_it_drives(self) -> Self:
        if abs(self.drift_mps) > 0.4 * self.speed_mps:
            raise ValueError(
                f"drift_mps {self.drift_mps:g} needs a speed_mps of {abs(self.drift_mps) / 0.4:g}"
            )
        return self

    @property
    def course_rad(self) -> float:
        """Heading relative to the lane, drift included."""
        return self.heading_rad + (math.asin(self.drift_mps / self.speed_mps) if self.drift_mps else 0.0)


class Sight(StrEnum):
    """What the estimators look at."""

    CAMERA = "camera"  # rendered pictures
    TRUTH = "truth"  # nothing is rendered; each of them knows the exact lane, see lockstep/oracle.py


class LeadSensor(StrEnum):
    """What tells the supervisor of the vehicle ahead."""

    CAMERA = "camera"  # the lead detector, from rendered pictures
    TRUTH = "truth"  # the exact place, as of a range sensor, see docs/scenarios.md
    MODELLED = (
        "modelled"  # the exact place with the errors of the camera's detector, see config/lead_model.yaml
    )


class CameraTiming(Settings):
    """When frames are taken and when their estimates are there."""

    rate_hz: Annotated[float, Field(gt=0, le=100)] = 25.0
    latency_s: NonNegative = 0.02  # capture to estimate; live median on two cores


_CHANGES: dict[str, Any] = {
    name: (hint | None, None)
    for name, hint in get_type_hints(Section, include_extras=True).items()
    if name in Section.model_fields and name not in ("name", "start_m")
}


class Appearance(create_model("SectionChanges", __base__=Settings, **_CHANGES)):  # type: ignore[misc]
    """What differs from the road's own sections, in all of them; absent: as the road has it."""


class Scenario(Settings):
    """One run, complete but for the seed."""

    name: str = ""  # default: the name of the file
    description: str
    tags: Annotated[tuple[Tag, ...], Field(min_length=1)]
    road: str  # a name in config/roads/, or a .yaml or .xodr (OpenDRIVE) file beside the scenario
    segments: tuple[Segment, ...] | None = None  # this line instead of the road's, as an open road
    marks: tuple[RoadMark, ...] | None = None  # instead of the road's; on a line of its own there are none
    junctions: tuple[Junction, ...] | None = None  # likewise
    lane_width_m: Annotated[float, Field(ge=2.0, le=6.0)] | None = None
    appearance: Appearance = Field(default_factory=Appearance)
    start: Start = Start()
    duration_s: Annotated[float, Field(gt=0, le=86_400)]  # at most; it also ends when the route is driven
    distance_m: Positive | None = None  # length of the route; default: one round, or to the end of the road
    camera: CameraTiming = CameraTiming()
    estimators: Annotated[tuple[str, ...], Field(min_length=1)] = ("cv", "cnn")
    sight: Sight = Sight.CAMERA
    lead_sensor: LeadSensor | None = None  # default: the camera, where there are pictures; else the truth
    rules: str | None = None  # a rule file beside the scenario; default: config/fear.yaml
    speed_mps: Positive | None = None  # that the driver sets; default: cruise_speed_mps of supervisor.yaml
    plant: PlantSettings = PlantSettings()  # how reality differs from config/vehicle.yaml
    disturbances: tuple[Disturbance, ...] = ()
    traffic: tuple[TrafficVehicle, ...] = ()
    faults: tuple[Fault, ...] = ()
    expect: Expect = Expect()
    vary: dict[str, Variation] = Field(default_factory=dict)  # what sampling changes; see scenarios/vary.py

    @model_validator(mode="after")
    def _faults_hit_something(self) -> Self:
        victims = {"camera", "supervisor", "controller", *self.estimators}
        if self.leads_by is LeadSensor.CAMERA:
            victims.add("lead")
        for fault in self.faults:
            victim = getattr(fault, "process", None) or getattr(fault, "estimator", None)
            if victim is not None and victim not in victims:
                raise ValueError(f"no process {victim!r}; there are {', '.join(sorted(victims))}")
        return self

    @model_validator(mode="after")
    def _pictures_for_the_detector(self) -> Self:
        if self.lead_sensor is LeadSensor.CAMERA and self.sight is Sight.TRUTH:
            raise ValueError("lead_sensor: camera needs pictures; with sight: truth there are none")
        return self

    @property
    def leads_by(self) -> LeadSensor:
        """What tells of the vehicle ahead."""
        pictures = LeadSensor.CAMERA if self.sight is Sight.CAMERA else LeadSensor.TRUTH
        return self.lead_sensor or pictures

    def build_road(self) -> Road:
        """The road as this scenario has it. Raises InputError."""
        settings = load_road_settings(self._road_file())
        try:
            return Road(disturbed(self._changed(settings), self.disturbances))
        except ValueError as error:
            raise InputError(f"scenario {self.name}: road {self.road}: {one_line(error)}") from error

    def _road_file(self) -> Path:
        return Path(self.road) if self.road.endswith(ROAD_SUFFIXES) else ROAD_DIR / f"{self.road}.yaml"

    @property
    def rules_file(self) -> Path:
        """The rule file that the supervisor drives by."""
        return RULES_FILE if self.rules is None else Path(self.rules)

    def _changed(self, settings: RoadSettings) -> RoadSettings:
        """``settings`` with what this scenario has instead. Raises ValueError where it does not fit together."""
        changes = {name: value for name, value in self.appearance if value is not None}
        sections = tuple(
            Section.model_validate({**dict(section), **changes}) for section in settings.sections
        )
        update: dict[str, object] = {"sections": sections}
        if self.lane_width_m is not None:
            update["lane_width_m"] = self.lane_width_m
        if self.segments is not None:
            line = {"segments": self.segments, "closed": False, "sections": sections[:1]}
            update |= {**line, "marks": (), "junctions": ()}
        update |= {
            name: given for name in ("marks", "junctions") if (given := getattr(self, name)) is not None
        }
        return RoadSettings.model_validate({**dict(settings), **update})

    def check(self) -> None:
        """Raise InputError when the scenario names what is not there, or does not fit together."""
        problem = self.problem()
        if problem:
            path, what = problem
            raise InputError(f"scenario {self.name}: {'.'.join(map(str, path))}: {what}")

    def problem(self) -> Problem | None:
        """The first thing that does not fit together: the field, and what is wrong with it; None when all does.

        Raises InputError when the file of the road is wrong.
        """
        for number, name in enumerate(self.estimators):
            if name not in ESTIMATORS and name not in estimators():
                return ("estimators", number), f"no estimator {name!r}; there are {', '.join(estimators())}"
            if name in self.estimators[:number]:
                return ("estimators", number), f"{name!r} is named twice"
        if not self.road.endswith(ROAD_SUFFIXES) and not self._road_file().is_file():
            roads = ", ".join(sorted(path.stem for path in ROAD_DIR.glob("*.yaml")))
            return ("road",), f"no road {self.road!r}; there are {roads}, or give a .yaml or .xodr file"
        settings = load_road_settings(self._road_file())
        try:
            length_m = Road(self._changed(settings)).length_m
        except ValueError as error:
            return (self._to_blame(error),), one_line(error)
        if not 0.0 <= self.start.station_m < length_m:
            return ("start", "station_m"), f"the road runs from 0 to {length_m:.1f} m"
        return self._problem_with_parts(settings)

    def _problem_with_parts(self, road: RoadSettings) -> Problem | None:
        if not self.rules_file.is_file():
            return ("rules",), f"no rule file {self.rules_file}"
        try:
            build_plant(self.plant, load(CONFIG_DIR / "vehicle.yaml", Vehicle))
        except InputError as error:
            return ("plant",), str(error).removeprefix("plant: ")
        for number, fault in enumerate(self.faults):
            if isinstance(fault, FrozenCamera | BlackFrames) and self.sight is Sight.TRUTH:
                return ("faults", number), f"{fault.kind}: with sight: truth there is no picture"
        known = self._names_in_conditions(road) if self.expect.conditions else {}
        for number, text in enumerate(self.expect.conditions):
            try:
                parse_condition(text).check(known)
            except ValueError as error:
                return ("expect", "conditions", number), str(error)
        return None

    @property
    def manoeuvres(self) -> list[str]:
        """The kinds of phases that other vehicles have."""
        return [phase.kind for vehicle in self.traffic for phase in vehicle.phases]

    def _names_in_conditions(self, road: RoadSettings) -> dict[str, Set[str]]:
        """The names that a condition may use, by kind."""
        sections = {section.name for section in road.sections}
        happenings = {fault.kind for fault in self.faults} | {*self.manoeuvres}
        happenings |= {disturbance.kind.value for disturbance in self.disturbances}
        views = (*self.estimators, "memory")
        fused = (group for n in range(1, len(views) + 1) for group in permutations(views, n))
        return {
            "event": sections | happenings,
            "section": sections,
            "estimator": {*self.estimators},
            "path_source": {*map("+".join, fused), "lead", "none"},
            "cause": load(self.rules_file, RuleFile).known_causes,
        }

    def _to_blame(self, error: ValueError) -> str:
        """The field of this scenario that an error of the road is about."""
        given = [
            n for n in ("marks", "junctions", "segments", "lane_width_m") if getattr(self, n) is not None
        ]
        named = [name for name in given if name.split("_")[0].rstrip("s") in str(error)]
        return next(iter(named or (["appearance"] if self.appearance.model_fields_set else given)), "road")

    def shortened(self, duration_s: float) -> "Scenario":
        """This scenario cut off after ``duration_s``, without the expectations that need the whole run."""
        if duration_s >= self.duration_s:
            return self
        return self.model_copy(update={"duration_s": duration_s, "expect": self.expect.shortened(duration_s)})

    def route_m(self, road: Road) -> float:
        """Length of the route [m]."""
        if self.distance_m is not None:
            return self.distance_m
        return road.length_m if road.closed else road.length_m - self.start.station_m


def list_scenarios() -> list[Scenario]:
    """The scenarios of ``config/scenarios/``, by name. Raises InputError."""
    return [load_scenario(path.stem, check=False) for path in sorted(SCENARIO_DIR.glob("*.yaml"))]


def load_scenario(source: str, overrides: Mapping[str, str] | None = None, *, check: bool = True) -> Scenario:
    """The scenario called ``source``, or in the YAML file ``source``.

    Raises InputError with file:line:column; without ``check`` only for what the file itself shows.
    """
    path = Path(source)
    if path.suffix not in (".yaml", ".yml"):
        path = SCENARIO_DIR / f"{source}.yaml"
        if not path.is_file():
            names = ", ".join(sorted(p.stem for p in SCENARIO_DIR.glob("*.yaml")))
            raise InputError(f"no scenario {source!r}; there are {names}, or give a .yaml or .py file")
    data = read(path)
    scenario = parse(data, Scenario, source=path, overrides=overrides)
    update = {"name": scenario.name or path.stem}
    if scenario.road.endswith(ROAD_SUFFIXES):
        update["road"] = str(_beside("road", path, overrides) / scenario.road)
    if scenario.rules is not None:
        update["rules"] = str(_beside("rules", path, overrides) / scenario.rules)
    scenario = scenario.model_copy(update=update)
    check_vary(scenario, scenario.vary, data, path, misfit=_misfit if check else None)
    problem = scenario.problem() if check else None
    if problem:
        raise InputError(located(*problem, data, path, overrides or {}))
    return scenario


def _beside(field: str, path: Path, overrides: Mapping[str, str] | None) -> Path:
    """The folder that a relative path in ``field`` starts from: the scenario's, or where an override was typed."""
    return Path() if overrides and field in overrides else path.parent


def _misfit(scenario: Scenario) -> str:
    """What does not fit together, in a line; empty when all does."""
    problem = scenario.problem()
    return f"{'.'.join(map(str, problem[0]))}: {problem[1]}" if problem else ""


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
        raise InputError(f"{path}:{_script_line(error, path)}: {one_line(error)}") from error
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


def one_line(error: Exception) -> str:
    """One line for an error of pydantic or of a script."""
    if isinstance(error, ValidationError):
        problem = error.errors()[0]
        return ": ".join([".".join(map(str, problem["loc"])), problem["msg"]]).removeprefix(": ")
    return " ".join(str(error).split()) or type(error).__name__
