"""Simulated-vehicle process: commands in; the plant behind the limiter; state, truth and what it senses out."""

from dataclasses import replace

from controller.limiter import build as build_limiter
from sim_harness.live.release import Release
from sim_harness.lockstep.road_user_sensor import build_road_user_sensor
from sim_harness.lockstep.vehicle import SimulatedVehicle, load_simulator
from sim_harness.scenarios.scenario import LeadSensor, Scenario
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.messages import Health
from trepid.processes.journal import Timekeeper
from trepid.processes.process import Process, Ticker, process
from trepid.topics import COMMAND, LEAD_VEHICLE, ROAD_USERS, SIM_TRUTH, STOP_REQUEST, VEHICLE_STATE
from vehicle.driver.stop_button import STOPPED, StopButton


def run(me: Process) -> None:
    """Advance in real time at the period of the plant, with and without commands.

    The world stands until the launcher awaits no process any more and a command is based on a frame; the run begins
    then. Stop requests count from the start of the process.
    """
    scenario, settings = Scenario.model_validate(me.options["scenario"]), load_simulator()
    command, release = me.bus.latest(COMMAND), Release(me)
    send_state, send_truth = me.bus.publisher(VEHICLE_STATE), me.bus.publisher(SIM_TRUTH)
    send_lead, send_users = me.bus.publisher(LEAD_VEHICLE), me.bus.publisher(ROAD_USERS)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    limiter = build_limiter(vehicle)
    simulated = SimulatedVehicle(
        scenario,
        scenario.build_road(),
        vehicle,
        limiter,
        settings,
        seed=me.options["seed"],
    )
    request = me.bus.latest(STOP_REQUEST)
    button = StopButton(vehicle.standstill_mps)
    state = None
    publishes_lead = scenario.leads_by is LeadSensor.TRUTH
    user_sensor = build_road_user_sensor(scenario.road_users_by, seed=me.options["seed"])
    me.ready()
    begun = False
    times = Timekeeper(me.bus, me.name, me.now_s)
    ticker, sensor_ticker = Ticker(1 / settings.period_s), Ticker(LEAD_VEHICLE.rate_hz)
    while me.running():
        ticker.sleep()
        ticker.due()
        fresh = command.take()
        begun = begun or (release.is_granted() and fresh is not None and fresh.t_s is not None)
        began_s = me.now_s()
        button.hear(request.take(), state, now_s=began_s)
        if begun:
            if button.stops:
                simulated.stop()
            permitted = button.permit(command.message)
            state, truth = simulated.step(permitted, command.received_s, now_s=began_s)
            if fresh is not None:
                times.note(fresh.t_s, command, began_s=began_s)
        else:
            state, truth = simulated.wait(now_s=began_s)
        send_state(replace(state, stop_pressed=button.held))
        send_truth(truth)
        if sensor_ticker.due():
            if publishes_lead and (lead := simulated.sense_lead()) is not None:
                send_lead(lead)
            if user_sensor is not None and (users := user_sensor.step(simulated)) is not None:
                send_users(users)
        stopped = STOPPED if button.held else limiter.stop_reason
        said = "; ".join(filter(None, (stopped, *simulated.sensors.doubts)))
        me.count_step(Health.WARN if said else Health.OK, said)


if __name__ == "__main__":
    with process() as me:
        run(me)
