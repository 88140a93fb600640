"""The stop button of the page: a stop holds, a release counts at standstill only, and no sender is needed."""

import pytest
from message_rig import SHUTTLE, command, state

from controller.limiter import build as build_limiter
from trepid.messages import StopRequest
from vehicle.actuators.node import ActuatorStep
from vehicle.driver.stop_button import OLDEST_S, StopButton
from vehicle.measurement.check import build as build_check

STOP, RELEASE = StopRequest(t_s=0.0, stop=True), StopRequest(t_s=0.0, stop=False)
MOVES, STANDS = state(speed_mps=5.0), state(speed_mps=0.0)
UNKNOWN = state(speed_mps=None)

SCRIPTED = frozenset({"speed_mps", "road_wheel_angle_rad", "yaw_rate_radps"})  # states of no car: range only


def press() -> StopButton:
    button = StopButton(standstill_mps=0.05)
    button.hear(STOP, MOVES, now_s=0.0)
    return button


def test_without_a_request_every_command_passes():
    button = StopButton(standstill_mps=0.05)
    for seen in (MOVES, STANDS, UNKNOWN, None):
        button.hear(None, seen, now_s=0.0)
        assert not button.stops and button.permit(command()) is not None


def test_a_moving_car_is_stopped_with_steering_and_a_standing_one_gets_no_command():
    button = press()
    assert button.stops and button.permit(command()) is not None
    button.hear(None, STANDS, now_s=9.0)
    assert not button.stops and button.permit(command()) is None and button.held


@pytest.mark.parametrize("seen", [MOVES, UNKNOWN, None])
def test_a_release_counts_only_at_a_known_standstill(seen):
    button = press()
    button.hear(RELEASE, seen, now_s=0.0)
    assert button.held and button.stops
    button.hear(RELEASE, STANDS, now_s=0.0)
    assert not button.held and button.permit(command()) is not None


def test_an_old_release_is_not_heard_and_an_old_stop_is():
    button = press()
    button.hear(RELEASE, STANDS, now_s=OLDEST_S + 0.1)
    assert button.held
    button = StopButton(standstill_mps=0.05)
    button.hear(STOP, MOVES, now_s=1e6)
    assert button.held


def test_behind_the_limiter_the_car_stops_stays_and_drives_on_after_the_release():
    node, button = (
        ActuatorStep(build_limiter(SHUTTLE), build_check(SHUTTLE, computed=SCRIPTED)),
        StopButton(standstill_mps=0.05),
    )
    speed_mps, speeds, request = 5.0, [], None
    for tick in range(1200):
        now_s = 0.01 * tick
        request = StopRequest(t_s=now_s, stop=tick == 100) if tick in (100, 900) else None
        seen = state(now_s, speed_mps=speed_mps)
        button.hear(request, seen, now_s=now_s)
        wanted = command(now_s, speed_mps=5.0, accel_mps2=1.0 if speed_mps < 5.0 else 0.0)
        applied = node.step(button.permit(wanted), now_s, seen, stop=button.stops, now_s=now_s)
        assert applied.command is not None
        speed_mps = max(0.0, speed_mps + 0.01 * applied.command.accel_mps2)
        speeds.append(speed_mps)
    stood = [tick for tick, speed in enumerate(speeds) if speed == 0.0]
    assert stood[0] < 350 and stood == list(
        range(stood[0], 900)
    )  # does not creep, and does not start by itself
    assert speeds[-1] > 1.0
