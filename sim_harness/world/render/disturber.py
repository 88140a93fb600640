"""Applies disturbances to a frame, in this order: scene, motion, light, air, lens, exposure, sensor, codec."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from sim_harness.world.render.optics.lens import StrayLight, Windscreen, add_bloom, add_vignette
from sim_harness.world.render.optics.motion import Shake
from sim_harness.world.render.optics.sensor import code_jpeg, noisy
from sim_harness.world.render.scene.air import distances, rain, snowfall, through_air
from sim_harness.world.render.scene.backdrop import Backdrop
from sim_harness.world.render.scene.night import Headlights
from sim_harness.world.render.scene.painter import Pose
from sim_harness.world.render.scene.standing import standing
from sim_harness.world.render.scene.tunnel import exposure_stops, extent, in_tunnel
from sim_harness.world.render.scene.vehicles import Body
from sim_harness.world.render.scene.view import Shot, View, grey_of, light_of
from sim_harness.world.render.scene.wet import WetRoad
from sim_harness.world.roads.disturbance_table import at, extinction_1pm, load_table
from sim_harness.world.roads.disturbances import Disturbance, DisturbanceKind, grades_at
from sim_harness.world.roads.road import Road
from trepid.car.camera import Camera
from trepid.types import Floats, Image

Kind = DisturbanceKind
Grade = Mapping[DisturbanceKind, float]

LIGHT = {  # kinds that are computed in linear light
    *(Kind.NIGHT, Kind.LOW_SUN, Kind.GLARE, Kind.OVER_EXPOSURE, Kind.DIRT),
    *(Kind.RAIN, Kind.WET_ROAD, Kind.SNOW, Kind.FOG),
}
STANDING_WITHIN_M = 70.0  # distance within which standing vehicles are drawn


class Disturber:
    """The disturbances of one road for one camera. ``eye``: the pinhole of the scene; ``camera``: with its lens."""

    def __init__(
        self,
        road: Road,
        eye: Camera,
        camera: Camera,
        backdrop: Backdrop,
        disturbances: Sequence[Disturbance],
        *,
        seed: int,
    ) -> None:
        self._table = load_table()
        self._disturbances = tuple(d for d in disturbances if d.grade > 0)
        self._eye, self._camera, self._backdrop, self._seed = eye, camera, backdrop, seed
        self._tunnels = [d for d in self._disturbances if d.kind == Kind.TUNNEL_EXIT]
        self._standing = [
            vehicle
            for d in self._disturbances
            if d.kind == Kind.OCCLUSION
            for vehicle in standing(road, d, self._table.occlusion, seed=seed)
        ]
        self._standing_at = np.array([pose[:2] for pose, _ in self._standing]).reshape(-1, 2)
        self.view = View(eye)

    @cached_property
    def _headlights(self) -> Headlights:
        return Headlights(self.view)

    @cached_property
    def _wet_road(self) -> WetRoad:
        return WetRoad(self.view, self._backdrop, seed=self._seed)

    @cached_property
    def _shake(self) -> Shake:
        return Shake(self._eye, self._backdrop.rows)

    @cached_property
    def _stray_light(self) -> StrayLight:
        return StrayLight(self._camera)

    @cached_property
    def _windscreen(self) -> Windscreen:
        return Windscreen(self._camera, seed=self._seed)

    def grades(self, station_m: float) -> dict[DisturbanceKind, float]:
        """The grade of each kind present at a station."""
        return grades_at(self._disturbances, station_m)

    def standing_near(self, pose: Pose) -> list[tuple[Pose, Body]]:
        """World poses and bodies of the standing vehicles near ``pose``."""
        away = np.hypot(*(self._standing_at - pose[:2]).T)
        return [self._standing[i] for i in np.flatnonzero(away < STANDING_WITHIN_M)]

    def move(self, image: Image, shot: Shot, grades: Grade) -> Image:
        """``image`` with motion blur over the exposure and with a rolling shutter."""
        readout_s = at(self._table.rolling_shutter.readout_s, grades.get(Kind.ROLLING_SHUTTER, 0))
        exposure_s = at(self._table.motion_blur.exposure_s, grades.get(Kind.MOTION_BLUR, 0))
        if exposure_s > 0:
            image = self._shake.blur(image, shot.motion, exposure_s)
        if readout_s > 0:
            image = self._shake.roll(image, shot.motion, readout_s)
        return image

    def needs_light(self, station_m: float, grades: Grade) -> bool:
        near = any(extent(d)[0] - 160 < station_m < extent(d)[1] + 120 for d in self._tunnels)
        return near or not LIGHT.isdisjoint(grades)

    def scene(self, image: Image, shot: Shot, grades: Grade) -> Floats:
        """The light in front of the lens."""
        table, light = self._table, light_of(image)
        rain_wet, road_wet = grades.get(Kind.RAIN, 0), grades.get(Kind.WET_ROAD, 0)
        wet = max(at(table.rain.wet, rain_wet), at(table.wet_road.wet, road_wet))
        if wet > 0:
            light = self._wet_road.mirror(light, shot, wet)
        for tunnel in self._tunnels:
            light = in_tunnel(light, self.view, shot, tunnel, table.tunnel_exit)
        night = grades.get(Kind.NIGHT, 0)
        if night > 0:
            light = self._headlights.light(light, shot, table.night, night)
        return self._air(light, shot, grades, at(table.night.ambient, night))

    def _air(self, light: Floats, shot: Shot, grades: Grade, ambient: float) -> Floats:
        table = self._table
        raining, snowing, foggy = (grades.get(kind, 0) for kind in (Kind.RAIN, Kind.SNOW, Kind.FOG))
        daylight = at(table.rain.daylight, raining) * at(table.snow.daylight, snowing)
        if daylight != 1:
            light = light * np.float32(daylight)
        extinction = sum(
            extinction_1pm(weather.visibility_m, grade)
            for weather, grade in ((table.rain, raining), (table.snow, snowing), (table.fog, foggy))
            if grade > 0
        )
        if extinction > 0:
            light = through_air(light, distances(self.view, shot), extinction, daylight * ambient)
        exposure_s = at(table.motion_blur.exposure_s, grades.get(Kind.MOTION_BLUR, 0))
        if raining > 0:
            light = rain(light, self.view, shot, at(table.rain.streaks, raining), exposure_s)
        if snowing > 0:
            light = snowfall(light, self.view, shot, at(table.snow.flakes, snowing), exposure_s)
        return light

    def through_lens(self, light: Floats, shot: Shot, grades: Grade, vignette: Image) -> Floats:
        """The light on the sensor."""
        table = self._table
        low_sun = (Kind.LOW_SUN, table.low_sun, shot.sun_bearing_rad)
        for kind, sun, bearing in (low_sun, (Kind.GLARE, table.glare, 0.12)):
            grade = grades.get(kind, 0)
            if grade > 0:
                strength, elevation = at(sun.strength, grade), np.radians(at(sun.elevation_deg, grade))
                light = self._stray_light.add(
                    light, strength, bearing_rad=bearing, elevation_rad=float(elevation)
                )
        drops = at(table.rain.drops, grades.get(Kind.RAIN, 0))
        if drops >= 1:
            light = self._windscreen.wet(light, drops, shot.t_s)
        dirt = grades.get(Kind.DIRT, 0)
        if dirt > 0:
            light = self._windscreen.dirty(light, at(table.dirt.cover, dirt), at(table.dirt.veil, dirt))
        return add_vignette(light, vignette)

    def develop(self, light: Floats, shot: Shot, grades: Grade) -> Image:
        """Exposure: grey levels of the light on the sensor."""
        stops = self._stops(shot, grades)
        if stops != 0:
            light = light * np.float32(2**stops)
        return grey_of(add_bloom(light) if light.max() > 1 else light)

    def _stops(self, shot: Shot, grades: Grade) -> float:
        """Exposure relative to even daylight, in stops."""
        table = self._table
        stops = at(table.over_exposure.stops, grades.get(Kind.OVER_EXPOSURE, 0))
        stops -= at(table.glare.stops, grades.get(Kind.GLARE, 0))
        towards = max(float(np.cos(shot.sun_bearing_rad)), 0.0) ** 2
        stops -= towards * at(table.low_sun.stops, grades.get(Kind.LOW_SUN, 0))
        return stops + sum(exposure_stops(d, shot.station_m, table.tunnel_exit) for d in self._tunnels)

    def finish(self, image: Image, shot: Shot, grades: Grade) -> Image:
        """``image`` after sensor noise and JPEG coding."""
        table = self._table
        noise, night = grades.get(Kind.NOISE, 0), grades.get(Kind.NIGHT, 0)
        gain = max(at(table.noise.gain, noise), at(table.night.gain, night))
        if gain > 1:
            image = noisy(image, gain, (shot.seed, shot.frame, 51))
        jpeg = grades.get(Kind.JPEG, 0)
        return code_jpeg(image, at(table.jpeg.quality, jpeg)) if jpeg > 0 else image
