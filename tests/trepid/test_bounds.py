"""Bounds against the builtins that they stand for, bit for bit."""

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trepid.bounds import at_least, at_most, within

NUMBERS = st.floats() | st.sampled_from([0.0, -0.0, 1.0, -1.0, math.inf, -math.inf, math.nan])


def bits(value):
    return struct.pack("<d", value)


@given(NUMBERS, st.floats(allow_nan=False) | st.sampled_from([0.0, -0.0]))
def test_are_min_and_max_with_the_bound_first(value, bound):
    assert bits(at_least(value, bound)) == bits(max(bound, value))
    assert bits(at_most(value, bound)) == bits(min(bound, value))


@given(NUMBERS, st.floats(min_value=0.0))
def test_within_is_both(value, limit):
    assert bits(within(value, limit)) == bits(max(-limit, min(limit, value)))


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_nan_becomes_the_bound(value):
    assert at_most(value, 2.0) == within(value, 2.0) == 2.0
