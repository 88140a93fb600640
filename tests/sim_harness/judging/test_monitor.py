"""A condition watched sample by sample: what it says on the way, and that it ends where the whole trace does."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sim_harness.judging.conditions.conditions import parse_condition
from sim_harness.judging.conditions.monitor import Monitor
from sim_harness.judging.trace import Trace


def watched(text, samples):
    monitor = Monitor(parse_condition(text))
    return [monitor.step(sample, now_s=0.1 * i) for i, sample in enumerate(samples)]


def test_what_must_always_hold_has_its_least_margin_so_far():
    speeds = [{"speed_mps": v} for v in (3.0, None, 4.5, 2.0, 6.0)]
    assert watched("speed <= 5", speeds) == [2.0, 2.0, 0.5, 0.5, -1.0]


def test_what_must_come_about_has_failed_until_it_has():
    samples = [
        {"decision.fear": fear, "fault.frozen_camera": at > 0} for at, fear in enumerate((0, 0, 0.4, 0.9, 0))
    ]
    so_far = watched("fear >= 0.5 within 0.3 s of frozen_camera", samples)
    assert so_far == pytest.approx([-math.inf, -0.5, -0.1, 0.4, 0.4])


def test_words_are_watched_too():
    modes = [{"mode": word} for word in (None, "KEEP", "STOP")]
    assert watched("never mode is STOP", modes) == [-math.inf, math.inf, -math.inf]


def test_time_goes_on():
    monitor = Monitor(parse_condition("speed <= 5"))
    monitor.step({"speed_mps": 1.0}, now_s=1.0)
    with pytest.raises(ValueError, match=r"a sample of 1\.0 s after one of 1\.0 s"):
        monitor.step({"speed_mps": 1.0}, now_s=1.0)


@settings(max_examples=30, deadline=None)
@given(
    st.lists(st.tuples(st.floats(-2, 2), st.booleans()), min_size=1, max_size=20),
    st.sampled_from(["speed <= 1", "speed >= 1 within 0.3 s of glare", "speed >= 0 for 0.2 s before glare"]),
)
def test_the_last_word_is_that_of_the_whole_trace(samples, text):
    rows = [{"speed_mps": speed, "disturbance.glare": float(glare)} for speed, glare in samples]
    columns = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    labels = dict.fromkeys(("section", "mode", "stop", "cause", "path_source"), ())
    whole = Trace({"t_s": 0.1 * np.arange(len(rows)), **columns}, labels)
    assert watched(text, rows)[-1] == parse_condition(text).robustness(whole)


def test_long_runs_outgrow_the_first_room():
    speeds = [{"speed_mps": 1.0 if i != 1500 else 7.0} for i in range(2100)]
    so_far = watched("speed <= 5", speeds)
    assert (so_far[1499], so_far[1500], so_far[-1]) == (4.0, -2.0, -2.0)
