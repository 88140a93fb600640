"""Modes: a stop latches, grows only harder, and ends at standstill or not at all."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supervisor.inputs.timers import HoldTimer
from supervisor.modes.modes import STARTING, Effect, ModeState, Situation, next_state
from trepid.messages import Mode, Stop

FINE = Situation(
    fault="",
    lost=False,
    cause="none",
    afraid=False,
    path=True,
    lead=False,
    standstill=False,
    effects=frozenset({Effect.CALM, Effect.ROAD_BACK}),
)
KEEPING = ModeState(Mode.KEEP, Stop.NONE, "", final=False)
SITUATIONS = st.builds(
    Situation,
    fault=st.sampled_from(["", "", "", "lost_estimator", "driver_override"]),
    lost=st.booleans(),
    cause=st.sampled_from(["none", "dark", "frozen_camera"]),
    afraid=st.booleans(),
    path=st.booleans(),
    lead=st.booleans(),
    standstill=st.booleans(),
    effects=st.frozensets(st.sampled_from(Effect)),
)


def fine(*effects: Effect, without: Effect | None = None, **changes: Any) -> Situation:
    """FINE with further ``effects``, one taken away, and changed fields."""
    return FINE._replace(effects=(FINE.effects | set(effects)) - {without}, **changes)


def after(state: ModeState, now: Situation) -> ModeState:
    return next_state(state, now, final_causes=frozenset({"frozen_camera"}))


def in_mode(mode: Mode) -> ModeState:
    return KEEPING._replace(mode=mode)


@pytest.mark.parametrize(
    ("mode", "now", "target"),
    [
        (Mode.KEEP, FINE, Mode.KEEP),
        (Mode.KEEP, fine(afraid=True), Mode.CAUTION),
        (Mode.KEEP, fine(Effect.STOP), Mode.STOP),
        (Mode.KEEP, fine(Effect.STOP_ON_ROAD), Mode.STOP),
        (
            Mode.FOLLOW,
            fine(Effect.STOP_ON_ROAD, without=Effect.ROAD_BACK, path=False, lead=True),
            Mode.FOLLOW,
        ),
        (Mode.KEEP, fine(path=False), Mode.STOP),
        (Mode.KEEP, fine(path=False, lead=True), Mode.FOLLOW),
        (Mode.CAUTION, fine(without=Effect.CALM), Mode.CAUTION),
        (Mode.CAUTION, FINE, Mode.KEEP),
        (Mode.CAUTION, fine(fault="lost_estimator"), Mode.STOP),
        (Mode.FOLLOW, fine(without=Effect.ROAD_BACK, path=False, lead=True), Mode.FOLLOW),
        (Mode.FOLLOW, fine(without=Effect.ROAD_BACK, path=False), Mode.STOP),
        (Mode.FOLLOW, FINE, Mode.CAUTION),
        (Mode.STOP, FINE, Mode.STOP),
        (Mode.STOP, fine(Effect.START), Mode.STOP),
        (Mode.STOP, fine(standstill=True), Mode.STOP),
        (Mode.STOP, fine(Effect.START, standstill=True), Mode.CAUTION),
    ],
)
def test_the_first_matching_row_of_the_table_gives_the_next_mode(
    mode: Mode, now: Situation, target: Mode
) -> None:
    assert after(in_mode(mode), now).mode is target


@settings(max_examples=150, deadline=None)
@given(st.lists(SITUATIONS, max_size=12))
def test_a_stop_is_left_only_at_standstill_and_never_grows_softer(situations: list[Situation]) -> None:
    state = KEEPING
    for now in situations:
        before, state = state, after(state, now)
        if before.mode is Mode.STOP and state.mode is not Mode.STOP:
            assert now.standstill
            assert Effect.START in now.effects
            assert not before.final
        if before.final:
            assert state.final
            assert state.mode is Mode.STOP
        if before.stop is Stop.EMERGENCY and state.mode is Mode.STOP:
            assert state.stop is Stop.EMERGENCY
        assert (state.mode is Mode.STOP) == (state.stop is not Stop.NONE)


def test_a_stop_for_a_lost_process_is_final() -> None:
    stopped = after(KEEPING, FINE._replace(fault="lost_estimator", lost=True))
    assert (stopped.stop, stopped.cause, stopped.final) == (Stop.COMFORT, "lost_estimator", True)


def test_a_process_that_is_lost_during_a_stop_makes_it_final() -> None:
    late = after(KEEPING, FINE._replace(fault="stale_data"))
    assert not late.final
    assert after(late, FINE._replace(fault="lost_estimator", lost=True)).final


def test_processes_may_come_and_go_before_the_first_drive() -> None:
    waiting = after(ModeState.initial(), FINE._replace(fault="lost_estimator", lost=True, standstill=True))
    assert (waiting.cause, waiting.final) == (STARTING, False)


def test_going_blind_while_moving_is_an_emergency_and_final() -> None:
    stopped = after(KEEPING, fine(Effect.EMERGENCY, path=False))
    assert (stopped.mode, stopped.stop, stopped.final) == (Mode.STOP, Stop.EMERGENCY, True)


def test_a_stop_brakes_hard_for_a_vehicle_too_near_for_a_comfort_stop_and_is_not_final() -> None:
    stopping = after(KEEPING, FINE._replace(path=False))
    assert stopping.stop is Stop.COMFORT
    tightened = after(stopping, fine(Effect.BRAKE_HARDER))
    assert (tightened.mode, tightened.stop, tightened.final) == (Mode.STOP, Stop.EMERGENCY, False)
    assert after(KEEPING, fine(Effect.BRAKE_HARDER)) == KEEPING, (
        "the speed cap brakes harder than a comfort stop"
    )


def test_a_frozen_camera_ends_the_run_because_it_is_not_detectable_at_standstill() -> None:
    assert after(KEEPING, fine(Effect.STOP, cause="frozen_camera")).final


def test_held_counts_from_the_last_break_and_none_is_never() -> None:
    held = HoldTimer()
    assert [held.lasts(c, 1.0, now_s=t) for t, c in [(0, True), (0.9, True), (1.0, True)]] == [
        False,
        False,
        True,
    ]
    assert not held.lasts(False, 1.0, now_s=1.1)
    assert not held.lasts(True, 1.0, now_s=2.0)
    assert held.lasts(True, 1.0, now_s=3.0)
    assert not held.lasts(True, None, now_s=1e9)
