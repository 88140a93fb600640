"""An unknown camera by driving: odometry against the motion of the ground in the image (:mod:`.ground_fit`)."""

import math
from dataclasses import dataclass, replace
from enum import StrEnum

import cv2
import numpy as np

from perception.camera.grey import grey
from perception.camera.ground_fit import Optics, optics, turning
from perception.camera.ground_flow import GroundFlow, GroundInImage, track_corners
from perception.camera.road_lines import pitch_and_yaw
from trepid.car.camera import Camera
from trepid.types import Image


class StateOdometry(StrEnum):
    """What the vehicle states measure independently of the images."""

    NONE = "none"
    WAY = "way"
    WAY_AND_TURN = "way and turn"


MAX_WIDTH_PX = 480  # wider images are reduced
MIN_SPEED_MPS = 1.0
MIN_WAY_M, MAX_PAUSE_S = 0.15, 0.5  # between the frames of a pair; between two frames
MIN_CORNERS = 12  # of a pair
MAX_PAIRS = 150
JUDGED_EVERY = 25  # pairs
MAX_SHIFTS = 0.1, 0.01  # of ln f·h and of the horizon [f], by which the corners were warped wrongly
MAX_RESTARTS = 2  # for that; a hilly road never has one horizon


@dataclass(frozen=True)
class _Last:
    """The first frame of the next pair, the odometry of the last frame, and the way and turn in between."""

    image: Image
    t_s: float  # of the last frame
    speed_mps: float
    yaw_rate_radps: float | None
    way_m: float = 0.0
    turn_rad: float | None = 0.0
    since_s: float = 0.0

    def advance(self, t_s: float, speed_mps: float, yaw_rate_radps: float | None) -> "_Last":
        """After the next frame: trapezoidal sums of speed and yaw rate."""
        dt_s, turn_rad = t_s - self.t_s, self.turn_rad
        if turn_rad is not None and self.yaw_rate_radps is not None and yaw_rate_radps is not None:
            turn_rad += dt_s * (self.yaw_rate_radps + yaw_rate_radps) / 2
        else:
            turn_rad = None
        way_m = self.way_m + dt_s * (self.speed_mps + speed_mps) / 2
        return _Last(self.image, t_s, speed_mps, yaw_rate_radps, way_m, turn_rad, self.since_s + dt_s)


class DriveOptics:
    """Measures one camera from the frames of a drive, until enough pairs of frames are known."""

    def __init__(
        self,
        camera: Camera,
        odometry: StateOdometry = StateOdometry.WAY_AND_TURN,
        *,
        pairs: int = MAX_PAIRS,
    ) -> None:
        """``camera``: first values of focal length and mounting. Without odometry nothing is measured.

        ``pairs``: as many are enough, and half of them without a turn.
        """
        self._odometry, self._enough = odometry, pairs
        self._shape = camera.height_px, camera.width_px
        self._scale = min(1.0, MAX_WIDTH_PX / camera.width_px)
        self._size_px = round(camera.width_px * self._scale), round(camera.height_px * self._scale)
        small = camera.resize(*self._size_px)
        self._ground = GroundInImage(small, small.fx_px, small.fx_px * small.height_m)
        self._first_horizon_px = small.horizon_row_px
        self._pairs: list[GroundFlow] = []
        self._restarts = 0
        self._last: _Last | None = None

    @property
    def complete(self) -> bool:
        """Whether further frames add nothing."""
        return len(self._pairs) >= self._enough

    @property
    def pairs(self) -> int:
        """The number of pairs of frames."""
        return len(self._pairs)

    def step(
        self, image: Image, t_s: float, speed_mps: float | None, yaw_rate_radps: float | None
    ) -> Optics | None:
        """The camera as measured so far, after every 25th pair of frames; otherwise None."""
        if self.complete or self._odometry is StateOdometry.NONE or image.shape[:2] != self._shape:
            return None
        if self._odometry is StateOdometry.WAY:
            yaw_rate_radps = None
        last, self._last = self._last, None
        if speed_mps is None or not speed_mps >= MIN_SPEED_MPS:
            return None
        small = grey(image)
        if self._scale < 1:
            small = np.asarray(cv2.resize(small, self._size_px, interpolation=cv2.INTER_AREA), np.uint8)
        fresh = _Last(small, t_s, speed_mps, yaw_rate_radps)
        if last is None or not 0 < t_s - last.t_s < MAX_PAUSE_S:
            self._last = fresh
            return None
        last = last.advance(t_s, speed_mps, yaw_rate_radps)
        if last.way_m < MIN_WAY_M:
            self._last = last
            return None
        self._last = fresh
        return self.fit_optics() if self._add(last, small) and self.pairs % JUDGED_EVERY == 0 else None

    def _add(self, last: _Last, image: Image) -> bool:
        """Whether a pair of frames is a new one."""
        straight = sum(1 for one in self._pairs if not turning(one.turn_rad, one.dt_s))
        if straight >= self._enough // 2 and not turning(last.turn_rad, last.since_s):
            return False
        pair = track_corners(last.image, image, self._ground, last.way_m, last.turn_rad, last.since_s)
        if len(pair.before_px) < MIN_CORNERS:
            return False
        self._pairs.append(pair)
        return True

    def fit_optics(self) -> Optics | None:
        """The camera by all pairs, in pixels of its images; the next corners are tracked from there."""
        found = optics(self._pairs, self._ground.focal_px) if self._pairs else None
        if found is None:
            return None
        before, focal_px = self._ground, found.focal_px or self._ground.focal_px
        raised_px = self._first_horizon_px - before.camera.horizon_row_px
        self._ground = replace(before, focal_px=focal_px, focal_height_pxm=found.focal_height_pxm)
        camera = before.camera
        shift = math.log(found.focal_height_pxm / before.focal_height_pxm), found.horizon_px / camera.fx_px
        if np.any(np.abs(shift) > MAX_SHIFTS) and self._restarts < MAX_RESTARTS:
            self._restarts += 1
            lens = camera.model_copy(update={"fx_px": focal_px, "fy_px": focal_px})
            turned = pitch_and_yaw(lens.cx_px, camera.horizon_row_px - found.horizon_px, lens)
            self._ground = replace(self._ground, camera=lens.model_copy(update=turned))
            self._pairs.clear()
        return replace(found, horizon_px=found.horizon_px + raised_px).enlarge(1 / self._scale)
