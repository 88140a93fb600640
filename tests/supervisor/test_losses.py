"""What the launcher reports as lost stops or slows the car."""

from supervisor_rig import SETTINGS, Drive

from trepid.messages import Decision, Losses, Mode, Stop


def decided(
    drive: Drive, *, stop: tuple[str, ...] = (), slow: tuple[str, ...] = (), reported: bool = True
) -> Decision:
    """The decision on the newest messages of ``drive`` under a report of the launcher, or without one."""
    get = drive.latest.get
    estimates = {name: get(name) for name in ("cv", "cnn")}
    losses = Losses(t_s=drive.now_s, stop=stop, slow=slow) if reported else None
    return drive.supervisor.step(
        estimates, get("statistics"), get("lead"), get("state"), now_s=drive.now_s, losses=losses
    )


def test_a_process_whose_loss_means_a_stop_stops_the_car_at_once_and_names_the_cause() -> None:
    decision = decided(Drive.under_way(), stop=("horn",))
    assert (decision.mode, decision.stop, decision.cause) == (Mode.STOP, Stop.COMFORT, "lost_process")
    assert decision.speed_cap_mps == 0


def test_a_process_whose_loss_means_slow_caps_the_speed_and_its_return_frees_it() -> None:
    drive = Drive.under_way()
    slow = decided(drive, slow=("horn",))
    share = SETTINGS.lost_process_speed_factor
    assert (slow.mode, slow.speed_factor, slow.cause) == (Mode.KEEP, share, "lost_process")
    assert slow.speed_cap_mps == share * SETTINGS.cruise_speed_mps
    assert drive.frame().speed_factor == 1


def test_a_report_without_losses_changes_nothing() -> None:
    drive, other = Drive.under_way(), Drive.under_way()
    drive.frame()
    other.frame()
    assert decided(drive) == decided(other, reported=False)
