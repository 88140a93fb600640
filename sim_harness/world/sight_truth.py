"""The true sight distance of a camera: how far ahead of the rear axle the image shows the lane, and what ends it.

Sight is measured along the centre of the lane. It ends at the nearest of these places:

air     the lens is farther away than the meteorological optical range 3/Σβ of fog, rain and snow, at which the
        contrast of a black target falls to 5 % (Koschmieder 1924; WMO No. 8). Cause ``fog``.
dark    by night a square target before asphalt no longer stands out of the noise of the sensor. With ΔE the
        difference of the grey levels of target and ground in ambient light, headlights and air, n the pixels of
        the target and σ the noise at the gain of the night, it is seen while

            ΔE·min(√n, n)/σ ≥ k,    k = 5    (Rose 1948)

        Cause ``dark``, or ``fog`` where the optical range is shorter than the sight in clear air.
hidden  the line from the lens to the ground meets another vehicle or a wall. Cause ``occluded``.
crest   ground before hides the ground: on a crest of radius R the lens, h above it, sees √(2·h·R) far. Cause
        ``crest``.
edge    the lane leaves the image at its left or right edge. No cause: nothing takes the sight.

``config/sight_truth.yaml`` holds the numbers. A sight that nothing ends is ``limit_m`` long. Not counted: stray
light of the sun, tunnels, dirt and drops, blur, and the exposure of the section.
"""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sim_harness.world.render.optics.sensor import noise_sigma
from sim_harness.world.render.scene.air import AIRLIGHT_BGR
from sim_harness.world.render.scene.night import LAMP_BGR, RETRO, beams
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.standing import standing
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.roads.disturbance_table import CONTRAST_LOST, at, extinction_1pm, load_table
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind, grades_at
from sim_harness.world.roads.road import Road
from sim_harness.world.sight_lines import SightLines, box_faces, meet
from trepid.car.camera import Camera
from trepid.causes import Cause
from trepid.config import CONFIG_DIR, Settings, load
from trepid.scale import scaled_message, scaled_settings
from trepid.types import Array, Mask, Positive, Share

Kind = DisturbanceKind
STEP_M = 2.0  # between the places that are tried first
FINER = 64  # places within a step: to 3 cm
NEAREST_M = 1.0  # ahead of the lens
WITHIN_M = 120.0  # distance within which standing vehicles hide the road
_SHARES = np.arange(1, FINER + 1) / FINER
GREEN = 1  # the channel that stands for brightness


class SightDistance(NamedTuple):
    """A true sight distance."""

    distance_m: float  # from the rear axle, along the lane
    cause: str  # of its end (trepid.causes); "": nothing takes it


class SightSettings(Settings):
    """``config/sight_truth.yaml``."""

    limit_m: Positive
    noise_multiple: Positive
    target_side_m: Positive
    target_reflectance: Share
    ground_reflectance: Share


def load_sight_settings() -> SightSettings:
    """The settings of ``config/sight_truth.yaml``. Raises InputError."""
    return load(CONFIG_DIR / "sight_truth.yaml", SightSettings)


class Places(NamedTuple):
    """Places on the centre of the lane, (n,) each."""

    ahead_m: Array  # along the lane, from the rear axle
    world_m: Array  # x, y, z in the axes of the road, (n, 3)
    vehicle_m: Array  # x, y, z in the axes of the vehicle, (n, 3)
    distance_m: Array  # from the lens


class SightTruth:
    """The true sight of one camera on one road. Stateless: equal arguments give equal sights."""

    def __init__(
        self, road: Road, camera: Camera, disturbances: Sequence[Disturbance] = (), *, seed: int
    ) -> None:
        """``seed``: of the renderer, which places standing vehicles by it. Raises InputError for a bad table."""
        self._settings = load_sight_settings()
        self._enlargement = 1 / road.settings.scale
        self._road = road.in_reference_world
        self._camera = scaled_settings(camera, self._enlargement)
        self._disturbances = tuple(scaled_settings(d, self._enlargement) for d in disturbances)
        self._optical = self._camera.optical_from_vehicle
        self._table = load_table()
        parked = [d for d in self._disturbances if d.kind == Kind.OCCLUSION and d.grade > 0]
        self._standing = [
            one for d in parked for one in standing(self._road, d, self._table.occlusion, seed=seed)
        ]
        self._lines = SightLines(self._road)
        self._ahead_m = np.arange(self._camera.x_m + NEAREST_M, self._settings.limit_m + STEP_M, STEP_M)

    def at(self, station_m: float, pose: Pose, vehicles: Sequence[tuple[Pose, Body]] = ()) -> SightDistance:
        """The sight of a vehicle with its rear axle at ``pose``, at this station of the road.

        ``vehicles``: poses and bodies of the others.
        """
        larger = self._enlargement
        x_m, y_m, yaw_rad = pose
        pose, station_m = (x_m * larger, y_m * larger, yaw_rad), station_m * larger
        others = [((x * larger, y * larger, yaw), scaled_message(b, larger)) for (x, y, yaw), b in vehicles]
        view = _LaneView(self._road, self._camera, self._optical, station_m, pose)
        coarse = view.places(self._ahead_m)
        near = [one for one in self._standing if math.dist(one[0][:2], pose[:2]) < WITHIN_M]
        faces = np.concatenate(
            [_faces([*near, *others], coarse), self._lines.walls_from(station_m, self._settings.limit_m)]
        )
        ends = [
            (self._settings.limit_m, ""),
            (view.first(coarse, view.beside), ""),
            *self._in_the_air(view, coarse),
        ]
        if not self._road.flat:
            ends.append((view.crest(coarse), Cause.CREST))
        if len(faces):
            ends.append(
                (view.first(coarse, lambda places: meet(view.eye_m, places.world_m, faces)), Cause.OCCLUDED)
            )
        distance_m, cause = min(ends, key=lambda end: end[0])
        return SightDistance(distance_m / larger, str(cause))

    def _in_the_air(self, view: "_LaneView", coarse: Places) -> list[tuple[float, Cause]]:
        """Where fog and where darkness end the sight."""
        grades, table = grades_at(self._disturbances, view.station_m), self._table
        weathers = ((Kind.FOG, table.fog), (Kind.RAIN, table.rain), (Kind.SNOW, table.snow))
        extinction = sum(
            extinction_1pm(weather.visibility_m, grades[kind]) for kind, weather in weathers if kind in grades
        )
        ends = []
        if extinction > 0:
            range_m = CONTRAST_LOST / extinction
            ends.append((view.first(coarse, lambda places: places.distance_m > range_m), Cause.FOG))
        if Kind.NIGHT in grades:
            clear_m, dark_m = (self._dark_m(view, coarse, grades, beta) for beta in (0.0, extinction))
            by_air = extinction > 0 and CONTRAST_LOST / extinction < clear_m
            ends.append((dark_m, Cause.FOG if by_air else Cause.DARK))
        return ends

    def _dark_m(
        self, view: "_LaneView", coarse: Places, grades: dict[DisturbanceKind, float], extinction: float
    ) -> float:
        """Where darkness, in air of this extinction, ends the sight."""

        def clarity(places: Places) -> Array:
            return self._clarity(view, places, grades, extinction)

        brightest = int(np.argmax(clarity(coarse)))  # near the car the beams pass above the ground
        beyond = Places(*(field[brightest:] for field in coarse))
        return view.first(beyond, lambda places: clarity(places) < 1)

    def _clarity(
        self, view: "_LaneView", places: Places, grades: dict[DisturbanceKind, float], extinction: float
    ) -> Array:
        """Contrast over noise of the target at ``places``, in multiples of what is needed, (n,)."""
        settings, table, camera = self._settings, self._table, self._camera
        night = grades[Kind.NIGHT]
        ambient = at(table.night.ambient, night)
        lamp = at(table.night.headlight, night) * LAMP_BGR[GREEN]
        daylight = at(table.rain.daylight, grades.get(Kind.RAIN, 0))
        daylight *= at(table.snow.daylight, grades.get(Kind.SNOW, 0))
        x_m, y_m, z_m = places.vehicle_m.T
        beam = lamp * beams(x_m - camera.x_m, y_m, z_m)
        passed = np.exp(-extinction * places.distance_m)
        air = AIRLIGHT_BGR[GREEN] * ambient * daylight * (1 - passed)

        def grey(reflectance: float) -> Array:
            light = daylight * (reflectance * ambient + reflectance**RETRO * beam)
            return np.asarray(255 * np.sqrt(np.minimum(light * passed + air, 1)))

        ground = grey(settings.ground_reflectance)
        gain = max(at(table.night.gain, night), at(table.noise.gain, grades.get(Kind.NOISE, 0)))
        of_gain = np.interp(ground, np.arange(256), noise_sigma(gain))
        sigma = np.hypot(of_gain, self._road.section_at(view.station_m).light.noise)
        pixels = camera.fx_px * camera.fy_px * (settings.target_side_m / places.distance_m) ** 2
        contrast = np.abs(grey(settings.target_reflectance) - ground) * np.minimum(np.sqrt(pixels), pixels)
        return np.asarray(contrast / sigma / settings.noise_multiple)


class _LaneView:
    """The lane ahead of one pose, seen from the lens."""

    def __init__(self, road: Road, camera: Camera, optical: Array, station_m: float, pose: Pose) -> None:
        self._road, self._camera, self.station_m = road, camera, station_m
        self._optical = optical
        x, y, yaw = pose
        cos, sin = math.cos(yaw), math.sin(yaw)
        self._world_from_vehicle = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1.0]])
        middle_m, heading_rad = road.position(station_m, 0.0), road.heading_at(station_m)
        offset_m = (y - middle_m[1]) * math.cos(heading_rad) - (x - middle_m[0]) * math.sin(heading_rad)
        self._axle_m = np.array([x, y, float(road.heights_at([station_m], offset_m)[0])])
        self._slopes = np.array([road.grade_at(station_m), math.tan(road.bank_at(station_m))])
        self._lens_m = np.array([camera.x_m, camera.y_m, camera.height_m])
        self.eye_m = self._world_from_vehicle @ self._lens_m + self._axle_m
        self.eye_m[2] += float(self._slopes @ self._lens_m[:2])

    def places(self, ahead_m: Array) -> Places:
        stations = self.station_m + ahead_m
        plane_m = self._road.positions(stations, np.zeros(len(ahead_m)))
        world_m = np.column_stack([plane_m, self._road.heights_at(stations)])
        vehicle_m = (world_m - self._axle_m) @ self._world_from_vehicle
        vehicle_m[:, 2] -= vehicle_m[:, :2] @ self._slopes  # the vehicle stands on the plane of the road
        return Places(ahead_m, world_m, vehicle_m, np.sqrt(np.sum((vehicle_m - self._lens_m) ** 2, axis=1)))

    def first(self, places: Places, ends: Callable[[Places], Mask]) -> float:
        """The first of ``places``, and of those between, at which sight ``ends``; infinite where it does not."""
        over = ends(places)
        index = int(np.argmax(over))
        if not over[index]:
            return math.inf
        if index == 0:
            return float(places.ahead_m[0])
        low_m, high_m = places.ahead_m[index - 1 : index + 1]
        between = self.places(low_m + (high_m - low_m) * _SHARES)
        return float(between.ahead_m[np.argmax(ends(between))])

    def crest(self, places: Places) -> float:
        """Where ground before first hides the ground; infinite where it does not."""

        def steepness(of: Places) -> Array:
            x_m, _, z_m = (of.vehicle_m - self._lens_m).T
            if self._road.bank is not None:  # in a bend a leaning plane is no measure of height
                away_m = of.world_m - self.eye_m
                x_m, z_m = np.hypot(away_m[:, 0], away_m[:, 1]), away_m[:, 2]
            return np.asarray(np.where(x_m > 0, z_m / np.maximum(x_m, 1e-6), -np.inf))

        seen = steepness(places)
        hidden = seen[1:] < np.maximum.accumulate(seen)[:-1] - 1e-9
        index = int(np.argmax(hidden)) + 1
        if not hidden[index - 1]:
            return math.inf
        low_m, high_m = places.ahead_m[max(index - 2, 0)], places.ahead_m[index]
        between = self.places(low_m + (high_m - low_m) * _SHARES)
        return float(between.ahead_m[np.argmax(steepness(between))])

    def beside(self, places: Places) -> Mask:
        """Whether the places lie left or right of the image."""
        camera = self._camera
        right, depth = self._optical[::2] @ (places.vehicle_m - self._lens_m).T
        column = camera.cx_px + camera.fx_px * right / np.maximum(depth, 1e-6)
        return np.asarray((depth <= 1e-6) | (column < -0.5) | (column > camera.width_px - 0.5), np.bool_)


def _faces(vehicles: Sequence[tuple[Pose, Body]], lane: Places) -> Array:
    """The sides of the boxes around ``vehicles``: x, y of both ends and the height of the top, (n, 5).

    A vehicle stands as high as the nearest place of the ``lane``.
    """
    rows = []
    for (x_m, y_m, yaw_rad), body in vehicles:
        cos, sin, half_m = math.cos(yaw_rad), math.sin(yaw_rad), body.width_m / 2
        nearest = np.argmin(np.sum((lane.world_m[:, :2] - (x_m, y_m)) ** 2, axis=1))
        top_m = float(lane.world_m[nearest, 2]) + body.height_m
        ends = (
            (body.rear_m, half_m),
            (body.rear_m, -half_m),
            (body.front_m, -half_m),
            (body.front_m, half_m),
        )
        corners = [(x_m + a * cos - b * sin, y_m + a * sin + b * cos) for a, b in ends]
        rows += box_faces(corners, top_m)
    return np.array(rows).reshape(-1, 5)
