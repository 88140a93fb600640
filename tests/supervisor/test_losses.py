"""What the launcher reports as lost stops or slows the car."""

from dataclasses import replace

from supervisor_rig import SETTINGS, STATE, Drive

from trepid.messages import Decision, Losses, Mode, Stop


def decide(
    drive: Drive,
    *,
    stop: tuple[str, ...] = (),
    slow: tuple[str, ...] = (),
    reported: bool = True,
) -> Decision:
    """The decision on the newest messages of ``drive`` under a report of the launcher, or without one."""
    get = drive.latest.get
    estimates = {name: get(name) for name in ("cv", "cnn")}
    losses = Losses(t_s=drive.now_s, stop=stop, slow=slow) if reported else None
    return drive.supervisor.step(
        estimates, get("statistics"), get("lead"), get("state"), now_s=drive.now_s, losses=losses
    )


def test_a_process_whose_loss_means_a_stop_stops_the_car_at_once_and_names_the_cause() -> None:
    decision = decide(Drive.under_way(), stop=("horn",))
    assert (decision.mode, decision.stop, decision.cause) == (Mode.STOP, Stop.COMFORT, "lost_process")
    assert decision.speed_cap_mps == 0


def test_a_process_whose_loss_means_slow_caps_the_speed_and_its_return_frees_it() -> None:
    drive = Drive.under_way()
    slow = decide(drive, slow=("horn",))
    share = SETTINGS.lost_process_speed_factor
    assert (slow.mode, slow.speed_factor, slow.cause) == (Mode.KEEP, share, "lost_process")
    assert slow.speed_cap_mps == share * SETTINGS.cruise_speed_mps
    assert drive.frame().speed_factor == 1


def test_a_report_without_losses_changes_nothing() -> None:
    drive, other = Drive.under_way(), Drive.under_way()
    drive.frame()
    other.frame()
    assert decide(drive) == decide(other, reported=False)


AWAITED = Losses(t_s=0.0, stop=(), slow=(), awaited=("lead", "page"))


def test_a_standing_car_does_not_start_before_the_processes_that_the_launcher_awaits() -> None:
    drive = Drive()
    waiting = drive.last(3 * SETTINGS.modes.reengage_after_s, losses=AWAITED)  # type: ignore[operator]
    assert (waiting.mode, waiting.waits_for) == (Mode.STOP, "starting: waits for the start of lead, page")
    started = drive.last(SETTINGS.modes.reengage_after_s + 0.2)  # type: ignore[operator]
    assert (started.mode, started.waits_for) == (Mode.KEEP, "")


def test_a_moving_car_that_a_driver_hands_over_too_soon_is_not_taken_over() -> None:
    driven = replace(STATE, driver_override=True)
    for losses, mode in ((AWAITED, Mode.STOP), (None, Mode.CAUTION)):
        drive = Drive(speed_mps=8.0)
        drive.last(4.0, state=driven, losses=losses)
        assert drive.frame(losses=losses).mode is mode


def test_a_car_that_drives_does_not_stop_for_an_awaited_process() -> None:
    assert Drive.under_way().last(1.0, losses=AWAITED).mode is Mode.KEEP


def test_a_car_that_a_person_stops_says_so_and_drives_on_after_the_release() -> None:
    drive = Drive.under_way()
    held = replace(STATE, stop_pressed=True)
    moving = drive.frame(state=held)
    assert (moving.mode, moving.stop, moving.cause) == (Mode.STOP, Stop.COMFORT, "stop_button")
    drive.speed_mps = 0.0
    assert (
        drive.last(9.0, state=held).waits_for == "stopped: STOP pressed; waits for a person to press Drive on"
    )
    assert drive.last(SETTINGS.modes.reengage_after_s + 0.2).mode is Mode.KEEP  # type: ignore[operator]
