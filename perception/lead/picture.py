"""The vehicle ahead in the pixels: how fast its picture grows, and whether it still stands where it stood.

*Growth.* A place in the image gives a distance only on flat ground. Beyond a crest a standing car stays in the same
rows while the own car comes nearer, and so seems to keep its distance, as if it drove. Its picture grows all the
same: with the width w in the image, the true distance D from the lens, and the own and its speed v and u,

    w ~ 1/D,    g = d ln(w)/dt = (v - u)/D

(Lee, A theory of visual control of braking, Perception 5 (1976); Stein, Mano and Shashua, Vision-based ACC with
a single camera, IEEE Intelligent Vehicles (2003)). Beyond a crest the distance D' by flat ground is at most D. So
while the picture grows,

    u = v - g·D ≤ v - g·D'

bounds the speed, whatever the ground is like. On flat ground it is the speed itself.

The width is not measured, its growth is: a few rows of the picture above the place on the road, averaged, are a
profile across the vehicle. The profile of a moment ago, stretched about its middle by exp(g·t) and shifted, is
compared with the present one. Ground, trees and sky beside the vehicle are alike along a row, so that they neither
grow nor shrink. A vehicle that turns shows its side and gets wider as well, but its profile is no longer like the
former one. A far vehicle is some pixels high, and its place errs by one: the profile is looked for in the rows next
to it as well. Where no profile is like the former one the bound rises by the greatest acceleration of a vehicle,
since a vehicle that was slow a moment ago is not fast now.

*Presence.* A detector of single frames, which is unsure of a vehicle right before the car, stays unsure of it as
long as both stand: the same picture again is no new evidence. A vehicle that was near, and whose profile is still
the one of its last sure detection at the same place on the road, is there.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from perception.lead.detection import SAME_AHEAD, SAME_LEFT_M, Detection
from perception.lead.tracker import Odometry, Track
from trepid.car.camera import Camera
from trepid.config import Settings
from trepid.types import Image, OpenShare, Positive

Floats = NDArray[np.floating]
Profile = NDArray[np.float64]
"""Mean colours across a vehicle, less their mean over the samples, shape (3, SAMPLES)."""

HALF_M, SAMPLES = 1.5, 48  # to both sides of the middle: a vehicle of 2.55 m and the ground beside it
ROWS_M = (0.1, 0.6)  # above the place on the road: a bumper, a tailgate, or the roof beyond a crest
STRETCHES = np.exp(np.arange(-10, 21) * 0.02)  # within span_s: from 18 % smaller to 49 % larger
STEADY = np.exp(0.02 * np.arange(-3, 4))
SHIFTS_M = 0.05 * np.arange(-6, 7)
ROWS_UP_PX = (0.5, -0.5, 1.0, -1.0)  # of the rows beside those of a place
COARSE = slice(None, None, 3)  # of the stretches and shifts, to choose among these
BOUNDS = 5  # frames, over which the median of the bounds is taken
EVEN = 0.5  # confidence that says nothing for or against a vehicle


class PictureSettings(Settings):
    """Section ``picture`` of ``config/lead.yaml``."""

    span_s: Positive  # over which growth is measured
    least_match: OpenShare  # correlation of two profiles of one vehicle
    stretch_sigma: Positive  # standard deviation of the logarithm of a stretch
    sigmas: Positive  # z: the bound is that of a growth less z deviations
    accel_mps2: Positive  # by which a bound rises while it is not measured
    near_m: Positive  # from the lens: so near a detection that fails is no evidence against a vehicle
    slow_mps: Positive  # own speed, up to which that holds
    sure_s: Positive  # time of sure detections, from which on that holds


class _Moment(NamedTuple):
    """The vehicle in one frame."""

    t_s: float
    profile: Profile
    per_m: float  # pixels of a metre at its distance by flat ground
    way_m: float  # driven so far


class _Stand(NamedTuple):
    """The vehicle at its last sure detection."""

    at: NDArray[np.float64]  # in the frame of the odometry
    width_m: float
    profile: Profile


class Pictures:
    """The pictures of the vehicle that is the leader."""

    def __init__(self, settings: PictureSettings, camera: Camera) -> None:
        self._settings, self._camera = settings, camera
        self._forget()

    def _forget(self) -> None:
        self._track: Track | None = None
        self._moments: deque[_Moment] = deque()
        self._bounds_mps: deque[float] = deque(maxlen=BOUNDS)
        self._most_mps = math.inf
        self._stand: _Stand | None = None
        self._way_m = self._sure_s = 0.0

    @property
    def most_mps(self) -> float:
        """Upper bound of the speed of the leader along the road [m/s]; inf where its growth was never known."""
        return self._most_mps

    def confirm(
        self, detections: Sequence[Detection], image: Image, odometry: Odometry, speed_mps: float
    ) -> list[Detection]:
        """``detections`` with the near leader that is still there, in falling order of confidence.

        A detection of it that is rather none counts as EVEN; one that is missing is added as such.
        """
        found = list(detections)
        stand, settings = self._stand, self._settings
        if stand is None or self._sure_s < settings.sure_s or not abs(speed_mps) <= settings.slow_mps:
            return found
        ahead_m, left_m = odometry.to_vehicle(stand.at).tolist()
        if not 0.0 < ahead_m - self._camera.x_m <= settings.near_m:
            return found
        same = [one for one in found if _shows(one, ahead_m, left_m)]
        if any(one.confidence >= EVEN for one in same):
            return found
        view = self._view(image, ahead_m, left_m)
        if view is None or view.stretch(stand.profile, view.per_m, STEADY)[1] < settings.least_match:
            return found
        there = Detection(ahead_m, left_m, stand.width_m, EVEN)
        others = [one for one in found if one not in same]
        return sorted([*others, there], key=lambda one: -one.confidence)

    def step(
        self,
        leader: Track | None,
        detections: Sequence[Detection],
        image: Image,
        odometry: Odometry,
        *,
        speed_mps: float,
        dt_s: float,
        t_s: float,
    ) -> None:
        """Take in the frame of ``t_s``, ``dt_s`` after the one before. ``speed_mps``: own one, NaN: not known."""
        if leader is not self._track:
            self._forget()
            self._track = leader
        if leader is None:
            return
        self._most_mps += self._settings.accel_mps2 * dt_s
        if math.isnan(speed_mps):
            self._moments.clear()
        else:
            self._way_m += speed_mps * dt_s
        ahead_m, left_m = odometry.to_vehicle(leader.state[:2]).tolist()
        sure = (one for one in detections if one.confidence > EVEN and _shows(one, ahead_m, left_m))
        one = next(sure, None)
        view = None if one is None else self._view(image, one.ahead_m, one.left_m)
        if one is None or view is None:
            return
        profile = view.profile()
        self._sure_s += dt_s
        self._stand = _Stand(odometry.from_vehicle(one.ahead_m, one.left_m), one.width_m, profile)
        self._grow(view, image, one, t_s)
        if not math.isnan(speed_mps):
            self._moments.append(_Moment(t_s, profile, view.per_m, self._way_m))

    def _grow(self, view: "_View", image: Image, one: Detection, t_s: float) -> None:
        """Bound the speed by the growth since ``span_s`` ago."""
        settings, moments = self._settings, self._moments
        while len(moments) > 1 and moments[1].t_s <= t_s - settings.span_s:
            moments.popleft()
        span_s = t_s - moments[0].t_s if moments else 0.0
        if not settings.span_s <= span_s <= 2 * settings.span_s:
            self._bounds_mps.clear()
            return
        before = moments[0]
        stretch, match = view.stretch(before.profile, before.per_m, STRETCHES)
        if match < settings.least_match:
            stretch, match = self._stretch_beside(image, one, before)
        if match < settings.least_match:
            self._bounds_mps.clear()
            return
        growth_1ps = (stretch - settings.sigmas * settings.stretch_sigma) / span_s
        own_mps, depth_m = (self._way_m - before.way_m) / span_s, one.ahead_m - self._camera.x_m
        self._bounds_mps.append(own_mps - growth_1ps * depth_m if growth_1ps > 0.0 else math.inf)
        if len(self._bounds_mps) == BOUNDS:
            self._most_mps = float(np.median(self._bounds_mps))

    def _stretch_beside(self, image: Image, one: Detection, before: _Moment) -> tuple[float, float]:
        """The logarithm of the stretch in the rows beside those of a place, and its correlation."""

        def likeness(view: _View) -> float:
            return view.stretch(before.profile, before.per_m, STRETCHES[COARSE], SHIFTS_M[COARSE])[1]

        beside = (self._view(image, one.ahead_m, one.left_m, up_px) for up_px in ROWS_UP_PX)
        views = [view for view in beside if view is not None]
        if not views:
            return 0.0, -1.0
        return max(views, key=likeness).stretch(before.profile, before.per_m, STRETCHES)

    def _view(self, image: Image, ahead_m: float, left_m: float, up_px: float = 0.0) -> "_View | None":
        """The rows of ``image`` ``up_px`` above a place on flat ground; None where they are not within it."""
        depth_m = ahead_m - self._camera.x_m
        if depth_m <= 0.0:
            return None
        column, row = self._camera.pixel_from_road([(ahead_m, left_m)])[0].tolist()
        per_m = self._camera.fx_px / depth_m
        last = row - up_px - ROWS_M[0] * per_m
        first = min(row - up_px - ROWS_M[1] * per_m, last - 2.0)
        if not 0.0 <= first < last <= image.shape[0] - 1:
            return None
        rows = np.arange(math.floor(first + 0.5), math.ceil(last + 0.5))
        share = np.minimum(rows + 0.5, last) - np.maximum(rows - 0.5, first)  # of a row between both ends
        colours = np.tensordot(share / share.sum(), image[rows], axes=1)
        return _View(colours.T, column, per_m)


def _shows(one: Detection, ahead_m: float, left_m: float) -> bool:
    """Whether a detection is of the vehicle at a place, by the differences that make two detections one."""
    apart = abs(math.log(max(one.ahead_m, 0.1) / max(ahead_m, 0.1)))
    return apart < math.log(SAME_AHEAD) and abs(one.left_m - left_m) < SAME_LEFT_M


class _View(NamedTuple):
    """Rows of an image across a place on the road."""

    colours: NDArray[np.float64]  # mean over the rows, (3, columns)
    column_px: float
    per_m: float

    def profile(self) -> Profile:
        """The profile at this distance."""
        return self._sample_profiles(np.ones(1), np.zeros(1), self.per_m)[0, 0]

    def stretch(
        self, profile: Profile, per_m: float, stretches: Floats, shifts_m: Floats = SHIFTS_M
    ) -> tuple[float, float]:
        """The logarithm of the stretch of ``profile`` that fits best, and the correlation.

        ``profile`` was taken with ``per_m`` pixels a metre. The logarithm is that of the vertex of the parabola
        through the best of ``stretches``, a geometric series, and its neighbours.
        """
        sampled = self._sample_profiles(stretches, shifts_m, per_m)
        size = np.sqrt((profile**2).sum() * (sampled**2).sum(axis=(2, 3)))
        match = ((sampled * profile).sum(axis=(2, 3)) / np.maximum(size, 1e-9)).max(axis=1)
        best = int(match.argmax())
        log = math.log(stretches[best])
        if 0 < best < len(stretches) - 1:
            below, at, above = match[best - 1 : best + 2].tolist()
            bend = below - 2.0 * at + above
            if bend < 0.0:
                log += math.log(stretches[1] / stretches[0]) * (below - above) / (2.0 * bend)
        return log, float(match[best])

    def _sample_profiles(self, stretches: Floats, shifts_m: Floats, per_m: float) -> NDArray[np.float64]:
        """Stretched and shifted profiles, (stretches, shifts, 3, SAMPLES)."""
        samples_m = np.linspace(-HALF_M, HALF_M, SAMPLES)
        at_m = samples_m * stretches[:, None, None] + shifts_m[:, None]
        at_px = self.column_px + at_m * per_m
        columns = np.arange(self.colours.shape[1])
        colours = [np.interp(at_px, columns, colour) for colour in self.colours]
        sampled = np.stack(colours, axis=2)
        return np.asarray(sampled - sampled.mean(axis=3, keepdims=True))
