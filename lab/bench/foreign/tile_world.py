"""A robot with two driven wheels on floor tiles, as a world: entry point ``trepid.worlds``, name ``tiles``.

It uses what every other package may use: :mod:`sim_harness.lockstep.foreign`, and camera and vehicle of the car.
"""

import cmath
import math
from pathlib import Path

import cv2
import numpy as np

from lab.bench.foreign.tile_files import tile_files
from lab.bench.foreign.tile_track import TILE_PX, read_track
from sim_harness.lockstep.foreign import WorldState
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.messages import Command
from trepid.types import Image

WALL = (150, 160, 150)  # above the horizon, and the floor beside the tiles
FLOOR = (70, 75, 80)
NOISE, LIGHT = 4.0, (0.6, 1.1)  # grey levels; brightness, drawn once
LAG_S = 0.08  # of the wheels' speeds
APART_M = 0.102  # of the middles of the wheels
FASTEST_MPS = 1.2  # of a wheel


class Tiles:
    """The track of a map. The car starts on the first straight, in the middle of the right half of the road."""

    def __init__(
        self, camera: Camera, vehicle: Vehicle, *, seed: int, map: str, look: str = "photos", files: str = ""
    ) -> None:
        """``map``, ``look``: names in the package of tiles; ``files``: its folder, by default in the cache."""
        folder = Path(files) if files else tile_files()
        self.track = read_track(
            folder / "maps" / f"{map}.yaml", folder / "textures" / "tiles-processed" / look
        )
        self._floor = self.track.draw()
        self._camera, self._wheelbase_m = camera, vehicle.wheelbase_m
        self._random = np.random.default_rng(seed)
        self._light = self._random.uniform(*LIGHT)
        self._left_mps = self._right_mps = 0.0
        self._angle_rad = 0.0  # of the commands, with the lag of the wheels
        straight = [number for number, piece in enumerate(self.track.pieces) if piece.curvature_1pm == 0.0]
        self._laps = 0
        self._put(straight[0], 0.0)

    def state(self) -> WorldState:
        """Pose, speed and place in the lane."""
        speed_mps, yaw_rate_radps = self._motion()
        before_m = math.fsum(piece.length_m for piece in self.track.pieces[: self._place.number])
        return WorldState(
            x_m=self._at.real,
            y_m=self._at.imag,
            yaw_rad=self._yaw_rad,
            speed_mps=max(speed_mps, 0.0),
            yaw_rate_radps=yaw_rate_radps,
            road_wheel_angle_rad=self._angle_rad,
            station_m=self._laps * self.track.length_m + before_m + self._place.along_m,
            lateral_offset_m=self._place.offset_m,
            heading_error_rad=self._place.heading_rad,
            lane_width_m=self._place.width_m,
        )

    def curvature_at(self, ahead_m: float) -> float:
        """By the pieces of the track."""
        return self.track.curvature_at(self._place.number, self._place.along_m + ahead_m)

    def advance(self, command: Command, period_s: float) -> None:
        """The wheels follow their speeds with a lag; the robot moves on an arc."""
        speed_mps = max(self._motion()[0] + command.accel_mps2 * period_s, 0.0)
        half = math.tan(command.road_wheel_angle_rad) / self._wheelbase_m * APART_M / 2
        share = min(period_s / LAG_S, 1.0)
        self._angle_rad += (command.road_wheel_angle_rad - self._angle_rad) * share
        left_mps, right_mps = (min(speed_mps * (1 + side * half), FASTEST_MPS) for side in (-1, 1))
        # the drive is as quick as the command; the difference of the wheels is late
        middle_mps = (left_mps + right_mps) / 2
        late_mps = (self._right_mps - self._left_mps) / 2
        late_mps += ((right_mps - left_mps) / 2 - late_mps) * share
        self._left_mps, self._right_mps = middle_mps - late_mps, middle_mps + late_mps
        way_m, turned_rad = (value * period_s for value in self._motion())
        self._at += way_m * cmath.exp(1j * (self._yaw_rad + turned_rad / 2))
        self._yaw_rad += turned_rad
        self._look_around()

    def recentre(self) -> None:
        """Onto the middle of the lane, along it."""
        length_m = self.track.pieces[self._place.number].length_m
        self._put(self._place.number, min(max(self._place.along_m, 0.0), length_m))

    def picture(self) -> Image:
        """The floor through the camera, by one homography, with noise."""
        camera, pixel_m = self._camera, self.track.tile_m / TILE_PX
        pose = cmath.exp(1j * self._yaw_rad)
        height_px = len(self._floor)
        east, north = self._at.real, self._at.imag
        floor_from_car = [
            [pose.real / pixel_m, -pose.imag / pixel_m, east / pixel_m],
            [-pose.imag / pixel_m, -pose.real / pixel_m, height_px - north / pixel_m],
            [0.0, 0.0, 1.0],
        ]
        seen = cv2.warpPerspective(
            self._floor,
            camera.pixel_from_road_matrix @ np.linalg.inv(floor_from_car),
            (camera.width_px, camera.height_px),
            flags=cv2.INTER_LINEAR,
            borderValue=FLOOR,
        )
        seen[: max(math.ceil(camera.horizon_row_px) + 1, 0)] = WALL
        return np.clip(self._light * seen + self._random.normal(0.0, NOISE, seen.shape), 0, 255).astype(
            np.uint8
        )

    def _motion(self) -> tuple[float, float]:
        """Speed and yaw rate."""
        return (self._left_mps + self._right_mps) / 2, (self._right_mps - self._left_mps) / APART_M

    def _put(self, number: int, along_m: float) -> None:
        """Into the middle of the lane, along it."""
        piece, (aside_m, slope, _) = self.track.pieces[number], self.track.lane(number, along_m)
        turned_rad = along_m * piece.curvature_1pm
        chord_m = 2 / piece.curvature_1pm * math.sin(turned_rad / 2) if turned_rad else along_m
        heading_rad = piece.yaw_rad + turned_rad
        self._at = complex(piece.x_m, piece.y_m) + chord_m * cmath.exp(1j * (piece.yaw_rad + turned_rad / 2))
        self._at += 1j * aside_m * cmath.exp(1j * heading_rad)
        self._yaw_rad = heading_rad + math.atan(slope)
        self._place = self.track.place(self._at.real, self._at.imag, self._yaw_rad, number)

    def _look_around(self) -> None:
        """The place in the lane; a lap ends where the first piece follows the last."""
        before, count = self._place.number, len(self.track.pieces)
        self._place = self.track.place(self._at.real, self._at.imag, self._yaw_rad, before)
        late, early = count * 3 // 4, count // 4
        onward = before > late and self._place.number < early
        back = before < early and self._place.number > late
        self._laps += onward - back
