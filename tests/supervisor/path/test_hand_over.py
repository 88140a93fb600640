"""From one path to another without a step."""

import itertools
import math

import pytest

from supervisor.path.fusion import Path
from supervisor.path.hand_over import HandOver
from trepid.clothoid import Lane, Motion, pursuit_curvature

STEP_S, OVER_S = 0.04, 1.5
ROAD, TRAIL = Lane(0.0, 0.0, 0.0, 0.0), Lane(0.4, 0.03, 0.01, 0.0)
WHEELBASE_M, LOOKAHEAD_M = 1.75, 8.0


def driven(paths: list[Path | None], *, speed_mps: float = 4.0) -> list[Path | None]:
    hand_over = HandOver(OVER_S)
    return [hand_over.step(path, Motion(speed_mps, 0.0), now_s=n * STEP_S) for n, path in enumerate(paths)]


def switch(before: tuple[Lane, str], after: tuple[Lane, str], *, steps: int = 60) -> list[Path]:
    """Ten steps on one path, the rest on the other; both stay fixed relative to the vehicle."""
    paths = [
        Path(n * STEP_S, *(before if n < 10 else after)[:1], 20.0, (before if n < 10 else after)[1])
        for n in range(steps)
    ]
    return [path for path in driven(list(paths), speed_mps=0.0) if path is not None]


def wheel_rad(lane: Lane) -> float:
    return math.atan(WHEELBASE_M * pursuit_curvature(lane.y_m(LOOKAHEAD_M), LOOKAHEAD_M))


@pytest.mark.parametrize("ends", [((ROAD, "memory"), (TRAIL, "lead")), ((TRAIL, "lead"), (ROAD, "cv+cnn"))])
def test_the_wheel_makes_no_step_of_more_than_a_tenth_of_a_degree(
    ends: tuple[tuple[Lane, str], tuple[Lane, str]],
) -> None:
    wheels = [wheel_rad(path.lane) for path in switch(*ends)]
    steps_deg = [math.degrees(abs(b - a)) for a, b in itertools.pairwise(wheels)]
    assert max(steps_deg) < 0.15
    assert wheels[9] == pytest.approx(wheel_rad(ends[0][0]))
    assert wheels[-1] == pytest.approx(wheel_rad(ends[1][0]))


def test_the_hand_over_ends_on_the_new_path_exactly() -> None:
    paths = switch((ROAD, "memory"), (TRAIL, "lead"))
    assert paths[10].lane == pytest.approx(ROAD, abs=1e-9)
    assert paths[-1].lane == TRAIL


def test_between_paths_of_the_road_nothing_is_led_over() -> None:
    paths = switch((ROAD, "cv"), (TRAIL, "cnn"))
    assert paths[10].lane == TRAIL


def test_without_a_path_before_there_is_nothing_to_lead_over_from() -> None:
    found = driven([None, None, Path(2 * STEP_S, TRAIL, 20.0, "lead")])
    assert found[:2] == [None, None]
    assert found[2] is not None
    assert found[2].lane == TRAIL


def test_the_difference_of_the_paths_stays_fixed_on_the_ground_while_the_vehicle_moves() -> None:
    """A slope between two straight paths: 10 m on, the fading gap is that of 10 m on, not that of the start."""
    speed_mps, slope = 5.0, 0.02
    hand_over, motion = HandOver(100.0), Motion(speed_mps, 0.0)
    hand_over.step(Path(0.0, Lane(0.0, -slope, 0.0, 0.0), 20.0, "lead"), motion, now_s=0.0)
    for n in range(1, 52):
        path = hand_over.step(Path(n * STEP_S, ROAD, 20.0, "cv"), motion, now_s=n * STEP_S)
    assert path is not None
    assert path.lane.y_m(0.0) == pytest.approx(slope * speed_mps * 51 * STEP_S, rel=1e-3)
