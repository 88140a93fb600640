"""The table of estimators for `--estimator NAME` and the perception process.

Each estimator is imported when it is built: a process of a car loads its own one only (ONNX Runtime alone takes
0.2 s and 40 MB), and nothing of what serves footage without a camera file.
"""

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from trepid.car.camera import Camera
from trepid.car.vehicle import Corridor, Vehicle
from trepid.config import CONFIG_DIR, InputError, load, resource
from trepid.messages import EstimateKind, Frame, SteeringEstimate, VehicleState
from trepid.scale import ReferenceWorld, scaled_settings
from trepid.spelling import did_you_mean_or_list

if TYPE_CHECKING:
    from perception.camera.odometry import StateOdometry
    from perception.lane.settings import LaneCvSettings
    from perception.lane.which_lane import WhichLane

NETWORK_SUFFIX = ".onnx"
_PIPELINE = ("perception.techniques.pipeline", "perception.techniques.recipe")
NAME = r"[A-Za-z][\w-]*"  # of a driving network, and so of topics


class Estimator(Protocol):
    """Measures the lane, or a steering angle, in a frame. Its only state comes from earlier steps."""

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The estimate of ``frame``; all None with a reason where nothing was found."""
        ...


class ScaledEstimator:
    """An estimator of the reference world (:mod:`trepid.scale`) in a world ``scale`` times as large."""

    def __init__(self, estimator: Estimator, scale: float) -> None:
        """``estimator`` was built for the camera and the vehicle enlarged to the reference world."""
        self._estimator, self._reference = estimator, ReferenceWorld(scale)

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """The estimate of ``frame`` with lengths of the car's own world.

        A proposed speed is that of the driver of such a car: it is in this world already.
        """
        estimate = self._estimator.step(frame, self._reference.enlarge("state", state), now_s=now_s)
        return replace(self._reference.restore(estimate), speed_mps=estimate.speed_mps)


@dataclass(frozen=True, slots=True)
class Unfit:
    """In place of an estimator that is not made for the camera or the vehicle: no estimate of any frame."""

    name: str
    why: str

    def step(self, frame: Frame, state: VehicleState | None, *, now_s: float) -> SteeringEstimate:
        """Nothing, and the reason."""
        return SteeringEstimate.nothing(frame.t_s, estimator=self.name, lookahead_m=0.0, reason=self.why)


@dataclass(frozen=True, slots=True)
class Entry:
    """The description, constructor and source of an estimator."""

    description: str
    construct: Callable[[Camera, Vehicle], Estimator]  # for a camera and vehicle of the reference world
    source: str
    kind: EstimateKind = EstimateKind.LANE
    stages: tuple[str, ...] = ()  # of a pipeline
    # takes its place where it is not made for a camera and vehicle of their own world. Raises InputError
    misfit: Callable[[Camera, Vehicle], Unfit | None] | None = None
    # for a self-calibrated camera; None: `construct` takes it as if it were known
    construct_assumed: "Callable[[Camera, Vehicle, WhichLane], Estimator] | None" = None
    is_here: Callable[[], bool] = lambda: True  # whether the files that it needs are on this machine
    # on which its estimates depend, for results that are kept: modules with all that they import, files and
    # folders of the repository, and anything else, as text
    modules: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    version: Callable[[], str] = lambda: ""

    def build(
        self,
        camera: Camera,
        vehicle: Vehicle,
        *,
        assumed: bool = False,
        finder: "WhichLane | None" = None,
    ) -> Estimator:
        """The estimator for ``camera`` on ``vehicle``, in the scale of its lanes.

        ``assumed``: the camera is self-calibrated, so its height is a guess. ``finder``: the lane finder of an
        assumed camera that other estimators of the same frames use too; by default one of its own, which measures
        no camera by odometry.
        One that is not made for them estimates nothing and gives the reason. Raises InputError.
        """
        if self.misfit is not None and (unfit := self.misfit(camera, vehicle)):
            return unfit
        eye, reference = _in_reference_world(camera, vehicle)
        if assumed and self.construct_assumed:
            finder = finder or lane_finder(camera, vehicle)
            estimator = self.construct_assumed(eye, reference, finder)
        else:
            estimator = self.construct(eye, reference)
        return estimator if vehicle.scale == 1.0 else ScaledEstimator(estimator, vehicle.scale)


def _in_reference_world(camera: Camera, vehicle: Vehicle) -> tuple[Camera, Vehicle]:
    """Both, enlarged to the reference world; the same at a scale of 1."""
    return scaled_settings(camera, 1 / vehicle.scale), vehicle.in_reference_world


def lane_finder(camera: Camera, vehicle: Vehicle, odometry: "StateOdometry | None" = None) -> "WhichLane":
    """The lane finder of a self-calibrated ``camera``, for :meth:`Entry.build`; without odometry by default."""
    from perception.camera.odometry import StateOdometry
    from perception.lane.which_lane import WhichLane

    odometry = odometry or StateOdometry.NONE
    return WhichLane(lane_cv_settings(), *_in_reference_world(camera, vehicle), odometry)


def build_beside(
    names: Iterable[str], camera: Camera, vehicle: Vehicle, *, assumed: bool, odometry: "StateOdometry"
) -> dict[str, Estimator]:
    """Estimators of the same frames, by name or by file of a driving network.

    Those of an ``assumed`` camera share one lane finder, whose camera ``odometry`` in the vehicle states measures.
    Raises InputError.
    """
    finder = lane_finder(camera, vehicle, odometry) if assumed else None
    return {
        name_of(name): entry_of(name).build(camera, vehicle, assumed=assumed, finder=finder) for name in names
    }


def lane_cv_settings() -> "LaneCvSettings":
    """``config/perception.yaml``. Raises InputError."""
    from perception.lane.settings import LaneCvSettings

    return load(CONFIG_DIR / "perception.yaml", LaneCvSettings)


def _lane_cv(camera: Camera, vehicle: Vehicle) -> Estimator:
    if vehicle.corridor is Corridor.ROAD:
        from perception.lane.road_middle import RoadMiddle

        return RoadMiddle(lane_cv_settings(), camera, vehicle)
    from perception.lane.lane_cv import LaneCv

    return LaneCv(lane_cv_settings(), camera, vehicle)


def _lane_cv_assumed(camera: Camera, vehicle: Vehicle, finder: "WhichLane") -> Estimator:
    if vehicle.corridor is Corridor.ROAD:
        raise InputError("corridor: road of vehicle.yaml needs a camera file: only it gives widths in metres")
    return finder


def _lane_alone(name: str, camera: Camera, vehicle: Vehicle) -> Unfit | None:
    """In place of an estimator that measures no middle of a road, where the car drives along it."""
    if vehicle.corridor is Corridor.LANE:
        return None
    return Unfit(
        name, f"{name} does not measure the middle of the road (corridor: road of vehicle.yaml); cv does"
    )


def _steer_net(camera: Camera, vehicle: Vehicle) -> Estimator:
    from perception.net.steer_net import SteerNet, SteerNetSettings

    return SteerNet(load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings), camera, vehicle)


def _steer_net_assumed(camera: Camera, vehicle: Vehicle, finder: "WhichLane") -> Estimator:
    from perception.net.confirmed import ConfirmedNet
    from perception.net.steer_net import SteerNet, SteerNetSettings

    settings = load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings)
    network = SteerNet(settings, camera, vehicle, assumed=True)
    return ConfirmedNet(network, finder, vehicle)


def _steer_net_misfit(camera: Camera, vehicle: Vehicle) -> Unfit | None:
    from perception.net.steer_net import NAME, SteerNetSettings, misfit

    if unfit := _lane_alone(NAME, camera, vehicle):
        return unfit
    why = misfit(load(CONFIG_DIR / "steer_net.yaml", SteerNetSettings), camera, vehicle)
    return Unfit(NAME, why) if why else None


def _segments(camera: Camera, vehicle: Vehicle) -> Estimator:
    from perception.segments.estimator import build

    return build(camera, vehicle, lane_cv_settings())


def _segments_assumed(camera: Camera, vehicle: Vehicle, finder: "WhichLane") -> Estimator:
    from perception.segments.unknown_camera import build

    return build(vehicle, lane_cv_settings())


def _tape_lane(camera: Camera, vehicle: Vehicle) -> Estimator:
    from perception.tape.estimator import TapeLane
    from perception.tape.settings import TapeSettings

    line_m = lane_cv_settings().markings.width_m
    return TapeLane(load(CONFIG_DIR / "tape.yaml", TapeSettings), line_m, camera, vehicle)


def _has_segments() -> bool:
    from perception.segments.settings import network_file, segment_settings

    try:
        return network_file(segment_settings()).is_file()
    except InputError:
        return False


def _segments_version() -> str:
    """The hash of the fetched network. Raises InputError."""
    from perception.segments.settings import network_file, segment_settings

    return sha256(network_file(segment_settings()).read_bytes()).hexdigest()


ESTIMATORS = {
    "cv": Entry(
        "lane lines or road edges, robust clothoid fit, Kalman tracking",
        _lane_cv,
        source="Trepid; config/perception.yaml",
        construct_assumed=_lane_cv_assumed,
        modules=("perception.lane.lane_cv",),
        files=("config/perception.yaml",),
    ),
    "cnn": Entry(
        "PilotNet-sized network from pixels to lane state with its own uncertainty",
        _steer_net,
        source="R [87] and later; config/steer_net.yaml",
        misfit=_steer_net_misfit,
        construct_assumed=_steer_net_assumed,
        modules=("perception.net.steer_net",),
        files=("config/steer_net.yaml", "config/perception.yaml", "perception/weights"),
    ),
}
"""The estimators of the default drive; :func:`estimators` adds those that a car may choose, and the pipelines."""

FURTHER = {
    "segments": Entry(
        "lane between the boundaries that a fetched segmentation network marks (lines, drivable area)",
        _segments,
        source="config/segments.yaml, docs/segments.md",
        misfit=partial(_lane_alone, "segments"),
        construct_assumed=_segments_assumed,
        is_here=_has_segments,
        modules=("perception.segments.estimator", "perception.segments.unknown_camera"),
        files=("config/perception.yaml", "config/segments.yaml", "config/networks"),
        version=_segments_version,
    ),
    "tape": Entry(
        "lane between lines of tape of any colour, by length, for bends as tight as the lane is wide",
        _tape_lane,
        source="config/tape.yaml, docs/rc.md",
        misfit=partial(_lane_alone, "tape"),
        modules=("perception.tape.estimator",),
        files=("config/tape.yaml", "config/perception.yaml"),
    ),
}
"""Estimators that a car may choose: for real streets, by a network that Trepid does not ship; for tape."""


def estimators() -> dict[str, Entry]:
    """Every estimator by name: ``ESTIMATORS``, ``FURTHER``, the pipelines, and those of other packages.

    The pipelines are those of ``config/pipelines.yaml``. Raises InputError.
    """
    # Imported here: the stages take 0.4 s, which ESTIMATORS do not need.
    from perception.techniques.pipeline import Pipeline
    from perception.techniques.recipe import recipes

    pipelines = {
        name: Entry(
            recipe.description,
            partial(Pipeline, recipe),
            source=recipe.source,
            kind=recipe.kind,
            misfit=partial(_lane_alone, name),
            stages=tuple(stage.name for stage in recipe.stages),
            modules=(*_PIPELINE, *(stage.entry.__module__ for stage in recipe.stages)),
            files=("config/perception.yaml",),
            version=recipe.version,
        )
        for name, recipe in recipes().items()
    }
    return _of_other_packages() | ESTIMATORS | FURTHER | pipelines


def estimators_here() -> dict[str, Entry]:
    """Those of :func:`estimators` whose files are on this machine. Raises InputError."""
    return {name: entry for name, entry in estimators().items() if entry.is_here()}


def _of_other_packages() -> dict[str, Entry]:
    """Estimators of the entry points ``trepid.estimators``, each imported when it is built."""
    from trepid import plugins

    return {
        name: Entry(
            f"added by the package {point.dist.name if point.dist else '?'}",
            partial(_build_added, name),
            source=point.value,
            misfit=partial(_lane_alone, name),
            version=partial(str, f"{point.value} {point.dist.version if point.dist else '?'}"),
        )
        for name, point in plugins.added_entry_points(plugins.Group.ESTIMATORS).items()
    }


def _build_added(name: str, camera: Camera, vehicle: Vehicle) -> Estimator:
    from trepid import plugins

    make = plugins.part(plugins.Group.ESTIMATORS, name, {})
    with plugins.beginning(plugins.Group.ESTIMATORS, name):
        found: Estimator = make(camera, vehicle)
    return found


def name_of(designation: str) -> str:
    """The name of an estimator that is given by its name or by the file of a driving network (``.onnx``).

    The name of a driving network is that of its file without the suffix. Raises InputError where that is no name,
    or the name of another estimator.
    """
    if not designation.endswith(NETWORK_SUFFIX):
        return designation
    name = Path(designation).stem
    if not re.fullmatch(NAME, name):
        raise InputError(
            f"{designation}: {name!r} cannot be the name of an estimator: rename the file, to a letter and then"
            " letters, digits, - or _"
        )
    _check_free(name, designation)
    return name


def _check_free(name: str, file: str) -> None:
    """Raise InputError where a driving network would have the name of another estimator."""
    if name in ESTIMATORS | FURTHER or name in estimators():
        raise InputError(f"{file}: {name!r} is the name of another estimator; rename the driving network")


def network_entry(name: str, file: Path) -> Entry:
    """The driving network in ``file`` as the estimator called ``name``. Raises InputError."""
    from perception.net.driver import DriverNetwork, DrivingEstimator

    network = DriverNetwork(file)
    return Entry(
        f"driving network {network.record.model}",
        lambda _, vehicle: DrivingEstimator(name, network, vehicle),
        source=str(file),
        kind=EstimateKind.ANGLE,
        modules=("perception.net.driver",),
        files=("config/perception.yaml",),
        version=lambda: sha256(file.read_bytes()).hexdigest(),
    )


def entry_of(name: str) -> Entry:
    """The estimator called ``name``, or the driving network in the file ``name``. Raises InputError with a remedy.

    ``ESTIMATORS`` do not depend on the file of the pipelines.
    """
    if name.endswith(NETWORK_SUFFIX):
        return network_entry(name_of(name), Path(name))
    own = ESTIMATORS | FURTHER
    known = own if name in own else estimators()
    if name not in known:
        raise InputError(no_estimator(name, known))
    return known[name]


def no_estimator(name: str, known: Iterable[str]) -> str:
    """The error text for ``name``, which is not in ``known``, with the nearest names."""
    return f"no estimator {name!r}; {did_you_mean_or_list(name, known, 'trepid estimate --estimator list')}"


def misfits() -> dict[str, str]:
    """Name and reason of each of ``ESTIMATORS`` that is not made for the configured camera and vehicle.

    Raises InputError.
    """
    camera, vehicle = load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    unfit = [entry.misfit(camera, vehicle) for entry in ESTIMATORS.values() if entry.misfit]
    return {one.name: one.why for one in unfit if one}


def build(
    name: str,
    *,
    network: str | None = None,
    camera: Path = CONFIG_DIR / "camera.yaml",
    vehicle: Path = CONFIG_DIR / "vehicle.yaml",
) -> Estimator:
    """The estimator called ``name`` for a drive with the camera and vehicle of the files.

    ``network`` is the file of a driving network, which then has this name; a relative path begins at the folder of
    the car. Raises InputError, also where the estimator is not made for them.
    """
    if network is None:
        entry = entry_of(name)
    else:
        _check_free(name, network)
        entry = network_entry(name, resource(Path(network)))
    estimator = entry.build(load(camera, Camera), load(vehicle, Vehicle))
    if isinstance(estimator, Unfit):
        raise InputError(
            f"{estimator.why}: name other estimators (`estimators: [cv, ...]`), or train it on such lanes"
        )
    return estimator
