"""The sight distance of every frame: the nearest end of the sight, fused over time.

A frame gives a distance with its deviation and what ends it: the air (:mod:`.air`), darkness (:mod:`.dark`), a
crest (:mod:`.crest`), a thing that hides the road (:mod:`.hidden`) or the side of the image, beyond which nothing
of the lane is seen. Over time a distance that is shorter by more than chance counts at once; other changes follow
with a time constant, and growth is limited.
"""

import math
from collections import deque
from typing import NamedTuple

import cv2
import numpy as np

from perception.camera.grey import small, small_grey
from perception.lane.view import undistortion_maps
from perception.sight.air import AirFit, Range, Sky
from perception.sight.crest import CrestFinder, GroundEnd
from perception.sight.dark import Lighting, dark_m, lighting, noise_grey
from perception.sight.hidden import End, HiddenRoad, HiddenWatch
from perception.sight.settings import SightSettings
from perception.sight.strip import Ground, GroundStrip, Path, light_of, path_of
from trepid.car.camera import Camera
from trepid.causes import Cause
from trepid.messages import Frame, SteeringEstimate, VehicleState
from trepid.types import Array, Floats, Image

MIN_SIZE_PX = 32
SURE = 0.5  # confidence of a lane that says where the road goes on
EXTREME = 0.02  # share of the pixels that may be black or white by defect, lamps or the frame of a window
CHANCE = 2.0  # standard deviations by which a shorter sight is no chance


class Sight(NamedTuple):
    """A distance from the rear axle along the lane, its standard deviation, and the cause of its end."""

    distance_m: float
    sigma_m: float
    cause: str  # of trepid.causes; "": nothing within reach ends it


class _Eye(NamedTuple):
    """Tables for images of one size."""

    camera: Camera
    matrix: Array  # pixel from road
    strip: GroundStrip
    ground_end: GroundEnd
    air: AirFit
    hidden: HiddenRoad
    maps: tuple[cv2.typing.MatLike, cv2.typing.MatLike] | None  # without lens distortion


class _View(NamedTuple):
    """One frame."""

    eye: _Eye
    image: Image  # small, without lens distortion, grey or BGR
    grey: Image
    light: Floats  # linear, above the ground
    path: Path
    ground: Ground


class SightObserver:
    """Sight distances with one camera, in the reference world (:mod:`trepid.scale`)."""

    def __init__(self, settings: SightSettings, camera: Camera, *, assumed: bool = False) -> None:
        """``assumed``: the camera is self-calibrated. Its horizon is that of the image, and gives no distance to a
        crest or to a thing that hides the road."""
        self._settings, self._camera = settings, camera
        self._crest = None if assumed else CrestFinder(settings.crest, camera.height_m)
        self._watch = None if assumed else HiddenWatch(settings.hidden)
        self._eyes: dict[tuple[int, ...], _Eye | None] = {}
        self._memory = _Memory(settings)
        self._beside: deque[tuple[float, float]] = deque()  # times, and ways to the side of the image

    def step(
        self, frame: Frame, estimate: SteeringEstimate | None, state: VehicleState | None = None
    ) -> Sight | None:
        """The sight in ``frame``; None where the image does not say.

        ``estimate``: the lane, of this frame or of the one before; without one the ground straight ahead counts.
        ``state``: its speed separates a crest from paint on the ground; without a speed no crest is found.
        """
        return self._memory.step(self._measure_sight(frame, estimate, state), frame.t_s)

    def _measure_sight(
        self, frame: Frame, estimate: SteeringEstimate | None, state: VehicleState | None
    ) -> Sight | None:
        image, settings = frame.image, self._settings
        if image.dtype != np.uint8 or image.ndim not in (2, 3) or min(image.shape[:2]) < MIN_SIZE_PX:
            return None
        image = small(image)
        eye = self._eye_for(image)
        if eye is None:
            return None
        if eye.maps is not None:
            image = np.asarray(cv2.remap(image, *eye.maps, cv2.INTER_LINEAR), np.uint8)
        grey = small_grey(image)
        low, high = _range_grey(grey)
        if high - low < settings.least_range_grey:
            return self._black(eye) if high < settings.least_range_grey else None
        path = path_of(estimate, eye.matrix, reach_m=settings.reach_m, known_m=settings.strip.path_known_m)
        view = _View(
            eye, image, grey, light_of(grey[: eye.strip.first_row]), path, eye.strip.look(grey, path)
        )
        sky = eye.air.sky(view.light, path)
        air = self._air(view, sky)
        if air is None:
            return None
        lit = lighting(view.ground, sky)
        lens_m, sure = eye.camera.x_m, estimate is not None and estimate.confidence >= SURE
        hidden = self._hiding_end(view, frame.t_s) if sure else None
        beside_m = _beside_m(eye.camera, path, settings.strip.near_m) if sure else math.inf
        beside_m = self._longest_beside_m(beside_m, frame.t_s)
        ends = (
            (settings.reach_m, settings.reach_sigma, ""),
            (air.range_m + lens_m, air.sigma, Cause.FOG),
            (self._dark_m(view, lit) + lens_m, settings.dark.model_sigma, Cause.DARK),
            (self._crest_m(view, lit, state, frame.t_s) + lens_m, settings.crest.model_sigma, Cause.CREST),
            (
                math.inf if hidden is None else hidden.distance_m + lens_m,
                hidden.sigma if hidden else 0.0,
                Cause.OCCLUDED,
            ),
            (beside_m if beside_m <= settings.strip.path_known_m else math.inf, settings.reach_sigma, ""),
        )
        distance_m, sigma, cause = min(ends, key=lambda end: end[0])  # of equal ones the first
        return Sight(distance_m, distance_m * sigma, cause)

    def _air(self, view: _View, sky: Sky | None) -> Range | None:
        """The range of the air: the longer one of the strips along the lane and straight ahead.

        Both show the same air. Whatever contradicts the law, as ground whose light changes across or along the
        strip, makes the air look thicker.
        """
        eye, settings = view.eye, self._settings
        along = eye.air.range_of(view.light, sky, view.ground, view.path)
        if along is None or along.range_m >= settings.reach_m:
            return along
        ahead = path_of(None, eye.matrix, reach_m=settings.reach_m, known_m=settings.strip.path_known_m)
        straight = eye.air.range_of(view.light, sky, eye.strip.look(view.grey, ahead), ahead)
        return max(along, straight or along, key=lambda found: found.range_m)

    def _crest_m(self, view: _View, lit: Lighting, state: VehicleState | None, t_s: float) -> float:
        """Distance [m] from the lens of a crest; infinite without one.

        By night the cut-off of the own lamps lies on the road like the end of the ground.
        """
        if self._crest is None or lit is Lighting.LAMPS:
            return math.inf
        end_m = view.eye.ground_end.ahead_m(view.image, view.path)
        crest_m = self._crest.step(end_m, None if state is None else state.speed_mps, t_s)
        return math.inf if crest_m is None else crest_m

    def _hiding_end(self, view: _View, t_s: float) -> End | None:
        """The end of the sight before or behind what hides the lane; None without one."""
        return (
            None if self._watch is None else self._watch.step(view.eye.hidden.end(view.image, view.path), t_s)
        )

    def _longest_beside_m(self, beside_m: float, t_s: float) -> float:
        """The longest of the ways to the side of the image in the last moments.

        Drops on the lens bend a measured lane for some frames; the lane itself leaves the image for longer.
        """
        ways, memory_s = self._beside, self._settings.hidden.memory_s
        if ways and not 0.0 <= t_s - ways[-1][0] <= memory_s:
            ways.clear()
        ways.append((t_s, beside_m))
        while ways[0][0] < t_s - memory_s:
            ways.popleft()
        return max(way_m for _, way_m in ways)

    def _dark_m(self, view: _View, lit: Lighting) -> float:
        """Distance [m] from the lens at which darkness ends the sight; infinite by day."""
        if lit is Lighting.DAY:
            return math.inf
        settings, strip = self._settings.dark, view.eye.strip
        ground = view.grey[strip.first_row :]
        far = ground[: len(ground) // 3]  # as dark as the end of the sight: noise grows with darkness
        noise = noise_grey(far, least=settings.least_noise_grey)
        by_lamps = lit is Lighting.LAMPS
        return dark_m(view.ground, strip.middle_m, noise, view.eye.camera, settings, by_lamps=by_lamps)

    def _black(self, eye: _Eye) -> Sight:
        near_m = self._settings.strip.near_m + eye.camera.x_m
        return Sight(near_m, near_m * self._settings.dark.model_sigma, Cause.DARK)

    def _eye_for(self, image: Image) -> _Eye | None:
        """The tables for images like ``image``; None where they are not of this camera, or show no ground."""
        size = image.shape[:2]
        if size not in self._eyes:
            self._eyes[size] = self._make_eye(*size)
        return self._eyes[size]

    def _make_eye(self, height_px: int, width_px: int) -> _Eye | None:
        camera = self._camera
        if height_px != max(1, round(camera.height_px * width_px / camera.width_px)):
            return None
        camera = camera.resize(width_px, height_px)
        strip = GroundStrip(camera, self._settings.strip)
        if not strip.is_usable:
            return None
        settings = self._settings
        air = AirFit(camera, strip.distance_m, settings.air, reach_m=settings.reach_m)
        ground_end = GroundEnd(camera, settings.crest)
        hidden = HiddenRoad(camera, settings.hidden)
        return _Eye(
            camera, camera.pixel_from_road_matrix, strip, ground_end, air, hidden, undistortion_maps(camera)
        )


class _Memory:
    """The logarithm of the distance over time.

    Its errors are those of the road and of the air in view, which neighbouring frames share: the mean over frames
    takes out the noise, but the standard deviation stays that of a frame. What ended a shorter sight stays its
    cause until the distance has grown to what a frame shows.
    """

    def __init__(self, settings: SightSettings) -> None:
        self._settings = settings
        self._log_m = self._sigma = math.nan
        self._cause = ""
        self._t_s = -math.inf

    def step(self, seen: Sight | None, t_s: float) -> Sight | None:
        """The sight after that of a frame captured at ``t_s``; None without one in this frame."""
        if seen is None:
            return None
        settings, dt_s = self._settings, t_s - self._t_s
        log_m, sigma = math.log(seen.distance_m), seen.sigma_m / seen.distance_m
        stale = not 0.0 <= dt_s <= settings.hold_s
        if stale or log_m < self._log_m - CHANCE * sigma:
            self._log_m, self._sigma, self._cause = log_m, sigma, seen.cause
        else:
            gain = 1.0 - math.exp(-dt_s / settings.memory_s)
            self._log_m += min(gain * (log_m - self._log_m), settings.growth_1ps * dt_s)
            self._sigma += gain * (sigma - self._sigma)
            if self._log_m >= log_m - CHANCE * sigma:
                self._cause = seen.cause
        self._t_s = t_s
        distance_m = min(math.exp(self._log_m), settings.reach_m)
        return Sight(distance_m, distance_m * self._sigma, self._cause)


def _range_grey(grey: Image) -> tuple[int, int]:
    """The grey levels below and above which EXTREME of the image lies."""
    sample = grey[::4, ::4]
    shares = np.cumsum(np.bincount(sample.ravel(), minlength=256)) / sample.size
    return int(np.argmax(shares > EXTREME)), int(np.argmax(shares >= 1 - EXTREME))


def _beside_m(camera: Camera, path: Path, near_m: float) -> float:
    """Way [m] along the lane, beyond ``near_m``, at which it leaves the image at its side; infinite: nowhere."""
    column = path.column_px
    ahead = path.x_m > camera.x_m + near_m
    out = ahead & ~((column >= -0.5) & (column <= camera.width_px - 0.5))
    turned_back = np.append(False, np.diff(path.x_m) < 0)
    lost = np.flatnonzero(out | turned_back)
    return float(path.way_m[lost[0]]) if len(lost) else math.inf
