"""An episode with a fault, judged from the stamped events of its processes."""

import pytest

from lab.bench.live.faults.catalogue import FAULTS, OUTPUTS, PERIODS_S, STARVED
from lab.bench.live.faults.episode import Events, Place, braking_time_s, judge_episode, observable_s

INJECTED_S = 10.0
CALM = [(9.0 + 0.01 * n, 0.02 * (n % 3)) for n in range(101)]


def ramp(from_s: float, *, jerk_mps3: float = 2.0, least_mps2: float = -1.0) -> list[tuple[float, float]]:
    times = [from_s + 0.01 * n for n in range(200)]
    return [(t_s, max(least_mps2, -jerk_mps3 * (t_s - from_s + 0.03))) for t_s in times]


def every(period_s: float, *, from_s: float, to_s: float) -> list[float]:
    return [from_s + n * period_s for n in range(round((to_s - from_s) / period_s) + 1)]


def places(stand_s: float, *, departs_s: float = 99.0) -> list[Place]:
    times = every(0.1, from_s=9.0, to_s=15.0)
    return [Place(t_s, max(0.0, stand_s - t_s), int(t_s >= departs_s)) for t_s in times]


def test_the_brake_begins_with_the_first_command_of_its_ramp() -> None:
    assert braking_time_s([*CALM, *ramp(10.2)], injected_s=INJECTED_S) == pytest.approx(10.2)


def test_a_brake_that_is_released_before_it_bites_is_not_the_one_that_stops_the_car() -> None:
    touched = [(10.1, -0.1), (10.2, -0.2), (10.3, 0.0)]
    assert braking_time_s([*CALM, *touched, *ramp(10.5)], injected_s=INJECTED_S) == pytest.approx(10.5)


def test_the_noise_of_the_speed_control_is_no_brake() -> None:
    noise = [(10.0 + 0.01 * n, -0.2 * (n % 2)) for n in range(100)]
    assert braking_time_s([*CALM, *noise], injected_s=INJECTED_S) is None


def test_a_killed_process_is_observable_at_once() -> None:
    assert observable_s(FAULTS["kill-cv"], Events(), injected_s=INJECTED_S) == INJECTED_S


def test_a_frozen_process_is_observable_when_its_next_message_is_one_period_late() -> None:
    fault, events = FAULTS["freeze-supervisor"], Events()
    period_s = PERIODS_S[fault.key]
    events.published_s[fault.key] = [9.9, 9.9 + period_s, 12.0]
    assert observable_s(fault, events, injected_s=INJECTED_S) == pytest.approx(9.9 + 3 * period_s)


def test_a_camera_without_frames_is_observable_one_period_after_the_first_that_it_did_not_give() -> None:
    fault, events = FAULTS["unplug-camera"], Events()
    events.marks_s[fault.key] = [9.0, 10.03, 10.07]
    assert observable_s(fault, events, injected_s=INJECTED_S) == pytest.approx(10.07)


def test_a_repeated_frame_is_observable_at_the_second_repetition() -> None:
    fault, events = FAULTS["repeat-camera"], Events()
    events.marks_s[fault.key] = [10.03, 10.07, 10.11]
    assert observable_s(fault, events, injected_s=INJECTED_S) == pytest.approx(10.07)


def test_a_corrupt_message_is_observable_when_it_is_published() -> None:
    fault, events = FAULTS["corrupt-controller"], Events()
    events.marks_s[fault.key] = [10.01, 10.03]
    assert observable_s(fault, events, injected_s=INJECTED_S) == pytest.approx(10.01)


def test_starvation_is_observable_at_the_first_gap_of_two_periods_of_any_process() -> None:
    events = Events()
    for name in STARVED:
        period_s = PERIODS_S[OUTPUTS[name].key]
        events.published_s[OUTPUTS[name].key] = every(period_s, from_s=9.0, to_s=12.0)
    cv = OUTPUTS["cv"].key
    events.published_s[cv] = [t_s for t_s in events.published_s[cv] if not 10.1 < t_s < 10.4]
    last_s = max(t_s for t_s in events.published_s[cv] if t_s < 10.2)
    seen_s = observable_s(FAULTS["starve"], events, injected_s=INJECTED_S)
    assert seen_s == pytest.approx(last_s + 2 * PERIODS_S[cv])


def test_a_fault_that_never_showed_has_no_reaction_time() -> None:
    events = Events(applied=[*CALM, *ramp(10.2)], places=places(13.0))
    row = judge_episode(FAULTS["corrupt-cv"], events, injected_s=INJECTED_S)
    assert (row["observable_ms"], row["reaction_ms"]) == (None, None)
    assert row["braked_ms"] == pytest.approx(200.0)


def test_the_reaction_runs_from_the_observable_fault_to_the_brake_on_the_car() -> None:
    events = Events(applied=[*CALM, *ramp(10.2)], places=places(13.0))
    events.marks_s[FAULTS["corrupt-cv"].key] = [10.12]
    row = judge_episode(FAULTS["corrupt-cv"], events, injected_s=INJECTED_S)
    assert row["reaction_ms"] == pytest.approx(80.0)
    assert row["stood_s"] == pytest.approx(3.0, abs=0.11)
    assert row["departures"] == 0


def test_only_departures_after_the_injection_count() -> None:
    early = judge_episode(
        FAULTS["kill-cv"], Events(places=places(13.0, departs_s=9.5)), injected_s=INJECTED_S
    )
    late = judge_episode(
        FAULTS["kill-cv"], Events(places=places(13.0, departs_s=11.0)), injected_s=INJECTED_S
    )
    assert (early["departures"], late["departures"]) == (0, 1)


def test_a_car_that_drives_on_has_neither_brake_nor_standstill() -> None:
    events = Events(applied=[*CALM, *((10.0 + 0.01 * n, 0.0) for n in range(300))], places=places(30.0))
    row = judge_episode(FAULTS["disk-full"], events, injected_s=INJECTED_S)
    assert (row["braked_ms"], row["stood_s"], row["departures"]) == (None, None, 0)
