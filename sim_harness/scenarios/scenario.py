"""Scenarios: the start of a run, its disturbances and faults, and the criteria that it must satisfy.

A scenario is a YAML file (``config/scenarios/*.yaml``) or a Python script that assigns a :class:`Scenario`, or a
list of them, to the variable ``scenarios``.
"""

import math
import runpy
import traceback
from collections.abc import Mapping, Set
from enum import StrEnum
from functools import lru_cache
from itertools import permutations
from pathlib import Path
from typing import Annotated, Any, Self, get_type_hints

from pydantic import Field, ValidationError, create_model, model_validator

from perception.estimators import ESTIMATORS, estimators, no_estimator
from sim_harness.judging.conditions.expect import Expect
from sim_harness.judging.conditions.meaning import parse_condition
from sim_harness.scenarios.faults import BlackFrames, Fault, FrozenCamera, LostProcess
from sim_harness.scenarios.road_users import RoadUser, UserSensor
from sim_harness.scenarios.traffic import TrafficVehicle
from sim_harness.scenarios.vary import Variation, check_vary
from sim_harness.scenarios.world_choice import WorldChoice
from sim_harness.world.plants.build import build_plant
from sim_harness.world.plants.settings import PlantSettings
from sim_harness.world.road_file import ROAD_SUFFIXES, load_road_settings
from sim_harness.world.roads.appearance import LaneWidth, Section
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind, disturb
from sim_harness.world.roads.elevation import BankPoint, ElevationPoint
from sim_harness.world.roads.features import Junction, RoadMark, SpeedHump, Wall
from sim_harness.world.roads.road import Road, RoadSettings, Segment
from supervisor.rules.rule_file import RuleFile
from trepid.car.vehicle import Vehicle
from trepid.config import (
    CONFIG_DIR,
    InputError,
    Settings,
    default_file,
    default_names,
    fault_line,
    json_schema,
    load,
    parse,
    read,
    read_text,
    wrong_at,
)
from trepid.scale import PUBLIC_LANE_M, given_fields
from trepid.spelling import did_you_mean, did_you_mean_or_list
from trepid.types import NonNegative, Positive

SCHEMA_FILE = CONFIG_DIR / "schema" / "scenario.json"
"""The output of ``trepid sim schema``; scenario files name it in their first line, for YAML plug-ins of editors."""
Problem = tuple[tuple[str | int, ...], str]
"""The path of a field, and the error message for it."""


class Tag(StrEnum):
    """Subject of a shipped scenario; scenarios of users may have further tags."""

    NOMINAL = "nominal"
    CURVE = "curve"
    UNMARKED = "unmarked"
    ILLUMINATION = "illumination"
    WEATHER = "weather"
    MARKING = "marking"
    TRAFFIC = "traffic"
    PEOPLE = "people"
    FAULT = "fault"
    LATENCY = "latency"
    SPEED = "speed"
    HEIGHT = "height"


TagName = Annotated[
    str,
    Field(
        pattern="^[a-z][a-z0-9_-]*$",
        json_schema_extra={"anyOf": [{"enum": [*Tag]}, {}]},  # for completion in editors
    ),
]
SLOWEST_START_MPS = 0.1
_ALONG = ("marks", "humps", "junctions", "walls", "elevation", "bank")
"""Features along the road, which a scenario may replace."""


class Start(Settings):
    """Position and speed of the vehicle at t = 0.

    With a speed above 0 a driver drives up to t = 0 and then hands over to the supervisor.
    """

    station_m: float = 0.0
    offset_m: Annotated[float, Field(ge=-10, le=10)] = 0.0  # + = left of the lane centre
    heading_rad: Annotated[float, Field(gt=-0.5, lt=0.5)] = 0.0  # relative to the lane
    speed_mps: Annotated[float, Field(ge=0, le=60)] = 0.0
    drift_mps: float = 0.0  # lateral speed, + = to the left; turns the heading by asin(drift/speed)

    @model_validator(mode="after")
    def _drifts_slower_than_it_drives(self) -> Self:
        if 0.0 < self.speed_mps < SLOWEST_START_MPS:
            raise wrong_at(("speed_mps",), f"expected 0 or at least {SLOWEST_START_MPS} m/s")
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
    """Input of the estimators."""

    CAMERA = "camera"  # rendered images
    TRUTH = "truth"  # the exact lane, without rendering, see lockstep/oracle.py


class LeadSensor(StrEnum):
    """Source of the vehicle ahead."""

    CAMERA = "camera"  # the lead detector, from rendered images
    TRUTH = "truth"  # the exact distance of a range sensor, see docs/scenarios.md
    MODELLED = "modelled"  # the exact distance with the errors of the detector, see config/lead_model.yaml


class CameraTiming(Settings):
    """Frame rate and latency of the perception."""

    rate_hz: Annotated[float, Field(gt=0, le=100)] = 25.0
    latency_s: NonNegative = 0.02  # capture to estimate; live median on two cores


_CHANGES: dict[str, Any] = {
    name: (hint | None, None)
    for name, hint in get_type_hints(Section, include_extras=True).items()
    if name in Section.model_fields and name not in ("name", "start_m")
}


class Appearance(create_model("SectionChanges", __base__=Settings, **_CHANGES)):  # type: ignore[misc]
    """Changes to all sections of the road; absent: as in the road file."""


class Scenario(Settings):
    """One run, complete except for the seed."""

    name: str = ""  # default: the name of the file
    description: str
    tags: Annotated[tuple[TagName, ...], Field(min_length=1)]
    # A name in roads/ (car, config), or a .yaml or .xodr (OpenDRIVE) file in the folder of the scenario.
    road: str = ""
    world: WorldChoice | None = None  # of another package instead of a road, its pictures and a plant
    segments: tuple[Segment, ...] | None = None  # reference line instead of the road's, as an open road
    marks: tuple[RoadMark, ...] | None = None  # instead of the road's; default with `segments`: none
    humps: tuple[SpeedHump, ...] | None = None  # as `marks`
    junctions: tuple[Junction, ...] | None = None  # as `marks`
    walls: tuple[Wall, ...] | None = None  # as `marks`
    elevation: tuple[ElevationPoint, ...] | None = None  # as `marks`
    bank: tuple[BankPoint, ...] | None = None  # as `marks`
    lane_width_m: LaneWidth | None = None
    appearance: Appearance = Field(default_factory=Appearance)
    start: Start = Start()
    duration_s: Annotated[float, Field(ge=0.1, le=86_400)]  # at most; it also ends when the route is driven
    distance_m: Positive | None = None  # length of the route; default: one round, or to the end of the road
    camera: CameraTiming = CameraTiming()
    estimators: Annotated[tuple[str, ...], Field(min_length=1)] = ("cv", "cnn")
    networks: dict[str, str] = Field(
        default_factory=dict
    )  # name of an estimator -> file of its driving network
    sight: Sight = Sight.CAMERA
    lead_sensor: LeadSensor | None = None  # default: camera with sight: camera, else truth
    road_user_sensor: UserSensor | None = None  # likewise
    rules: str | None = None  # a rule file in the folder of the scenario; default: config/fear.yaml
    speed_mps: Positive | None = None  # set speed; default: cruise_speed_mps of supervisor.yaml
    plant: PlantSettings = PlantSettings()  # deviations from config/vehicle.yaml
    disturbances: tuple[Disturbance, ...] = ()
    traffic: tuple[TrafficVehicle, ...] = ()
    road_users: tuple[RoadUser, ...] = ()  # people, cyclists and animals
    faults: tuple[Fault, ...] = ()
    expect: Expect = Expect()
    vary: dict[str, Variation] = Field(default_factory=dict)  # parameters of sampling; see scenarios/vary.py

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
    def _images_for_the_detector(self) -> Self:
        for name in ("lead_sensor", "road_user_sensor"):
            if self.sight is Sight.TRUTH and getattr(self, name) == "camera":
                raise ValueError(f"{name}: camera needs images; with sight: truth there are none")
        return self

    @property
    def leads_by(self) -> LeadSensor:
        """The source of the vehicle ahead, with the default resolved: in a world of another package none."""
        seen = self.sight is Sight.CAMERA and self.world is None
        default = LeadSensor.CAMERA if seen else LeadSensor.TRUTH
        return self.lead_sensor or default

    @property
    def road_users_by(self) -> UserSensor:
        """The source of the road users, with the default resolved."""
        seen = self.sight is Sight.CAMERA and self.world is None
        default = UserSensor.CAMERA if seen else UserSensor.TRUTH
        return self.road_user_sensor or default

    def build_road(self) -> Road:
        """The road with the changes of this scenario. Raises InputError."""
        settings = load_road_settings(self._road_file())
        try:
            return Road(disturb(self._change_road(settings), self.disturbances))
        except ValueError as error:
            raise InputError(f"scenario {self.name}: road {self.road}: {one_line(error)}") from error

    def _road_file(self) -> Path:
        return (
            Path(self.road) if self.road.endswith(ROAD_SUFFIXES) else default_file(f"roads/{self.road}.yaml")
        )

    @property
    def rules_file(self) -> Path:
        """The rule file of the supervisor."""
        return default_file("fear.yaml") if self.rules is None else Path(self.rules)

    def _change_road(self, settings: RoadSettings) -> RoadSettings:
        """``settings`` with the changes of this scenario. Raises ValueError for values that exclude each other."""
        changes = {name: value for name, value in self.appearance if value is not None}
        sections = tuple(
            Section.model_validate({**given_fields(section), **changes}) for section in settings.sections
        )
        update: dict[str, object] = {"sections": sections}
        if self.lane_width_m is not None:
            update["lane_width_m"] = self.lane_width_m
        if self.segments is not None:
            line = {"segments": self.segments, "closed": False, "sections": sections[:1]}
            update |= {**line, **dict.fromkeys(_ALONG, ())}
        update |= {name: given for name in _ALONG if (given := getattr(self, name)) is not None}
        return RoadSettings.model_validate({**given_fields(settings), **update})

    def check(self) -> None:
        """Raise InputError for an unknown name or for values that exclude each other."""
        problem = _misfit(self)
        if problem:
            raise InputError(f"scenario {self.name}: {problem}")

    def problem(self) -> Problem | None:
        """The first unknown name or contradiction: the field and the message; None for a valid scenario.

        Raises InputError for an invalid road or vehicle file.
        """
        problem = self._problem_with_estimators()
        if problem:
            return problem
        if self.world is not None:
            return self.world.problem_beside(self) or self._problem_with_parts(None, None)
        return self._problem_with_road()

    def _problem_with_road(self) -> Problem | None:
        if not self.road:
            return ("road",), "a scenario needs a road, or a `world` of another package"
        if not self.road.endswith(ROAD_SUFFIXES) and not self._road_file().is_file():
            hint = did_you_mean(self.road, default_names("roads"))
            return ("road",), f"no road {self.road!r}; {hint} (or a .yaml or .xodr file)"
        settings = load_road_settings(self._road_file())
        try:
            road = Road(self._change_road(settings))
        except ValueError as error:
            return (self._field_of(error),), one_line(error)
        if not 0.0 <= self.start.station_m < road.length_m:
            return ("start", "station_m"), f"the road runs from 0 to {road.length_m:.1f} m"
        for number, disturbance in enumerate(self.disturbances):
            if disturbance.kind is DisturbanceKind.TUNNEL_EXIT and not road.flat:
                return (
                    "disturbances",
                    number,
                ), "a tunnel needs a flat road, and this one has an elevation or a bank"
        return self._problem_with_parts(settings, road)

    def _problem_with_estimators(self) -> Problem | None:
        for name, file in self.networks.items():
            if name not in self.estimators:
                return ("networks", name), f"no estimator of the scenario is called {name!r}"
            if not Path(file).is_file():
                return ("networks", name), f"no file {file}"
        for number, name in enumerate(self.estimators):
            if name not in self.networks and name not in ESTIMATORS and name not in estimators():
                return ("estimators", number), no_estimator(name, estimators())
            if name in self.estimators[:number]:
                return ("estimators", number), f"{name!r} is named twice"
        return None

    def _problem_with_parts(self, settings: RoadSettings | None, road: Road | None) -> Problem | None:
        """Both are None in a world of another package."""
        if not self.rules_file.is_file():
            return ("rules",), f"no rule file {self.rules_file}"
        others = "traffic" if self.traffic else "road_users" if self.road_users else ""
        if settings is not None and others and (self.lane_width_m or settings.lane_width_m) < PUBLIC_LANE_M:
            return (others,), "other vehicles are those of public roads, and these lanes are of models"
        problem = _problem_with_plant(self.plant, road)
        if problem:
            return problem
        for number, fault in enumerate(self.faults):
            if isinstance(fault, FrozenCamera | BlackFrames) and self.sight is Sight.TRUTH:
                return ("faults", number), f"{fault.kind}: with sight: truth there is no image"
        known = self._names_in_conditions(settings) if self.expect.conditions else {}
        for number, text in enumerate(self.expect.conditions):
            try:
                parse_condition(text).check(known)
            except ValueError as error:
                return ("expect", "conditions", number), str(error)
        return None

    def lost_processes(self, elapsed_s: float) -> set[str]:
        """The processes that a fault stops now."""
        faults = (fault for fault in self.faults if isinstance(fault, LostProcess))
        return {fault.process for fault in faults if fault.active(elapsed_s)}

    @property
    def manoeuvres(self) -> list[str]:
        """The kinds of phases that other vehicles and road users have."""
        vehicles = [phase.kind for vehicle in self.traffic for phase in vehicle.phases]
        return [*vehicles, *(phase.kind for user in self.road_users for phase in user.phases)]

    def _names_in_conditions(self, road: RoadSettings | None) -> dict[str, Set[str]]:
        """The names that a condition may use, by kind; the sections of a world of another package are not known."""
        sections = {section.name for section in road.sections} if road is not None else set()
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

    def _field_of(self, error: ValueError) -> str:
        """The field of this scenario that caused an error of the road."""
        given = [n for n in (*_ALONG, "segments", "lane_width_m") if getattr(self, n) is not None]
        named = [name for name in given if name.split("_")[0].rstrip("s") in str(error)]
        return next(iter(named or (["appearance"] if self.appearance.model_fields_set else given)), "road")

    def shorten(self, duration_s: float) -> "Scenario":
        """This scenario cut off after ``duration_s``, without the expectations that need the whole run."""
        if duration_s >= self.duration_s:
            return self
        return self.model_copy(update={"duration_s": duration_s, "expect": self.expect.shorten(duration_s)})

    def route_m(self, road: Road) -> float:
        """Length of the route [m]."""
        if self.distance_m is not None:
            return self.distance_m
        return road.length_m if road.closed else road.length_m - self.start.station_m


def _problem_with_plant(settings: PlantSettings, road: Road | None) -> Problem | None:
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    try:
        plant = build_plant(settings, vehicle)
    except InputError as error:
        return ("plant",), str(error).removeprefix("plant: ")
    if road is not None and road.bank is not None and not plant.LEANS:
        return ("plant", "model"), f"model {str(settings.model)!r} does not simulate a banked road"
    return None


def scenario_schema() -> str:
    """The JSON schema of scenario files, as text."""
    return json_schema(Scenario, "Trepid scenario")


def list_scenarios() -> list[Scenario]:
    """The scenarios of ``config/scenarios/`` and of the car, by name. Raises InputError."""
    paths = (default_file(f"scenarios/{name}.yaml") for name in default_names("scenarios"))
    return [_scenario_of(path, read_text(path)) for path in paths]


@lru_cache(maxsize=512)
def _scenario_of(path: Path, _: str) -> Scenario:
    """By content, because a sweep over tags lists all scenarios more than once."""
    return load_scenario(str(path), check=False)


def load_scenario(source: str, overrides: Mapping[str, str] | None = None, *, check: bool = True) -> Scenario:
    """The scenario called ``source``, or in the YAML file ``source``.

    A relative path in it begins at the folder of the file, in ``overrides`` at the working folder. Without
    ``check`` only syntax and types are checked. Raises InputError with file:line:column.
    """
    path = Path(source)
    if path.suffix not in (".yaml", ".yml"):
        path = default_file(f"scenarios/{source}.yaml")
        if not path.is_file():
            names = default_names("scenarios")
            hint = did_you_mean_or_list(source, names, "trepid sim list")
            raise InputError(f"no scenario {source!r}; {hint}, or give a .yaml or .py file")
    data = read(path)
    whole_s = data.get("duration_s")
    scenario = parse(data, Scenario, source=path, overrides=overrides)
    if overrides and isinstance(whole_s, float | int) and scenario.duration_s < whole_s:
        scenario = _cut_duration(scenario, overrides)
    update: dict[str, object] = {"name": scenario.name or path.stem}
    for field, file in (("road", scenario.road), ("rules", scenario.rules)):
        if file is not None and (field == "rules" or file.endswith(ROAD_SUFFIXES)):
            given = overrides is not None and field in overrides
            update[field] = str((Path() if given else path.parent) / file)
    given = any(field.partition(".")[0] == "networks" for field in overrides or ())
    folder = Path() if given else path.parent
    update["networks"] = {name: str(folder / file) for name, file in scenario.networks.items()}
    scenario = scenario.model_copy(update=update)
    problem = scenario.problem() if check else None
    if problem:
        raise InputError(fault_line(*problem, data, path, overrides))
    check_vary(scenario, scenario.vary, data, path, misfit=_misfit if check else None)
    return scenario


def _cut_duration(scenario: Scenario, overrides: Mapping[str, str]) -> Scenario:
    """``scenario`` without the expectations that need its whole duration, except those among ``overrides``."""
    given = {key.split(".")[1] for key in overrides if key.startswith("expect.")}
    kept = {field: getattr(scenario.expect, field) for field in given}
    expect = scenario.expect.shorten(scenario.duration_s).model_copy(update=kept)
    return scenario.model_copy(update={"expect": expect})


def _misfit(scenario: Scenario) -> str:
    """The first problem in one line; empty for a valid scenario."""
    problem = scenario.problem()
    return f"{'.'.join(map(str, problem[0]))}: {problem[1]}" if problem else ""


def load_scenarios(source: str, overrides: Mapping[str, str] | None = None) -> list[Scenario]:
    """All scenarios of ``source``: a name, a YAML file, or a Python script. Raises InputError."""
    if Path(source).suffix != ".py":
        return [load_scenario(source, overrides)]
    if overrides:
        raise InputError(f"{source}: --set changes YAML scenarios; a script sets its own values")
    path = Path(source)
    if not path.is_file():
        raise InputError(f"{path}: cannot be read: no such file")
    try:
        found = runpy.run_path(str(path)).get("scenarios")
    except Exception as error:
        raise InputError(f"{path}:{_script_line(error, path)}: {one_line(error)}") from error
    listed = [found] if isinstance(found, Scenario) else list(found or [])
    if not listed or not all(isinstance(scenario, Scenario) for scenario in listed):
        raise InputError(f"{path}: must assign a Scenario or a list of them to the variable `scenarios`")
    return [
        scenario if scenario.name else scenario.model_copy(update={"name": f"{path.stem}.{number}"})
        for number, scenario in enumerate(listed)
    ]


def _script_line(error: Exception, path: Path) -> int:
    """The innermost line of the script in the traceback."""
    if isinstance(error, SyntaxError):
        return error.lineno or 1
    frames = traceback.extract_tb(error.__traceback__)
    return ([1] + [frame.lineno or 1 for frame in frames if frame.filename == str(path)])[-1]


def one_line(error: Exception) -> str:
    """One line for an error of pydantic or of a script."""
    if isinstance(error, ValidationError):
        problem = error.errors()[0]
        return ": ".join([".".join(map(str, problem["loc"])), problem["msg"]]).removeprefix(": ")
    return " ".join(str(error).split()) or type(error).__name__
