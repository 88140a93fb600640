"""The process of the simulated vehicle."""

import pytest
from process_rig import until

from sim_harness.scenarios.scenario import load_scenario
from trepid.bus import free_endpoint, open_bus
from trepid.clock import epoch_clock, epoch_offset_ns
from trepid.messages import Command, StopRequest
from trepid.processes.launch import Fleet
from trepid.processes.settings import Loss, ProcessSpec
from trepid.topics import COMMAND, DIAGNOSTICS, STOP_REQUEST, VEHICLE_STATE
from vehicle.driver.stop_button import STOPPED

pytestmark = pytest.mark.processes


def test_a_stop_before_the_first_command_holds_the_car() -> None:
    offset_ns, endpoint = epoch_offset_ns(), free_endpoint()
    clock = epoch_clock(offset_ns)
    options = dict(scenario=load_scenario("straight").model_dump(mode="json"), seed=0)
    spec = ProcessSpec("vehicle", "sim_harness.live.vehicle_node", options, loss=Loss.NOTHING)
    with (
        open_bus("car", clock, listen=endpoint) as bus,
        Fleet((spec,), vehicle_name="car", endpoint=endpoint, clock_offset_ns=offset_ns),
    ):
        request, command = bus.publisher(STOP_REQUEST), bus.publisher(COMMAND)
        state, beats = bus.latest(VEHICLE_STATE), bus.stream(DIAGNOSTICS)
        fastest_mps = 0.0

        def drives(stop: bool | None) -> bool:
            """Whether the car moves, after a request and a command to speed up."""
            nonlocal fastest_mps
            if stop is not None:
                request(StopRequest(t_s=clock(), stop=stop))
            command(Command(t_s=clock(), road_wheel_angle_rad=0.0, speed_mps=5.0, accel_mps2=1.0))
            newest = state.take()
            fastest_mps = max(fastest_mps, (newest and newest.speed_mps) or 0.0)
            return fastest_mps > 1.0

        def is_held() -> bool:
            request(StopRequest(t_s=clock(), stop=True))
            return any(beat.message == STOPPED for beat, _ in beats.drain())

        assert until(is_held, patience_s=30)
        assert not until(lambda: drives(None), patience_s=2)
        assert fastest_mps == 0.0
        assert until(lambda: drives(False), patience_s=30)
