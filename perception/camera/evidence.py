"""All evidence about a camera without a file, and what follows from it."""

import math
from dataclasses import replace

import numpy as np

from perception.camera.ground_fit import Optics
from perception.camera.uncertainty import CameraBelief, believed_camera
from trepid.car.camera import Camera

MAX_SPREAD = 0.15  # of the periods of dashes: between their quartiles, over the median


class CameraEvidence:
    """A self-calibrated camera, and what frames and odometry have shown of it."""

    def __init__(
        self, assumed: Camera, prior: CameraBelief, *, width_m: float, width_sigma_m: float, looks: int
    ) -> None:
        """``width_m`` ± ``width_sigma_m``: lanes; ``looks``: at widths and dashes before they count."""
        self._assumed, self._prior = assumed, prior
        self._lanes_m = {"width_m": width_m, "width_sigma_m": width_sigma_m}
        self._widths, self._dashes = _Recurring(looks), _Recurring(looks, MAX_SPREAD)
        self._width: float | None = None
        self._focal_height_pxm: float | None = None
        self._optics: Optics | None = None
        self._contradiction = 0.0  # half of the distance of ln h by odometry from that by widths
        self._sure = self.belief = prior  # without and with the contradiction
        self.camera = assumed

    def add_width(self, width: float) -> bool:
        """Whether the lane between two lines, ``width`` heights of the camera wide, changed the belief.

        The median of several frames counts, if it is likely. An unlikely one is that of another lane, unless
        odometry is wrong: it adds doubt to a height by odometry.
        """
        if self._width is not None or (median := self._widths.add(width)) is None:
            return False
        if self._sure.given_width(median, **self._lanes_m) is not self._sure:
            self._width, self._contradiction = median, 0.0
            return self._judge()
        apart = math.log(self._lanes_m["width_m"] / median) - math.log(self._sure.height_m)
        self._contradiction = 0.0 if self._optics is None else abs(apart) / 2
        return self._judge()

    def add_dashes(self, focal_height_pxm: float) -> bool:
        """Whether dashes of known length in a frame, which give f·h, changed the belief: as :meth:`add_width`."""
        if self._focal_height_pxm is None and (median := self._dashes.add(focal_height_pxm)) is not None:
            likely = self.belief.given_dashes(median) is not self.belief
            self._focal_height_pxm = median if likely else None
            return likely and self._judge()
        return False

    def add_optics(self, optics: Optics) -> bool:
        """Whether all odometry so far changed the belief; what turns have measured stays without further turns."""
        if optics.focal_px is None and self._optics is not None and self._optics.focal_px is not None:
            return False
        self._optics = optics
        return self._judge()

    def cut_images(self, height_px: int) -> None:
        """Images have ``height_px`` rows from now on: the same camera without the rows below."""
        self._assumed, self.camera = (
            one.model_copy(update={"height_px": height_px}) for one in (self._assumed, self.camera)
        )

    @property
    def awaits_dashes(self) -> bool:
        """Whether dashes add anything."""
        return self._focal_height_pxm is None

    def _judge(self) -> bool:
        """The belief after all evidence, and the camera of its medians; whether it is another one.

        A focal length from turns comes before width and dashes, which may be those of another line, and a way
        alone after them, because a wrong speed would pass for another height. A height that odometry contradicts,
        or the width of lanes, is uncertain by half of the distance.
        """
        before, belief, optics = self.belief, self._prior, self._optics
        turned = optics is not None and optics.focal_px is not None
        contradiction, refused = self._contradiction, None
        if optics is not None and turned:
            belief = belief.given_optics(optics)
            refused = optics if belief is self._prior else None
            optics = None if refused else optics
        if self._width is not None:
            by_width = belief.given_width(self._width, **self._lanes_m)
            if by_width is belief:
                self._width = None  # odometry contradicts it: it is measured again in the camera of that
            belief = by_width
        if self._focal_height_pxm is not None:
            belief = belief.given_dashes(self._focal_height_pxm)
        if optics is not None and not turned:
            by_lines, belief = belief, belief.given_optics(optics)
            optics = None if belief is by_lines else optics
        self._sure, self.camera = belief, believed_camera(self._assumed, belief, optics)
        if refused is not None and refused.focal_px is not None:
            height_m = refused.focal_height_pxm / refused.focal_px
            contradiction = max(contradiction, abs(math.log(height_m / belief.height_m)) / 2)
        self.belief = replace(belief, height_sigma=max(belief.height_sigma, contradiction))
        return self.belief != before


class _Recurring:
    """A value that recurs over frames."""

    def __init__(self, looks: int, max_spread: float = math.inf) -> None:
        self._looks, self._max_spread = looks, max_spread
        self._values: list[float] = []

    def add(self, value: float) -> float | None:
        """The median after enough looks that agree, else None; then the next looks count."""
        self._values.append(value)
        if len(self._values) < self._looks:
            return None
        low, middle, high = np.percentile(self._values, (25, 50, 75)).tolist()
        self._values.clear()
        return float(middle) if high - low <= self._max_spread * middle else None
