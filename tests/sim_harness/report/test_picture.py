"""The picture of a run: eight views of different moments, whatever the road."""

import numpy as np
import pytest

from sim_harness.judging.trace import Trace
from sim_harness.report.picture import VIEWS, _moments


def toy(sections: list[str], fear: np.ndarray) -> Trace:
    """A trace of equally long sections."""
    names = tuple(dict.fromkeys(sections))
    codes = np.repeat([names.index(name) for name in sections], len(fear) // len(sections))
    columns = {
        "t_s": 0.01 * np.arange(len(codes)),
        "speed_mps": np.full(len(codes), 8.0),
        "decision.fear": fear[: len(codes)],
        "curvature_1pm": np.zeros(len(codes)),
        "section": codes.astype(float),
    }
    return Trace(columns, {"section": names})


@pytest.mark.parametrize("sections", [["straight"], ["a", "b"], [*"abcde"], [*"abcdefgh"], [*"abcdefghijkl"]])
def test_the_moments_of_the_views_differ(sections: list[str]) -> None:
    fear = np.zeros(1200)
    fear[700] = 0.8
    trace = toy(sections, fear)
    found = _moments(trace, count=VIEWS)
    samples = [sample for _, sample in found]
    assert len(set(samples)) == VIEWS and samples == sorted(samples)
    assert all(trace.words["section"][int(trace["section"][sample])] == name for name, sample in found)
    if len(sections) <= VIEWS:
        assert 700 in samples, "the greatest fear is shown"
        assert {name for name, _ in found} == set(sections)


def test_without_a_number_every_section_has_one_moment() -> None:
    assert [name for name, _ in _moments(toy([*"abc"], np.zeros(300)))] == [*"abc"]


def test_a_run_of_few_samples_shows_what_there_is() -> None:
    assert len(_moments(toy(["a"], np.zeros(3)), count=VIEWS)) == VIEWS
