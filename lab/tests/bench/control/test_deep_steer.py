"""The paper's failure is reproduced, for the paper's reasons."""

import pytest
from controller_rig import SETTINGS
from message_rig import SHUTTLE

from lab.bench.control.deep_steer import AnglesOfFiveMph, winding_episode
from lab.bench.control.episode import drive, drive_by
from lab.bench.control.speeds import MPH


def angles(transposed=False):
    return AnglesOfFiveMph(SHUTTLE, transposed=transposed)


def test_angles_of_5_mph_keep_the_road_at_5_mph_and_lose_it_at_20():
    slow, fast = (winding_episode(SHUTTLE, mph * MPH, seed=0) for mph in (5, 20))
    assert drive_by(angles(), slow).worst_m <= 0.1
    assert drive_by(angles(), fast).worst_m > 1.05


def test_understeer_compensation_alone_does_not_keep_the_road_but_with_the_delay_it_does():
    fast = winding_episode(SHUTTLE, 20 * MPH, seed=0)
    assert drive_by(angles(transposed=True), fast).worst_m > 1.05
    assert drive(fast, SETTINGS).worst_m <= 0.25


def test_the_angle_is_held_and_at_its_own_speed_transposing_changes_nothing():
    episode = winding_episode(SHUTTLE, 5 * MPH, seed=0)
    plain, transposed = drive_by(angles(), episode), drive_by(angles(transposed=True), episode)
    assert transposed.offset_m == pytest.approx(plain.offset_m, abs=1e-6)
