"""The speed that a driving network proposes lowers that of the car, and never raises it."""

import math
from copy import deepcopy
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from supervisor_rig import ESTIMATE, SETTINGS, Drive

from drive.reason import reason
from trepid.messages import LeadVehicle, Limit, Mode

CRUISE_MPS = SETTINGS.cruise_speed_mps
SPEEDS = st.one_of(st.none(), st.just(math.nan), st.floats(0.0, SETTINGS.validation.max_speed_mps))
CAR_AHEAD = LeadVehicle(t_s=0.0, distance_m=16.0, lateral_m=0.0, speed_mps=6.0, confidence=0.9)


@given(proposed_mps=st.tuples(SPEEDS, SPEEDS), confidence=st.floats(0.0, 1.0), led=st.booleans())
def test_the_cap_is_the_least_of_the_proposals_and_of_the_cap_without_them(proposed_mps, confidence, led):
    drive = Drive.under_way()
    lead = CAR_AHEAD if led else None
    estimates = [replace(ESTIMATE, confidence=confidence)] * 2
    without = deepcopy(drive).frame(**dict(zip(("cv", "cnn"), estimates, strict=True)), lead=lead)
    cv, cnn = (replace(one, speed_mps=v) for one, v in zip(estimates, proposed_mps, strict=True))
    decision = drive.frame(cv=cv, cnn=cnn, lead=lead)
    used = [v for v in proposed_mps if v is not None and not math.isnan(v)]
    used = used if confidence >= SETTINGS.validation.min_confidence else []
    assert decision.speed_cap_mps == min([without.speed_cap_mps, *used]) <= CRUISE_MPS
    assert (decision.fear, decision.mode, decision.speed_factor) == (
        without.fear,
        without.mode,
        without.speed_factor,
    )


def test_a_lower_speed_says_that_it_is_the_network_which_limits():
    decision = Drive.under_way().last(0.2, cnn=replace(ESTIMATE, speed_mps=2.5))
    assert (decision.speed_cap_mps, decision.limited_by) == (2.5, Limit.NETWORK)
    assert reason(decision) == "at most 2.5 m/s: speed of the driving network"


def test_a_car_that_the_network_lets_stand_says_what_it_waits_for():
    decision = Drive.under_way().last(0.2, cnn=replace(ESTIMATE, speed_mps=0.0))
    assert decision.mode is Mode.KEEP and "network proposes to stand" in decision.waits_for


@pytest.mark.parametrize("impossible_mps", [-0.1, 1e3, math.inf])
def test_an_impossible_speed_breaks_the_estimate(impossible_mps):
    drive = Drive.under_way()
    calm = deepcopy(drive).last(0.2)
    decision = drive.last(0.2, cnn=replace(ESTIMATE, speed_mps=impossible_mps))
    assert decision.sources == ("cv",) and decision.fear > calm.fear
    assert decision.limited_by is not Limit.NETWORK


def test_an_old_proposal_is_not_used():
    drive = Drive.under_way()
    drive.estimators = ("cv", "cnn", "segments")
    assert drive.frame(segments=replace(ESTIMATE, speed_mps=1.0)).limited_by is Limit.NETWORK
    drive.last(SETTINGS.validation.fresh_s + 0.1)
    assert drive.frame().limited_by is not Limit.NETWORK
