"""Simulated-camera process: renders the road from the true pose."""

import time

import cv2

from sim_harness.lockstep.camera import SimulatedCamera
from sim_harness.scenarios.scenario import Scenario
from sim_harness.world.render.renderer import Renderer
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.images.jpeg import JpegEncoder
from trepid.messages import Health
from trepid.processes.process import Process, Ticker, process
from trepid.topics import CAMERA_COMPRESSED, CAMERA_IMAGE, SIM_TRUTH

STALE_TRUTH_S = 0.2  # older poses are not rendered


def run(me: Process) -> None:
    """One frame at every tick of the scenario's camera, and a JPEG of it."""
    scenario = Scenario.model_validate(me.options["scenario"])
    truth = me.bus.latest(SIM_TRUTH)
    send, send_compressed = me.bus.publisher(CAMERA_IMAGE), me.bus.publisher(CAMERA_COMPRESSED)
    renderer = Renderer(
        scenario.build_road(),
        load(CONFIG_DIR / "camera.yaml", Camera),
        seed=me.options["seed"],
        disturbances=scenario.disturbances,
        on_springs=scenario.plant.springs is not None,
    )
    renderer.prepaint()
    wheelbase_m = load(CONFIG_DIR / "vehicle.yaml", Vehicle).wheelbase_m
    camera = SimulatedCamera(scenario, renderer, wheelbase_m=wheelbase_m)
    me.ready()
    ticker, encoder = Ticker(scenario.camera.rate_hz), JpegEncoder()
    while me.running():
        ticker.sleep()
        me.bus.wait(timeout_s=0.0)  # discard the poses that arrived during the sleep
        me.bus.wait(timeout_s=0.1)  # render right after the vehicle has moved
        now_s, newest = me.now_s(), truth.refresh()
        if newest is None or now_s - newest.t_s > STALE_TRUTH_S:
            me.alive(Health.WARN, "no pose of the vehicle")
            continue
        if not ticker.due():
            continue
        frame = camera.step(newest, now_s=now_s)
        if frame is not None:
            send(frame)
            time.sleep(ticker.remaining_s() / 2)  # leaves the processor to perception first
            jpeg = encoder.step(frame)
            if jpeg is not None:
                send_compressed(jpeg)
        me.count_step()


if __name__ == "__main__":
    cv2.setNumThreads(1)
    with process() as me:
        run(me)
