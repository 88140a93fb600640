"""The clothoid through a trail: closed forms, odometry, and how sure it is."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supervisor.path.fusion import Path
from supervisor.path.trail import HandOver, Trail, fit, max_curvature_rate_1pm2
from supervisor.supervisor import SupervisorSettings
from trepid.clothoid import Lane, Motion, pursuit_curvature
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).follow.trail
STRAIGHT = Lane(0.0, 0.0, 0.0, 0.0)


def points(lane: Lane, *, sigma_m: float = 0.05) -> np.ndarray:
    return np.array([(x, lane.y_m(x), sigma_m**-2) for x in np.arange(-5.0, 20.0, 0.5)])


@given(st.floats(-0.5, 0.5), st.floats(-0.1, 0.1), st.floats(-0.03, 0.03), st.floats(-0.001, 0.001))
@settings(max_examples=25, deadline=None)
def test_points_on_a_clothoid_give_that_clothoid(
    offset_m: float, heading_rad: float, curvature_1pm: float, rate_1pm2: float
) -> None:
    lane = Lane(offset_m, heading_rad, curvature_1pm, rate_1pm2)
    found = fit(
        points(lane, sigma_m=0.01),
        STRAIGHT,
        SETTINGS,
        around_m=0.0,
        window_m=SETTINGS.window_m,
        speed_mps=2.0,
    ).lane
    for x_m in (0.0, 5.0, 10.0):
        assert found.y_m(x_m) == pytest.approx(lane.y_m(x_m), abs=0.02)


def test_without_points_the_prior_is_all_there_is() -> None:
    prior = Lane(0.2, -0.03, 0.01, 0.0)
    found = fit(np.empty((0, 3)), prior, SETTINGS, around_m=0.0, window_m=SETTINGS.window_m, speed_mps=5.0)
    assert found.lane == pytest.approx(prior)
    assert found.sigma_m(0.0) == pytest.approx(SETTINGS.offset_sigma_m)


def test_the_sigma_grows_beyond_the_points() -> None:
    found = fit(points(STRAIGHT), STRAIGHT, SETTINGS, around_m=0.0, window_m=SETTINGS.window_m, speed_mps=5.0)
    assert found.sigma_m(5.0) < found.sigma_m(30.0) < found.sigma_m(45.0)


def test_the_sigma_equals_the_scatter_under_noise() -> None:
    """Monte Carlo: the scatter of the fit to noisy points equals its covariance near the points."""
    rng = np.random.default_rng(1)
    clean = points(STRAIGHT, sigma_m=0.2)
    found = []
    for _ in range(300):
        noisy = clean.copy()
        noisy[:, 1] += rng.normal(0, 0.2, len(clean))
        found.append(
            fit(noisy, STRAIGHT, SETTINGS, around_m=8.0, window_m=SETTINGS.window_m, speed_mps=5.0).lane.y_m(
                8.0
            )
        )
    expected = fit(
        clean, STRAIGHT, SETTINGS, around_m=8.0, window_m=SETTINGS.window_m, speed_mps=5.0
    ).sigma_m(8.0)
    assert np.std(found) == pytest.approx(expected, rel=0.3)


def test_points_stay_where_they_are_while_the_vehicle_drives_a_circle() -> None:
    trail, speed_mps, radius_m = Trail(SETTINGS), 5.0, 20.0
    trail.add(10.0, 2.0)
    motion = Motion(speed_mps, speed_mps / radius_m)
    for _ in range(100):
        trail.move(motion, 0.01)
    angle = 100 * 0.01 * speed_mps / radius_m
    here = np.array([radius_m * math.sin(angle), radius_m * (1 - math.cos(angle))])
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    assert trail.visible_points()[0, :2] == pytest.approx(turn @ (np.array([10.0, 2.0]) - here), abs=1e-4)


def test_many_detections_of_one_place_are_one_point_between_them() -> None:
    trail = Trail(SETTINGS)
    for y_m in (0.1, -0.1, 0.1, -0.1):
        trail.add(10.0, y_m)
    seen = trail.visible_points()
    assert len(seen) == 1
    assert abs(seen[0, 1]) < 0.05
    assert seen[0, 2] <= SETTINGS.least_sigma_m**-2


def test_points_far_behind_or_ahead_are_dropped() -> None:
    trail = Trail(SETTINGS)
    trail.add(3.0, 0.0)
    trail.move(Motion(5.0, 0.0), 2.0)
    assert len(trail.visible_points()) == 1
    trail.move(Motion(5.0, 0.0), 2.0)
    assert len(trail.visible_points()) == 0


def test_the_curvature_rate_of_the_trail_falls_with_speed() -> None:
    rates = [max_curvature_rate_1pm2(v, SETTINGS) for v in (0.0, 3.0, 5.0, 8.0, 20.0)]
    assert rates == sorted(rates, reverse=True)
    assert max_curvature_rate_1pm2(10.0, SETTINGS) == pytest.approx(SETTINGS.road_jerk_mps3 / 1000)


STEP_S, OVER_S = 0.04, 1.5
ROAD, TRAIL = Lane(0.0, 0.0, 0.0, 0.0), Lane(0.4, 0.03, 0.01, 0.0)
WHEELBASE_M, LOOKAHEAD_M = 1.75, 8.0


def drive_paths(paths: list[Path | None], *, speed_mps: float = 4.0) -> list[Path | None]:
    hand_over = HandOver(OVER_S)
    return [hand_over.step(path, Motion(speed_mps, 0.0), now_s=n * STEP_S) for n, path in enumerate(paths)]


def switch(before: tuple[Lane, str], after: tuple[Lane, str], *, steps: int = 60) -> list[Path]:
    """Ten steps on one path, the rest on the other; both stay fixed relative to the vehicle."""
    paths = [
        Path(n * STEP_S, *(before if n < 10 else after)[:1], 20.0, (before if n < 10 else after)[1])
        for n in range(steps)
    ]
    return [path for path in drive_paths(list(paths), speed_mps=0.0) if path is not None]


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
    found = drive_paths([None, None, Path(2 * STEP_S, TRAIL, 20.0, "lead")])
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
