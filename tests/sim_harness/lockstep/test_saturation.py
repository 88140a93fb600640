"""Saturation, from the limiter up: quiet when tracking is fine, prompt when it is not, and the car slows down."""

import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE, command, decision, state

from controller.controller import Controller
from controller.limiter import build
from sim_harness.lockstep.closed_loop import ClosedLoop, build_parts
from sim_harness.lockstep.vehicle import load_simulator
from sim_harness.scenarios.scenario import Sight, load_scenario

TICK_S = 0.01
NORMAL = ("circuit", "s_curve", "hairpin", "steering_lag", "loaded", "alks_left_r250")


def drive_seeing(name, duration_s=12.0, **changes):
    """States that the vehicle reported while the stack drove ``name`` with true sight."""
    scenario = load_scenario(name).model_copy(
        update=dict(sight=Sight.TRUTH, duration_s=duration_s, faults=(), **changes)
    )
    parts = build_parts(scenario, seed=0)
    states, step = [], parts.vehicle.step

    def listening(*args, **kwargs):
        reported = step(*args, **kwargs)
        states.append(reported[0])
        return reported

    parts.vehicle.step = listening
    ClosedLoop(scenario, parts, load_simulator()).drive()
    return states


@pytest.mark.parametrize("name", NORMAL)
def test_a_normal_drive_is_never_saturated_and_never_handed_over(name):
    states = drive_seeing(name)
    moving = [reported for reported in states if reported.speed_mps > 2.0]
    assert len(moving) > 500
    assert not any(reported.saturated for reported in states)
    assert not any(reported.driver_override for reported in states if reported.t_s >= 0.0)


def test_a_bend_too_tight_for_the_speed_saturates_within_half_a_second():
    limiter, reported = build(), []
    for tick in range(60):
        now_s = TICK_S * tick
        known = state(now_s, speed_mps=15.0)
        limiter.step(command(now_s, road_wheel_angle_rad=0.2), now_s, known, now_s=now_s)
        reported.append(limiter.report(known).saturated)
    assert reported[0] is False
    assert reported[50] is True


def test_the_controller_plans_bends_slower_while_the_steering_is_cut():
    goals = {}
    for saturated in (None, False, True):
        one = Controller(SHUTTLE, SETTINGS)
        bend = decision(0.0, curvature_1pm=0.05, speed_cap_mps=20.0)
        goals[saturated] = one.step(bend, state(0.0, speed_mps=6.0, saturated=saturated), now_s=0.0).speed_mps
    assert goals[None] == goals[False] > 1.3 * goals[True] > 0.0
