"""The scores of a drive of a real car."""

from dataclasses import fields

from drive.tally import Tally
from sim_harness.judging.metrics import Metrics


def test_a_drive_of_a_real_car_has_the_fields_of_a_simulated_one_in_their_order() -> None:
    assert [*Tally().row()] == [*(field.name for field in fields(Metrics)), "realtime_factor", "trace_sha256"]
