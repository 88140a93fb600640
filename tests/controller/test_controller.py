"""The controller step: good inputs drive, anything else brakes, left is the mirror image of right."""

import math
from dataclasses import fields, replace
from itertools import pairwise

import pytest
from controller_rig import SETTINGS, G
from hypothesis import given, settings
from hypothesis import strategies as st
from message_rig import SHUTTLE, command, decision, state, vehicle

from controller.controller import Controller, build
from controller.model.bicycle import angle_from_curvature, curvature_from_angle
from trepid.config import CONFIG_DIR, InputError
from trepid.messages import Command, Decision, Losses, Mode, Stop, VehicleState
from trepid.processes.lateness import RECOVERED

NUMBERS = (
    *((Decision, f.name) for f in fields(Decision) if "float" in str(f.type) and "tuple" not in str(f.type)),
    *((VehicleState, f.name) for f in fields(VehicleState) if "float" in str(f.type)),
)
BAD = (math.nan, math.inf, -math.inf)
INPUTS = SETTINGS.inputs


def controller(car=SHUTTLE):
    return Controller(car, SETTINGS)


LOST = {"lateral_offset_m": None, "heading_error_rad": None, "curvature_1pm": None, "path_t_s": None}


def rolling(seconds=2.0, **changes):
    """A controller that has kept the lane for a while, and the time after that."""
    one = controller()
    for n in range(round(seconds / 0.02)):
        last = one.step(decision(0.02 * n, **changes), state(0.02 * n, speed_mps=4.0), now_s=0.02 * n)
    return one, seconds, last


def finite(one: Command) -> bool:
    return all(
        math.isfinite(value)
        for value in (one.road_wheel_angle_rad, one.speed_mps, one.accel_mps2, one.road_wheel_rate_radps)
    ) and (one.t_s is None or math.isfinite(one.t_s))


def test_a_straight_lane_below_the_speed_cap_is_driven_straight_and_faster():
    _, _, last = rolling()
    assert last.road_wheel_angle_rad == 0.0
    assert last.accel_mps2 > 0.5
    assert last.speed_mps == 5.0


def test_while_a_driver_drives_nothing_is_demanded_and_the_hand_over_is_smooth():
    """A demand that did not wait at 0 would brake by 1 m/s² at the hand-over."""
    one = controller()
    for n in range(100):
        driven = replace(state(0.02 * n, speed_mps=4.0), driver_override=True)
        last = one.step(decision(0.02 * n, mode=Mode.STOP, stop=Stop.COMFORT), driven, now_s=0.02 * n)
        assert last.accel_mps2 == 0.0
    assert abs(one.step(decision(2.0), state(2.0, speed_mps=4.0), now_s=2.0).accel_mps2) < 0.1


def test_inputs_lost_under_a_driver_do_not_brake_after_the_hand_over():
    """As when processes start one after the other in a car that is driven already."""
    one = controller()
    for n in range(200):
        one.step(None, replace(state(0.02 * n, speed_mps=4.0), driver_override=True), now_s=0.02 * n)
    assert abs(one.step(decision(4.0), state(4.0, speed_mps=4.0), now_s=4.0).accel_mps2) < 0.1


def test_the_command_carries_the_capture_time_of_the_frame():
    one = controller()
    assert one.step(decision(1.0, t_s=0.93), state(1.0), now_s=1.0).t_s == 0.93
    assert one.step(decision(1.0, t_s=None), state(1.0), now_s=1.0).t_s is None
    assert one.step(None, state(1.0), now_s=1.0).t_s is None


def test_from_standstill_it_releases_the_brake_and_drives_off():
    one = controller()
    commands = [
        one.step(decision(0.02 * n, curvature_1pm=0.05), state(0.02 * n, speed_mps=0.0), now_s=0.02 * n)
        for n in range(100)
    ]
    assert commands[0].accel_mps2 == -SETTINGS.speed.hold_decel_mps2
    assert commands[-1].accel_mps2 == SETTINGS.speed.max_accel_mps2
    assert commands[-1].road_wheel_angle_rad == pytest.approx(
        angle_from_curvature(0.05, speed_mps=0.0, vehicle=SHUTTLE), rel=0.1
    )


def test_in_a_steady_bend_it_adds_the_understeer_angle():
    one = controller()
    curvature, speed = 1 / 100, 12.0
    angle = angle_from_curvature(curvature, speed_mps=speed, vehicle=SHUTTLE)
    for n in range(50):
        t = 0.02 * n
        received = decision(t, curvature_1pm=curvature, speed_cap_mps=12.0)
        known = state(t, speed_mps=speed, road_wheel_angle_rad=angle, yaw_rate_radps=speed * curvature)
        last = one.step(received, known, now_s=t)
    assert last.road_wheel_angle_rad == pytest.approx(angle, abs=1e-3)


WRONG = {
    "no decision": (None, {}),
    "an old decision": ({"decided_s": 1.7}, {}),
    "a decision from the future": ({"decided_s": 3.0}, {}),
    "no state": ({}, None),
    "an old state": ({}, {"t_s": 1.7}),
    "a state from the future": ({}, {"t_s": 3.0}),
    "no speed": ({}, {"speed_mps": None}),
    "an impossible speed": ({}, {"speed_mps": 500.0}),
    "an impossible wheel angle": ({}, {"road_wheel_angle_rad": 4.0}),
    "an impossible yaw rate": ({}, {"yaw_rate_radps": 90.0}),
    "STOP": ({"mode": Mode.STOP, "stop": Stop.COMFORT}, {}),
    "STOP without saying how": ({"mode": Mode.STOP}, {}),
    "an emergency stop": ({"mode": Mode.STOP, "stop": Stop.EMERGENCY}, {}),
    "a cap of zero": ({"speed_cap_mps": 0.0}, {}),
    "a negative cap": ({"speed_cap_mps": -3.0}, {}),
}


@pytest.mark.parametrize("what", WRONG)
def test_missing_old_impossible_inputs_and_mode_stop_brake_at_once(what):
    received, known = WRONG[what]
    one, now_s, _ = rolling()
    received = None if received is None else decision(now_s, **received)
    known = None if known is None else state(now_s, **known)
    output = one.step(received, known, now_s=now_s)
    assert output.accel_mps2 < 0.0
    assert finite(output)
    assert output.speed_mps == 0.0


def with_value(received, known, message, name, value):
    """The decision and the state, of which the one of type ``message`` has ``value`` in the field ``name``."""
    change = {name: value}
    return (
        (replace(received, **change), known) if message is Decision else (received, replace(known, **change))
    )


@pytest.mark.parametrize("message,name", NUMBERS)
@pytest.mark.parametrize("value", BAD)
def test_a_number_that_is_not_finite_never_drives_and_never_reaches_the_command(message, name, value):
    one, now_s, last = rolling()
    received, known = decision(now_s), state(now_s)
    received, known = with_value(received, known, message, name, value)
    output = one.step(received, known, now_s=now_s)
    assert finite(output)
    assert output.accel_mps2 < 0.0 < last.accel_mps2


@pytest.mark.parametrize("field", ["rule_strengths", "trust"])
def test_a_list_with_a_number_that_is_not_finite_never_drives(field):
    one, now_s, _ = rolling()
    assert one.step(decision(now_s, **{field: (0.5, math.nan)}), state(now_s), now_s=now_s).accel_mps2 < 0.0


anything = st.one_of(st.none(), st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3))
required = st.one_of(st.floats(allow_nan=True, allow_infinity=True), st.floats(-3, 3))


@settings(max_examples=150)
@given(st.data())
def test_random_inputs_give_a_bounded_command(data):
    one = controller()
    for n in range(4):
        now_s = 0.02 * n
        received, known = decision(now_s), state(now_s)
        for message, name in data.draw(st.lists(st.sampled_from(NUMBERS), max_size=6)):
            optional = "None" in str(message.__dataclass_fields__[name].type)
            value = data.draw(anything if optional else required)
            received, known = with_value(received, known, message, name, value)
        output = one.step(received, known, now_s=now_s)
        assert finite(output)
        assert abs(output.road_wheel_angle_rad) <= SHUTTLE.max_road_wheel_angle_rad
        assert -4.0 <= output.accel_mps2 <= SETTINGS.speed.max_accel_mps2


signed = st.floats(-0.3, 0.3)


@settings(max_examples=50)
@given(st.lists(st.tuples(signed, signed, signed, signed, signed, signed), min_size=1, max_size=8))
def test_the_mirrored_world_gets_the_mirrored_command(scenes):
    left, right = controller(), controller()
    for n, (offset, heading, curvature, rate, wheel, yaw) in enumerate(scenes):
        now_s = 0.02 * n
        commands = [
            one.step(
                decision(
                    now_s,
                    lateral_offset_m=sign * offset,
                    heading_error_rad=sign * heading,
                    curvature_1pm=sign * curvature,
                    curvature_rate_1pm2=sign * 0.1 * rate,
                ),
                state(now_s, road_wheel_angle_rad=sign * wheel, yaw_rate_radps=sign * yaw),
                now_s=now_s,
            )
            for one, sign in ((left, 1), (right, -1))
        ]
        assert commands[0].road_wheel_angle_rad == -commands[1].road_wheel_angle_rad
        assert commands[0].accel_mps2 == commands[1].accel_mps2


def test_the_same_inputs_give_the_same_command_bit_for_bit():
    scenes = [(0.1 * math.sin(n), 0.01 * math.cos(n)) for n in range(50)]

    def run():
        one = controller()
        return [
            one.step(decision(0.02 * n, lateral_offset_m=e, curvature_1pm=k), state(0.02 * n), now_s=0.02 * n)
            for n, (e, k) in enumerate(scenes)
        ]

    assert run() == run()


def silent(one, now_s, seconds, **changes):
    """Commands while no decision comes, every 20 ms."""
    return [
        one.step(None, state(t, **changes), now_s=t)
        for t in (now_s + 0.02 * (n + 1) for n in range(round(seconds / 0.02)))
    ]


def test_missing_decisions_escalate_from_a_comfort_to_an_emergency_stop():
    one, now_s, _ = rolling()
    output = silent(one, now_s, 3.0)
    before = [c.accel_mps2 for c in output[: round((INPUTS.lost_s - 0.04) / 0.02)]]
    speed = SETTINGS.speed  # brakes without effect are identified as a hill, which is compensated
    assert -speed.comfort.decel_mps2 - speed.max_load_mps2 <= min(before) <= -speed.comfort.decel_mps2
    assert -4.0 <= output[-1].accel_mps2 <= -speed.emergency.decel_mps2


def test_an_emergency_stop_of_the_controller_latches_until_standstill():
    one, now_s, _ = rolling()
    now_s += len(silent(one, now_s, 2.0)) * 0.02
    for n in range(100):
        t = now_s + 0.02 * n
        moving = one.step(decision(t), state(t), now_s=t)
    assert moving.accel_mps2 <= -SETTINGS.speed.emergency.decel_mps2
    for n in range(100, 300):
        t = now_s + 0.02 * n
        standing = one.step(decision(t), state(t, speed_mps=0.0), now_s=t)
    assert standing.accel_mps2 > 0.0


def test_a_short_gap_in_the_decisions_does_not_stop_the_car():
    one, now_s, _ = rolling()
    now_s += len(silent(one, now_s, 0.4)) * 0.02
    for n in range(100):
        t = now_s + 0.02 * n
        again = one.step(decision(t), state(t), now_s=t)
    assert again.speed_mps == 5.0
    assert again.accel_mps2 > -0.2  # brakes without effect are identified as a hill, which is compensated


@pytest.mark.parametrize("late", ["decision", "state"])
def test_a_late_decision_or_state_brakes_until_some_come_in_time_while_the_car_is_steered(late):
    one, now_s, _ = rolling(curvature_1pm=0.02)
    now_s -= 0.02
    limit_s = max(INPUTS.late.periods * 0.02, INPUTS.late.least_s)
    accels, angles = [], []
    for n in range(1, 15):
        t = now_s + 0.01 * n
        newest = {"decision": t, "state": t} | {late: now_s}
        out = one.step(
            decision(newest["decision"], curvature_1pm=0.02), state(newest["state"], speed_mps=4.0), now_s=t
        )
        accels.append(out.accel_mps2)
        angles.append(out.road_wheel_angle_rad)
    in_time = math.floor(limit_s / 0.01 - 0.5)
    assert min(accels[:in_time]) > 0.5
    assert max(accels[in_time + 1 :]) <= 0.0
    assert accels[-1] < accels[in_time + 1]
    assert min(angles) > 0.0
    times_s = [t + 0.02 * n for n in range(1, RECOVERED + 2)]
    back = [one.step(decision(t), state(t, speed_mps=4.0), now_s=t).speed_mps for t in times_s]
    assert back == [0.0] * RECOVERED + [5.0]


def test_a_lost_process_stops_the_car_whatever_the_decision_says():
    one, now_s, _ = rolling()
    for losses, goes in ((Losses(t_s=now_s, stop=(), slow=("horn",)), True), (None, True)):
        out = one.step(decision(now_s), state(now_s, speed_mps=4.0), now_s=now_s, losses=losses)
        assert (out.speed_mps > 0.0) is goes
    lost = Losses(t_s=now_s, stop=("supervisor",), slow=())
    out = one.step(decision(now_s), state(now_s, speed_mps=4.0), now_s=now_s + 0.02, losses=lost)
    assert out.speed_mps == 0.0 and out.accel_mps2 <= 0.0


def test_a_malformed_input_brakes_until_a_good_one_comes_and_the_car_is_still_steered():
    one, now_s, _ = rolling(curvature_1pm=0.03)
    for n, malformed in enumerate([True] * 8 + [False], start=1):
        t = now_s + 0.02 * n
        out = one.step(decision(t, curvature_1pm=0.03), state(t, speed_mps=4.0), now_s=t, malformed=malformed)
        assert (out.speed_mps == 0.0) is malformed
        assert out.accel_mps2 <= 0.0 or not malformed
        assert out.road_wheel_angle_rad > 0.0


def test_without_a_path_the_car_follows_the_remembered_one_then_holds_the_curvature_and_brakes():
    curvature = 0.03
    one, now_s, _ = rolling(curvature_1pm=curvature)
    output = [
        one.step(
            decision(now_s + 0.02 * n, **LOST),
            state(now_s + 0.02 * n, speed_mps=4.0, road_wheel_angle_rad=0.0542, yaw_rate_radps=4 * curvature),
            now_s=now_s + 0.02 * n,
        )
        for n in range(200)
    ]
    assert output[0].accel_mps2 > 0.0 > output[30].accel_mps2
    held = [c.road_wheel_angle_rad for c in output[130:]]
    assert max(held) - min(held) <= 3e-4  # learning moves it a little
    assert min(held) > 0.0


@pytest.mark.parametrize("side", [1, -1])
def test_a_car_that_loses_its_path_while_it_corrects_stops_along_the_remembered_lane(side):
    one, now_s, _ = rolling(lateral_offset_m=0.0)
    offset_m, heading_rad, speed_mps, wheel_rad = side * 0.4, 0.0, 4.0, 0.0
    for n in range(400):
        t = now_s + 0.02 * n
        received = dict(lateral_offset_m=offset_m, heading_error_rad=heading_rad)
        reported = decision(t, **(received if n < 25 else LOST))
        rate_radps = speed_mps * math.tan(wheel_rad) / SHUTTLE.wheelbase_m
        moving = state(t, speed_mps=speed_mps, road_wheel_angle_rad=wheel_rad, yaw_rate_radps=rate_radps)
        output = one.step(reported, moving, now_s=t)
        wheel_rad += 0.02 / 0.1 * (output.road_wheel_angle_rad - wheel_rad)
        offset_m, heading_rad = (
            offset_m + 0.02 * speed_mps * math.sin(heading_rad),
            heading_rad + 0.02 * rate_radps,
        )
        speed_mps = max(speed_mps + 0.02 * output.accel_mps2, 0.0)
        if n == 24:
            assert side * heading_rad < -0.02  # it was turning towards the middle
    assert speed_mps == 0.0
    assert abs(heading_rad) < 0.03
    assert abs(offset_m) < 0.2


def test_a_demanded_emergency_stop_is_made_also_without_a_path():
    def hardest(stop: Stop) -> float:
        one, now_s, _ = rolling()
        output = decision(now_s, mode=Mode.STOP, stop=stop, **LOST)
        times_s = [now_s + 0.02 * n for n in range(1, 100)]
        return min(
            one.step(replace(output, decided_s=t, t_s=t), state(t, speed_mps=6.0), now_s=t).accel_mps2
            for t in times_s
        )

    assert hardest(Stop.EMERGENCY) < 2.0 * hardest(Stop.COMFORT) < 0.0


def test_held_curvature_needs_less_wheel_as_the_speed_falls():
    one, now_s, _ = rolling(curvature_1pm=0.03)
    fast, slow = (
        one.step(None, state(t, speed_mps=v), now_s=t).road_wheel_angle_rad
        for t, v in ((now_s + 3.0, 10.0), (now_s + 3.02, 0.0))
    )
    understeer = SHUTTLE.understeer_gradient_rad_per_mps2 * 100.0
    assert fast - slow == pytest.approx((slow and math.tan(slow) / 1.75) * understeer)
    assert slow > 0.0


def test_without_a_state_it_holds_the_wheel():
    one, now_s, _ = rolling(curvature_1pm=0.03)
    last = one.step(decision(now_s, curvature_1pm=0.03), state(now_s), now_s=now_s)
    blind = one.step(decision(now_s + 0.02), None, now_s=now_s + 0.02)
    assert blind.road_wheel_angle_rad == last.road_wheel_angle_rad != 0.0


def test_without_any_path_the_controller_keeps_the_wheel_angle():
    output = controller().step(None, state(road_wheel_angle_rad=0.2), now_s=0.0)
    assert output.road_wheel_angle_rad == pytest.approx(0.2)


IMPOSSIBLE_PATHS = {
    "lateral_offset_m": 50.0,
    "heading_error_rad": 3.0,
    "curvature_1pm": 5.0,
    "curvature_rate_1pm2": 0.4,  # 4 1/m at the axle, ten metres before the look-ahead
    "lookahead_m": -1.0,
}


@pytest.mark.parametrize("name", IMPOSSIBLE_PATHS)
def test_an_impossible_path_is_no_path(name):
    output = controller().step(decision(**{name: IMPOSSIBLE_PATHS[name]}), state(), now_s=0.0)
    assert output.accel_mps2 < 0.0
    assert output.road_wheel_angle_rad == 0.0


def test_an_unknown_curvature_rate_is_an_arc():
    arc, known = (
        controller().step(decision(curvature_1pm=0.05, curvature_rate_1pm2=rate), state(), now_s=0.0)
        for rate in (None, 0.0)
    )
    assert arc == known


def test_a_clock_that_runs_backwards_changes_no_demand():
    one, now_s, last = rolling()
    again = one.step(decision(now_s - 1.0), state(now_s - 1.0, speed_mps=4.0), now_s=now_s - 1.0)
    assert again.accel_mps2 == last.accel_mps2


def test_an_oversteering_car_keeps_below_its_critical_speed():
    car = vehicle(understeer_gradient_rad_per_mps2=-math.radians(2.0) / G)
    one = Controller(car, SETTINGS)
    output = one.step(decision(speed_cap_mps=60.0), state(speed_mps=40.0), now_s=0.0)
    assert output.speed_mps < math.sqrt(1.75 / (math.radians(2.0) / G))
    assert finite(output)


def test_the_shipped_configuration_drives_the_default_car():
    output = build().step(decision(), state(), now_s=0.0)
    assert output == controller().step(decision(), state(), now_s=0.0) != command()


def test_a_gain_too_high_for_the_drive_is_refused_with_its_bound():
    with pytest.raises(
        InputError, match=r"controller\.yaml: speed\.gain_1ps 0\.8 is too high.*at most 0\.25"
    ):
        build(vehicle(accel_lag_s=1.0), CONFIG_DIR / "controller.yaml")


@pytest.mark.parametrize("steps", [500, 40])  # of the driver; the path is forgotten after 25
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_after_a_driver_without_a_path_the_wheels_are_held_as_he_left_them(side, steps):
    one, now_s, _ = rolling(curvature_1pm=0.02 * side)
    for n in range(steps):
        now_s += 0.02
        wheel_rad = 0.035 * side if n < steps - 300 else 0.0
        driven = replace(state(now_s, speed_mps=6.0, road_wheel_angle_rad=wheel_rad), driver_override=True)
        one.step(decision(now_s, mode=Mode.STOP, stop=Stop.COMFORT, **LOST), driven, now_s=now_s)
    for _ in range(50):
        now_s += 0.02
        stopped = decision(now_s, mode=Mode.STOP, stop=Stop.COMFORT, **LOST)
        last = one.step(stopped, state(now_s, speed_mps=6.0), now_s=now_s)
    assert last.road_wheel_angle_rad == pytest.approx(0.0, abs=1e-3)


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("driven_rad", [0.0, 0.03])
def test_a_path_withdrawn_before_the_first_drive_gives_way_to_the_curvature_of_the_driver(side, driven_rad):
    """A supervisor in its first STOP gives a path for half a second after the hand-over, then none any more."""
    one, stop = controller(), dict(mode=Mode.STOP, stop=Stop.COMFORT)
    commands = []
    for n in range(120):
        now_s = 0.02 * n
        held = replace(state(now_s, speed_mps=6.0, road_wheel_angle_rad=driven_rad), driver_override=n < 50)
        path = dict(curvature_1pm=0.02 * side) if n < 75 else LOST
        commands.append(one.step(decision(now_s, **stop, **path), held, now_s=now_s))
    followed, withdrawn = commands[60:75], commands[76:]
    assert min(side * (c.road_wheel_angle_rad - driven_rad) for c in followed) > 0.01
    aside_rad = [abs(c.road_wheel_angle_rad - driven_rad) for c in (followed[-1], *withdrawn)]
    assert max(later - earlier for earlier, later in pairwise(aside_rad)) < 1e-3  # no jump outwards
    assert [c.road_wheel_angle_rad for c in withdrawn[20:]] == pytest.approx([driven_rad] * 24, abs=2e-3)
    assert max(c.accel_mps2 for c in withdrawn) <= 0.0


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_path_withdrawn_before_the_first_drive_gives_way_to_the_line_of_the_driver(side):
    """The path of a supervisor in its first STOP is 0.4 m aside for half a second, and the car turns to it."""
    one, stop, speed_mps = controller(), dict(mode=Mode.STOP, stop=Stop.COMFORT), 6.0
    aside_m, heading_rad, wheel_rad, way = 0.0, 0.0, 0.0, []
    for n in range(300):
        now_s = 0.02 * n
        path = dict(lateral_offset_m=-0.4 * side) if 50 <= n < 75 else LOST
        rate_radps = speed_mps * curvature_from_angle(wheel_rad, speed_mps=speed_mps, vehicle=SHUTTLE)
        seen = state(now_s, speed_mps=speed_mps, road_wheel_angle_rad=wheel_rad, yaw_rate_radps=rate_radps)
        last = one.step(decision(now_s, **stop, **path), replace(seen, driver_override=n < 50), now_s=now_s)
        wheel_rad = last.road_wheel_angle_rad
        heading_rad += 0.02 * rate_radps
        aside_m += 0.02 * speed_mps * math.sin(heading_rad)
        way.append(side * aside_m)
    assert max(way) > 0.1
    assert way[-1] == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("sender", ["decision", "state"])
def test_one_time_in_the_future_brakes_until_the_next_good_message(sender):
    one, start_s, _ = rolling()
    accels = []
    for n in range(40):
        now_s = start_s + 0.02 * n
        decided, measured = decision(now_s), state(now_s, speed_mps=4.0)
        if n == 10 and sender == "decision":
            decided = replace(decided, decided_s=now_s + 1000.0)
        if n == 10 and sender == "state":
            measured = replace(measured, t_s=now_s + 1000.0)
        accels.append(one.step(decided, measured, now_s=now_s).accel_mps2)
    assert accels[10] <= 0.0 < min(accels[20:])
