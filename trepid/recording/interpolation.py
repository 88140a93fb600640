"""Measured values at other times than those of their messages."""

import math

import numpy as np

from trepid.types import Column

GAP_S = 0.25  # values are not interpolated over a longer silence


def between(t_s: Column, at_s: Column, values: Column, *, gap_s: float = GAP_S) -> Column:
    """``values``, measured at the rising times ``at_s``, at ``t_s`` by linear interpolation.

    NaN outside of the measurement and in silences above ``gap_s``; a value that is NaN counts as not measured.
    """
    known = np.isfinite(values)
    at_s, values = at_s[known], values[known]
    if not len(at_s):
        return np.full(len(t_s), math.nan)
    found = np.interp(t_s, at_s, values, left=math.nan, right=math.nan)
    after = np.clip(np.searchsorted(at_s, t_s), 1, max(1, len(at_s) - 1))
    if len(at_s) > 1:
        found[at_s[after] - at_s[after - 1] > gap_s] = math.nan
    return np.asarray(found)
