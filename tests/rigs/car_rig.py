"""A small car without tyre slip, independent of the simulator."""

import math
from collections import deque

from controller.model.bicycle import angle_from_curvature, curvature_from_angle

FINE_S = 0.001


class Car:
    """Steering with dead time, lag and a limited rate; drive with lag; the path of the steady turn."""

    def __init__(self, vehicle, speed_mps=0.0, offset_rad=0.0):
        """``offset_rad``: tyres minus steering."""
        self.vehicle, self.offset_rad = vehicle, offset_rad
        self.speed_mps, self.accel_mps2, self.wheel_rad = speed_mps, 0.0, 0.0
        self._now_s, self._demand_rad = 0.0, 0.0
        self._coming = deque()

    @property
    def yaw_rate_radps(self):
        angle_rad = self.wheel_rad + self.offset_rad
        return self.speed_mps * curvature_from_angle(
            angle_rad, speed_mps=self.speed_mps, vehicle=self.vehicle
        )

    def steady_angle_rad(self, curvature_1pm, speed_mps):
        """Angle of the steering that holds a curvature."""
        return (
            angle_from_curvature(curvature_1pm, speed_mps=speed_mps, vehicle=self.vehicle) - self.offset_rad
        )

    def step(self, demand_rad, accel_mps2, seconds):
        """Drive with constant demands."""
        car = self.vehicle
        self._coming.append((self._now_s + car.steering_delay_s, demand_rad))
        turned = 1.0 - math.exp(-FINE_S / car.steering_lag_s)
        pushed = 1.0 - math.exp(-FINE_S / car.accel_lag_s)
        most_rad = car.max_road_wheel_rate_radps * FINE_S
        for _ in range(round(seconds / FINE_S)):
            while self._coming and self._coming[0][0] <= self._now_s + FINE_S / 2:
                self._demand_rad = self._coming.popleft()[1]
            self.wheel_rad += max(-most_rad, min(most_rad, turned * (self._demand_rad - self.wheel_rad)))
            self.accel_mps2 += pushed * (accel_mps2 - self.accel_mps2)
            self.speed_mps += self.accel_mps2 * FINE_S
            self._now_s += FINE_S
