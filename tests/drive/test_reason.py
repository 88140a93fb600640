"""One sentence says what the car does and why."""

from dataclasses import replace
from typing import Any

import pytest
from message_rig import decision

from drive.reason import DRIVER, NO_DECISION, STOPS, fired_rules, reason, speed_limit_mps, task
from trepid.causes import CAUSES, IN_WORDS, NO_COMMAND, RESTART, Cause, in_words
from trepid.messages import Command, Limit, Mode, Stop
from vehicle.driver.stop_button import STOPPED


def command(target_mps: float, t_s: float | None = 1.0) -> Command:
    """A command of the frame at ``t_s``."""
    return Command(t_s=t_s, road_wheel_angle_rad=0.0, speed_mps=target_mps, accel_mps2=0.0)


WAITS = "stopped behind a vehicle, 2.7 m; waits for it to drive on"


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        (dict(limited_by=Limit.CRUISE), "at most 5.0 m/s: cruise speed"),
        (dict(limited_by=Limit.LEAD, lead_m=12.4), "following the vehicle ahead, 12 m"),
        (dict(limited_by=Limit.LEAD), "following the vehicle ahead"),
        (
            dict(mode=Mode.FOLLOW, limited_by=Limit.FEAR, cause="no_road", lane_unseen_s=3.14, lead_m=9.0),
            "following the vehicle ahead, 9 m: no lane seen for 3.1 s",
        ),
        (dict(limited_by=Limit.FEAR, cause="dark"), "at most 5.0 m/s: dark image"),
        (
            dict(limited_by=Limit.FEAR, cause="no_road", lane_unseen_s=1.2),
            "at most 5.0 m/s: no lane seen for 1.2 s",
        ),
        (dict(limited_by=Limit.FEAR, cause="no_road", lane_unseen_s=0.1), "at most 5.0 m/s: no lane seen"),
        (
            dict(limited_by=Limit.FEAR, cause="doubted_state", part="yaw rate"),
            "at most 5.0 m/s: doubted measurement (yaw rate)",
        ),
        (dict(limited_by=Limit.FEAR, cause="black_ice"), "at most 5.0 m/s: black ice"),
        (dict(limited_by=Limit.RECOVERY), "at most 5.0 m/s, rising"),
        (dict(limited_by=Limit.RECOVERY, cause="dark"), "at most 5.0 m/s: dark image"),
        (dict(limited_by=Limit.PROCESS, cause="lost_process"), "at most 5.0 m/s: lost process"),
        (
            dict(limited_by=Limit.SIGHT, sight_m=23.0, sight_cause="fog"),
            "at most 5.0 m/s: sight of 23 m (fog, rain or snow)",
        ),
        (
            dict(limited_by=Limit.ROAD_USER, road_user="cyclist", road_user_m=11.8),
            "at most 5.0 m/s: cyclist 12 m ahead",
        ),
        (dict(mode=Mode.STOP, stop=Stop.COMFORT, speed_cap_mps=0.0, waits_for=WAITS), WAITS),
        (dict(mode=Mode.STOP, stop=Stop.EMERGENCY, cause="stale_data"), "emergency stop: no new image"),
        (dict(cause="none"), "at most 5.0 m/s"),
    ],
)
def test_the_sentence_names_what_limits_the_speed_in_the_words_of_a_driver(
    fields: dict[str, Any], sentence: str
) -> None:
    assert (
        reason(decision(0.0, **{"speed_cap_mps": 5.0, "mode": Mode.KEEP, "cause": "none", **fields}))
        == sentence
    )


@pytest.mark.parametrize("limited_by", [limit for limit in Limit if limit is not Limit.STOP])
def test_no_limit_is_called_calm_and_each_has_words(limited_by: Limit) -> None:
    sentence = reason(decision(0.0, cause="none", mode=Mode.KEEP, limited_by=limited_by))
    assert sentence and "calm" not in sentence


def test_a_bend_is_what_makes_the_controller_drive_below_the_cap_also_behind_a_vehicle() -> None:
    following = decision(0.0, t_s=1.0, limited_by=Limit.LEAD, speed_cap_mps=8.0, mode=Mode.KEEP)
    assert reason(following, command=command(4.1)) == "at most 4.1 m/s: bend"
    assert reason(following, command=command(7.9)) == reason(following) == "following the vehicle ahead"
    assert reason(following, command=command(0.0)) == STOPS


def test_the_command_of_the_decision_before_tells_a_bend_but_no_stop_and_an_old_one_nothing() -> None:
    drives = decision(0.0, t_s=1.0, limited_by=Limit.CRUISE, speed_cap_mps=8.0, mode=Mode.KEEP)
    assert reason(drives, command=command(4.1, 0.96)) == "at most 4.1 m/s: bend"
    assert reason(drives, command=command(0.0, 0.96)) == reason(drives)
    assert reason(drives, command=command(4.1, 0.8)) == reason(drives)
    assert reason(drives, command=command(4.1, None)) == reason(drives)


def test_one_limit_is_shown_the_lower_one_of_supervisor_and_controller() -> None:
    drives = decision(0.0, t_s=1.0, limited_by=Limit.CRUISE, speed_cap_mps=8.0, mode=Mode.KEEP)
    assert [speed_limit_mps(drives, command(target)) for target in (4.1, 9.0, 0.0)] == [4.1, 8.0, 0.0]
    assert speed_limit_mps(drives, command(0.0, 0.96)) == speed_limit_mps(drives, None) == 8.0
    assert speed_limit_mps(drives, command(4.1, 0.8)) == 8.0


def test_what_a_car_waits_for_comes_before_the_speed_of_the_command() -> None:
    assert reason(decision(0.0, t_s=1.0, waits_for=WAITS, speed_cap_mps=2.0), command=command(0.0)) == WAITS


def test_several_missing_inputs_are_one_row_with_the_cause_and_the_strength_1() -> None:
    rules = (
        "missing lane_confidence: taken as very_low",
        "missing jitter: taken as very_high",
        "if a is b then c",
    )
    lost = decision(0.0, cause="stale_data", rules=rules, rule_strengths=(1.0, 1.0, 0.5))
    assert fired_rules(lost) == [
        ("missing inputs (no new image): lane_confidence, jitter", 1.0),
        ("if a is b then c", 0.5),
    ]
    alone = replace(lost, rules=rules[1:], rule_strengths=(1.0, 0.5))
    assert fired_rules(alone) == list(zip(alone.rules, alone.rule_strengths, strict=True))


def test_a_driver_comes_before_all_and_without_a_decision_that_is_said() -> None:
    assert reason(decision(0.0, waits_for=WAITS), driver=True) == DRIVER
    assert reason(None) == NO_DECISION


def test_every_cause_has_words_of_its_own() -> None:
    assert set(IN_WORDS) == CAUSES
    assert len(set(IN_WORDS.values())) == len(CAUSES)
    assert not any("_" in in_words(cause) for cause in Cause)


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        (dict(limited_by=Limit.LEAD), "nothing to do but watch"),
        (dict(mode=Mode.CAUTION, cause="dark"), "be ready to take over"),
        (dict(waits_for=WAITS), "keep clear: it drives on by itself"),
        (dict(mode=Mode.STOP, stop=Stop.COMFORT, waits_for=WAITS), "keep clear: it drives on by itself"),
        (dict(mode=Mode.STOP, stop=Stop.EMERGENCY), "keep clear: it drives on by itself"),
        (
            dict(mode=Mode.STOP, stop=Stop.COMFORT, waits_for=f"stopped: lost estimator (cv); {RESTART}"),
            "it stays here: end the drive, mend the cause, start it again",
        ),
    ],
)
def test_a_person_reads_what_to_do_and_is_never_called_idle_beside_a_car_that_may_start(
    fields: dict[str, Any], words: str
):
    assert task(decision(1.0, **fields)) == words


def test_the_driver_the_stop_button_and_the_own_stop_of_the_vehicle_come_before_the_decision():
    calm = decision(1.0, mode=Mode.KEEP)
    assert task(calm, driver=True, stops=STOPPED) == "the car is yours"
    assert task(calm, stops=STOPPED) == "press Drive on when the way is free"
    assert task(calm, stops=NO_COMMAND) == task(None) == "be ready to take over"
