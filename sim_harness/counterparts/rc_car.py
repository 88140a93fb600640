"""The simulated RC car behind its servo and speed controller: two pulses in, the car's true speed out.

The speed controller drives towards the speed of the pulse, a = (v(pulse) - v)/T, and holds the car with its drag
brake at neutral. Without pulses, as before a board is set up, both do nothing.
"""

from sim_harness.counterparts.car import CarBehindWire
from trepid.messages import Command
from trepid.processes.process import Process
from vehicle.actuators.rc.settings import RcSettings

SETTLE_S = 0.25  # T: differs from the model of the actuator, as in a real car
DRAG_MPS2 = 3.0
DEAD_US = 5.0  # around neutral


def motion_of(
    settings: RcSettings,
    pulses_us: tuple[float | None, float | None],
    speed_mps: float,
    most_mps2: float,
    *,
    now_s: float,
) -> Command:
    """The motion that servo and speed controller demand for steering and throttle pulse [µs]; None: no pulse."""
    steering_us, throttle_us = pulses_us
    throttle = settings.throttle
    driven = throttle_us is not None and abs(throttle_us - throttle.neutral_us) > DEAD_US
    goal_mps = throttle.speed_mps(throttle_us) if driven and throttle_us is not None else 0.0
    angle_rad = 0.0 if steering_us is None else settings.steering.angle_rad(steering_us)
    accel_mps2 = max(-DRAG_MPS2, min(most_mps2, (goal_mps - speed_mps) / SETTLE_S))
    return Command(t_s=now_s, road_wheel_angle_rad=angle_rad, speed_mps=goal_mps, accel_mps2=accel_mps2)


class RcCar:
    """Call ``step`` at the period of the plant."""

    def __init__(self, me: Process, settings: RcSettings) -> None:
        self._settings = settings
        self._car = CarBehindWire(me)
        self.period_s = self._car.settings.period_s
        self.speed_mps = 0.0
        self._begun = False

    def step(self, steering_us: float | None, throttle_us: float | None, *, now_s: float) -> None:
        """One period with these pulses; None: no pulse. The run begins with the first pulse that drives."""
        most_mps2 = self._car.vehicle.max_accel_mps2
        command = motion_of(
            self._settings, (steering_us, throttle_us), self.speed_mps, most_mps2, now_s=now_s
        )
        self._begun = self._begun or command.speed_mps > 0.0
        state = self._car.step(command if self._begun else None, now_s=now_s)
        self.speed_mps = state.speed_mps or 0.0
