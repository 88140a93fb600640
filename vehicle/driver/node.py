"""Driver process: a game pad or keyboard in, the driver's demand out, at the rate of ``config/driver.yaml``.

Steering: δ = s·δ_max of the vehicle file. In an override by the throttle alone there is no angle: the controller
steers, so that a brake in a bend does not straighten the wheels. Throttle: the stick t demands the speed t·v_max,
which the acceleration

    a = (t·v_max - v)/T      within -brake..accel

approaches; a stick pulled back demands t·brake. By hand a centred throttle demands standstill. In an override of
the controller a centred throttle holds the speed, so that a correction of the steering does not brake the car.
While the speed is not known the demand is the hardest brake.
"""

from contextlib import closing

from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import DriverInput, Health
from trepid.processes.process import Process, Ticker, process
from trepid.topics import DRIVER_INPUT, VEHICLE_STATE
from vehicle.driver.settings import DriverSettings, load_driver
from vehicle.driver.sticks import Sticks, open_input

OLDEST_S = 0.2  # an older speed counts as unknown
SETTLE_S = 0.5  # T: of a driver's foot


class Driver:
    """Call ``step`` at a fixed rate."""

    def __init__(self, settings: DriverSettings, vehicle: Vehicle) -> None:
        self._settings = settings
        self._full_rad = vehicle.max_road_wheel_angle_rad
        self._armed = (
            False  # the dead man's switch was released since the device came or the stop was pressed
        )
        self._by_hand = False
        self._record = False
        self._before = Sticks()
        self._until_s = self._steers_until_s = -1.0  # end of an override, and of one of the steering

    def step(self, sticks: Sticks | None, speed_mps: float | None, *, now_s: float) -> DriverInput:
        """The demand at ``now_s``; ``sticks`` is None while the device is gone."""
        if sticks is None:
            self._armed = self._by_hand = False
            self._before = Sticks()
            self._until_s = self._steers_until_s = now_s
            return self._input(now_s, connected=False)
        before, self._before = self._before, sticks
        self._by_hand ^= sticks.hand and not before.hand
        self._record ^= sticks.record and not before.record
        self._armed = not sticks.stop and (self._armed or not sticks.dead_man)
        if not (self._armed and sticks.dead_man):
            self._until_s = self._steers_until_s = now_s
            return self._input(now_s)
        if abs(sticks.steering) > self._settings.override_above:
            self._until_s = self._steers_until_s = now_s + self._settings.release_s
        elif abs(sticks.throttle) > self._settings.override_above:
            self._until_s = now_s + self._settings.release_s
        if not self._by_hand and now_s >= self._until_s:
            return self._input(now_s, allowed=True)
        accel_mps2, goal_mps = self._speed(sticks.throttle, speed_mps)
        steers = self._by_hand or now_s < self._steers_until_s
        angle_rad = sticks.steering * self._full_rad if steers else None
        return self._input(now_s, allowed=True, demand=(angle_rad, accel_mps2, goal_mps))

    def _speed(self, throttle: float, speed_mps: float | None) -> tuple[float, float]:
        """Acceleration [m/s²] and speed [m/s] that the throttle demands."""
        settings = self._settings
        if speed_mps is None:
            return -settings.brake_mps2, 0.0
        if throttle < 0.0:
            return throttle * settings.brake_mps2, 0.0
        if throttle == 0.0 and not self._by_hand:
            return 0.0, speed_mps
        goal_mps = throttle * settings.max_speed_mps
        accel_mps2 = (goal_mps - speed_mps) / SETTLE_S
        return max(-settings.brake_mps2, min(settings.accel_mps2, accel_mps2)), goal_mps

    def _input(
        self,
        now_s: float,
        *,
        connected: bool = True,
        allowed: bool = False,
        demand: tuple[float | None, float, float] | None = None,
    ) -> DriverInput:
        angle_rad, accel_mps2, goal_mps = demand or (None, None, None)
        return DriverInput(
            t_s=now_s,
            connected=connected,
            allowed=allowed,
            override=demand is not None,
            road_wheel_angle_rad=angle_rad,
            accel_mps2=accel_mps2,
            speed_mps=goal_mps,
            record=self._record,
        )


def run(me: Process) -> None:
    """Read the device, step and publish until the process is to stop; the device may come and go."""
    settings = load_driver()
    driver = Driver(settings, load(CONFIG_DIR / "vehicle.yaml", Vehicle))
    state, send = me.bus.latest(VEHICLE_STATE, wakes=False), me.bus.publisher(DRIVER_INPUT)
    with closing(open_input(settings)) as device:
        me.ready()
        ticker = Ticker(settings.rate_hz)
        while me.running():
            ticker.sleep()
            ticker.due()
            now_s, newest = me.now_s(), state.refresh()
            known = newest is not None and now_s - newest.t_s <= OLDEST_S
            sticks = device.read(now_s=now_s)
            send(driver.step(sticks, newest.speed_mps if newest and known else None, now_s=now_s))
            if sticks is None:
                me.count_step(Health.WARN, f"{settings.device}: gone; plug it in again")
            else:
                me.count_step()


if __name__ == "__main__":
    with process() as me:
        run(me)
