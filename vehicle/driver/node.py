"""Driver process: a game pad or keyboard in, the driver's demand out, at the rate of ``config/driver.yaml``."""

from contextlib import closing

from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Health
from trepid.processes.process import Process, Ticker, process
from trepid.topics import DRIVER_INPUT, VEHICLE_STATE
from vehicle.driver.driver import Driver
from vehicle.driver.settings import load_driver
from vehicle.driver.sticks import open_input

OLDEST_S = 0.2  # an older speed counts as unknown


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
