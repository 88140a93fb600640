"""Stops on a plant end at the place of their closed form."""

import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE

from lab.bench.control.longitudinal import PLANTS, brake
from trepid.messages import Stop


@pytest.mark.parametrize("speed_mps", [0.3, 2.0, 8.94])
def test_on_the_plant_a_comfort_stop_ends_within_20_cm_of_its_closed_form(speed_mps):
    metres, last_mps2 = brake(SETTINGS, SHUTTLE, PLANTS["as modelled"], Stop.COMFORT, speed_mps)
    meant_m = SETTINGS.speed.comfort.metres_and_seconds(speed_mps)[0] + speed_mps * SHUTTLE.accel_lag_s
    assert metres == pytest.approx(meant_m, abs=0.2)
    assert last_mps2 <= 0.5


def test_a_drive_with_twice_the_nominal_lag_costs_30_cm():
    metres, _ = brake(SETTINGS, SHUTTLE, PLANTS["drive lag 0.3 s for 0.15 s"], Stop.COMFORT, 8.94)
    meant_m = SETTINGS.speed.comfort.metres_and_seconds(8.94)[0] + 8.94 * SHUTTLE.accel_lag_s
    assert metres == pytest.approx(meant_m, abs=0.3)
