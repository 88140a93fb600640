"""A scenario as the course of a live drive."""

from dataclasses import replace

import pytest
from trace_rig import truth

from sim_harness.live.course import ScenarioCourse, course_of
from sim_harness.scenarios.scenario import load_scenario
from trepid.config import InputError
from trepid.processes.settings import load_processes


def test_a_fault_of_a_process_that_shares_one_with_others_is_refused() -> None:
    course = ScenarioCourse(load_scenario("lost_cv"))
    specs = course.processes(load_processes())
    course.check(specs)
    shared = tuple(replace(s, together="frame") if s.name in ("cv", "cnn") else s for s in specs)
    with pytest.raises(InputError, match="concerns 'cv', which is no process of its own in this drive"):
        course.check(shared)


def test_a_process_is_lost_during_its_fault_only() -> None:
    course = course_of("lost_cv", {"faults.0.to_s": "13"}, (), duration_s=None)
    assert [sorted(course.lost(at_s)) for at_s in (7.9, 8.1, 12.9, 13.1)] == [[], ["cv"], ["cv"], []]


@pytest.mark.parametrize(("elapsed_s", "begun"), [(None, False), (-0.1, False), (0.0, True)])
def test_a_drive_begins_after_the_run_up(elapsed_s: float | None, begun: bool) -> None:
    course = course_of("leader_brakes", {}, (), duration_s=4.0)
    assert course.duration_s == 4.0 and not course.has_begun(None)
    assert course.has_begun(truth(0.0, elapsed_s=elapsed_s)) is begun
