"""The quantities that each steering rule measures, and their effect in closed loop (inventory S12, S14–S18)."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from steering_rule_rig import PICTURE, WIDTH_M, drive, line, pair

from perception.techniques.image.picture import Boundaries, Boundary, camera_view
from perception.techniques.steering.abdelrahman import (
    Abdelrahman,
    Leaf,
    Lines,
    Outcome,
    lower_tree,
    mean_angle,
    upper_tree,
)
from perception.techniques.steering.centre_line import Tu, dev_angle, tu_angle
from perception.techniques.steering.centre_line import dev as dev_stage
from perception.techniques.steering.lane import straight_lane
from perception.techniques.steering.rule import ImageLine, level_lines
from perception.techniques.steering.sujatha import Sujatha, case_2, case_3a, case_3b, heading
from perception.techniques.steering.umamaheswari import Umamaheswari, crossings
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

Rule = Callable[[ImageLine, ImageLine], float]
RUNS = [
    (speed, gain, delay) for speed in (5.0, 15.0) for gain in (0.1, 0.3) for delay in (0.0, 0.1)
]  # the inventory's table


def dev(left: ImageLine, right: ImageLine) -> float:
    return dev_angle(left, right)


def tu(left: ImageLine, right: ImageLine) -> float:
    return tu_angle(left, right, PICTURE, width_m=WIDTH_M)


def sujatha(left: ImageLine, right: ImageLine) -> float:
    return case_2(left, right, PICTURE)


def umamaheswari(left: ImageLine, right: ImageLine) -> float:
    seen = crossings(left, right, PICTURE)
    return 0.0 if seen is None else seen.theta_rad


def drive_rule(rule: Rule, speed_mps: float, gain: float, delay_s: float):
    def steer(e: float, psi: float) -> float:
        return max(-0.5, min(0.5, gain * rule(*pair(e, psi))))

    return drive(steer, speed_mps=speed_mps, delay_s=delay_s, duration_s=60)


def measures(rule: Rule) -> tuple[bool, bool]:
    """Whether the rule changes with the offset and with the heading."""
    at_rest = rule(*pair(0.0, 0.0))
    by_offset, by_heading = rule(*pair(0.3, 0.0)), rule(*pair(0.0, 0.1))
    return abs(by_offset - at_rest) > 1e-3, abs(by_heading - at_rest) > 1e-3


def test_bisector_and_mean_measure_the_offset_the_meeting_point_the_heading_the_crossings_both():
    assert measures(dev) == (True, False) and measures(tu) == (True, False)
    assert measures(sujatha) == (False, True)
    assert measures(umamaheswari) == (True, True)


def test_bisector_and_mean_alone_leave_the_lane_in_most_runs_and_swing_wider_in_all_others():
    runs = [drive_rule(rule, *run) for rule in (dev, tu) for run in RUNS]
    assert sum(run.left_lane for run in runs) >= 12
    assert all(run.left_lane or run.final_m > 0.5 for run in runs)


def test_the_meeting_point_never_returns_the_car_to_the_centre():
    assert all(drive_rule(sujatha, *run).final_m == pytest.approx(0.5, abs=0.01) for run in RUNS)


def test_the_crossings_hold_the_lane_in_six_of_eight_runs():
    runs = [drive_rule(umamaheswari, *run) for run in RUNS]
    assert sum(not run.left_lane and run.final_m < 0.1 for run in runs) == 6


@pytest.mark.parametrize("gain_1ps", [0.5, 1.0])
@pytest.mark.parametrize("speed_mps", [5.0, 15.0])
@pytest.mark.parametrize("delay_s", [0.0, 0.1, 0.2])
def test_the_exact_pair_with_stanley_holds_the_lane_in_every_run(gain_1ps, speed_mps, delay_s):
    def steer(e: float, psi: float) -> float:
        seen = straight_lane(
            *pair(e, psi), focal_px=PICTURE.focal_px, centre_x_px=PICTURE.centre_x_px,
            height_m=PICTURE.camera_height_m,
        )  # fmt: skip
        return -seen.heading_rad - math.atan(gain_1ps * seen.offset_m / speed_mps)

    run = drive(steer, speed_mps=speed_mps, delay_s=delay_s)
    assert not run.left_lane and run.final_m < 0.05


@pytest.mark.parametrize("start_m", [-0.6, 0.6])
def test_case_3b_keeps_its_two_metres_only_with_the_heading_of_its_line(start_m):
    def distance(with_heading: bool) -> tuple[bool, float]:
        def steer(e: float, psi: float) -> float:
            seen = line(2.0, e, psi)
            angle = case_3b(seen, None, PICTURE, distance_m=2.0)
            return 0.3 * (angle - with_heading * heading(seen, PICTURE))

        run = drive(steer, speed_mps=5.0, delay_s=0.0, duration_s=60, offset_m=start_m)
        return run.left_lane, run.final_m

    left_lane, swing_m = distance(with_heading=False)
    assert left_lane or swing_m > 0.6
    left_lane, swing_m = distance(with_heading=True)
    assert not left_lane and swing_m < 0.1


# --- Abdelrahman's trees (S14–S16)


def tree(seen: Lines, before: Lines = Lines(), turned_rad: float = 0.0) -> Outcome:  # noqa: B008 — frozen
    return lower_tree(seen, before, turned_rad, PICTURE, width_m=WIDTH_M)


LEFT, RIGHT = pair(0.0, 0.0)
TOO_NEAR = line(-0.4, 0.0, 0.0)  # an artefact right of the centre
TOO_FAR = line(WIDTH_M * 0.9, 0.0, 0.0)  # the line of the next lane


@pytest.mark.parametrize(
    ("seen", "before", "turned_rad", "leaf"),
    [
        (Lines(LEFT, RIGHT), Lines(), 0.0, Leaf.BOTH),
        (Lines(LEFT, TOO_NEAR), Lines(), +0.1, Leaf.ONLY_LEFT),
        (Lines(LEFT, TOO_NEAR), Lines(), -0.1, Leaf.ONLY_RIGHT),
        (Lines(LEFT, TOO_NEAR), Lines(LEFT, RIGHT), 0.0, Leaf.ONLY_LEFT),
        (Lines(LEFT, TOO_NEAR), Lines(), 0.0, Leaf.ONLY_LEFT),
        (Lines(TOO_FAR, RIGHT), Lines(), 0.0, Leaf.ONLY_RIGHT),
        (Lines(left=LEFT), Lines(), 0.0, Leaf.ONLY_LEFT),
        (Lines(right=RIGHT), Lines(), 0.0, Leaf.ONLY_RIGHT),
        (Lines(right=line(-0.1, 0, 0)), Lines(left=line(0.1, 0, 0)), 0.0, Leaf.CROSSED_LEFT),
        (Lines(left=line(0.1, 0, 0)), Lines(right=line(-0.1, 0, 0)), 0.0, Leaf.CROSSED_RIGHT),
        (Lines(), Lines(LEFT, RIGHT), 0.0, Leaf.NONE),
    ],
)
def test_every_leaf_of_the_lower_tree_is_reached_and_has_its_mirror_image(seen, before, turned_rad, leaf):
    assert tree(seen, before, turned_rad).leaf is leaf
    swap = {
        Leaf.ONLY_LEFT: Leaf.ONLY_RIGHT,
        Leaf.ONLY_RIGHT: Leaf.ONLY_LEFT,
        Leaf.CROSSED_LEFT: Leaf.CROSSED_RIGHT,
        Leaf.CROSSED_RIGHT: Leaf.CROSSED_LEFT,
    }
    other = tree(mirror(seen), mirror(before), -turned_rad)
    assert other.leaf is swap.get(leaf, leaf)
    one, two = mean_angle(tree(seen, before, turned_rad), Lines()), mean_angle(other, Lines())
    assert two == (None if one is None else pytest.approx(-one, abs=1e-12))


def mirror(lines: Lines) -> Lines:
    def flip(one: ImageLine | None) -> ImageLine | None:
        return None if one is None else ImageLine(-one.m, 2 * PICTURE.centre_x_px - one.k)

    return Lines(flip(lines.right), flip(lines.left))


slopes = st.none() | st.floats(-4, 4)


@settings(max_examples=300, deadline=None)
@given(
    now=st.tuples(slopes, slopes), then=st.tuples(slopes, slopes), turned=st.sampled_from([0.0, 0.2, -0.2])
)
def test_the_lower_tree_is_mirror_symmetric_with_and_without_a_memory(now, then, turned):
    seen, before = (
        Lines(*(None if m is None else ImageLine(m, PICTURE.centre_x_px - 240 * m) for m in pair))
        for pair in (now, then)
    )
    one = mean_angle(tree(seen, before, turned), Lines())
    other = mean_angle(tree(mirror(seen), mirror(before), -turned), Lines())
    assert other == (None if one is None else pytest.approx(-one, abs=1e-9))


def test_a_pair_as_wrong_on_the_left_as_on_the_right_is_driven_by_its_middle():
    narrow = Lines(line(0.8, 0, 0), line(-0.8, 0, 0))
    assert tree(narrow).leaf is Leaf.BOTH and mean_angle(tree(narrow), Lines()) == pytest.approx(0, abs=1e-9)


def test_a_car_that_has_crossed_a_line_is_sent_back_over_it():
    after = tree(Lines(right=line(-0.1, 0, 0)), Lines(left=line(0.1, 0, 0)))
    assert mean_angle(after, Lines()) < -0.5  # its lane is on the right
    unknown = tree(Lines(right=line(-0.1, 0, 0)))
    assert mean_angle(unknown, Lines()) > 0.5  # no memory: keep to the left of a right line


def test_a_left_line_that_bends_into_the_upper_right_is_ignored_and_a_true_right_line_kept():
    def lines_as_printed(upper: Lines, lower: Lines) -> Lines:  # the inverse condition
        extension = upper.right is not None and lower.left is not None and lower.right is None
        return upper if extension else Lines(upper.left, None)

    extension, true = Lines(right=line(-0.3, 0, 0.2)), Lines(right=RIGHT)
    assert upper_tree(extension, Lines(left=LEFT)).right is None
    assert upper_tree(true, Lines(LEFT, RIGHT)).right is RIGHT
    assert lines_as_printed(extension, Lines(left=LEFT)).right is not None
    assert lines_as_printed(true, Lines(LEFT, RIGHT)).right is None
    assert upper_tree(mirror(extension), mirror(Lines(left=LEFT))).left is None


def test_the_mean_of_slopes_is_78_degrees_half_a_metre_beside_the_centre():
    left, right = pair(-0.5, 0.0)
    printed = math.degrees(math.atan((1 / left.m + 1 / right.m) / 2))
    assert 90 - abs(printed) == pytest.approx(78, abs=0.1)  # away from the vertical
    angle = mean_angle(tree(Lines(left, right)), Lines(left, right))
    assert angle == pytest.approx(tu_angle(left, right, PICTURE, width_m=WIDTH_M))


def boundaries(e: float, psi: float) -> Boundaries:
    """A straight lane on the road as the pipeline passes it on."""
    x_m = np.linspace(4.0, 25.0, 43)
    sides = [(-math.tan(psi) * x_m + (b - e) / math.cos(psi)) for b in (WIDTH_M / 2, -WIDTH_M / 2)]
    return Boundaries(*(Boundary(x_m, y_m, 0.0, 1.0) for y_m in sides))


STAGES = {
    "dev": lambda: dev_stage,
    "tu": lambda: Tu().step,
    "sujatha": lambda: Sujatha().step,
    "umamaheswari": lambda: Umamaheswari().step,
    "abdelrahman": lambda: Abdelrahman().step,
}


@pytest.mark.parametrize("name", STAGES)
def test_every_rule_as_a_stage_steers_against_the_pose_and_the_mirrored_pose_the_other_way(name):
    view = camera_view(load(CONFIG_DIR / "camera.yaml", Camera))
    one, other = (STAGES[name]()(boundaries(s * 0.4, s * 0.1), view, 0.04).angle_rad for s in (1, -1))
    assert one < -0.001 and other == pytest.approx(-one, abs=1e-9)
    assert STAGES[name]()(Boundaries(None, None), view, 10.0) is None


@pytest.mark.parametrize("name", ["tu", "umamaheswari", "abdelrahman"])
def test_a_stage_for_one_line_gives_the_same_angle_with_it(name):
    view = camera_view(load(CONFIG_DIR / "camera.yaml", Camera))
    both = boundaries(0.2, 0.0)
    settings_ = dict(width_m=WIDTH_M)
    stage = {"tu": Tu, "umamaheswari": Umamaheswari, "abdelrahman": Abdelrahman}[name]
    angle = stage(**settings_).step(both, view, 0.04).angle_rad
    for one in (Boundaries(both.left, None), Boundaries(None, both.right)):
        assert stage(**settings_).step(one, view, 0.04).angle_rad == pytest.approx(angle, abs=1e-3)


@pytest.mark.parametrize("hidden", ["left", "right"])
def test_with_one_line_sujatha_keeps_the_middle_by_case_3a_or_a_distance_by_case_3b(hidden):
    view = camera_view(load(CONFIG_DIR / "camera.yaml", Camera))
    both = boundaries(0.3, 0.05)
    one = replace(both, **{hidden: None})
    left, right, picture = level_lines(one, view)
    middle = Sujatha(gain=1.0, one_line="middle", width_m=3.0).step(one, view, 0.04)
    distance = Sujatha(gain=1.0, one_line="distance", distance_m=1.2).step(one, view, 0.04)
    assert middle.angle_rad == case_3a(left, right, picture, width_m=3.0)
    aside = case_3b(left, right, picture, distance_m=1.2)
    assert distance.angle_rad == pytest.approx(aside - heading(left or right, picture))
    two = Sujatha(gain=1.0).step(both, view, 0.04)
    assert middle.angle_rad == pytest.approx(two.angle_rad, abs=0.01) and two.angle_rad < -0.03


def test_sujatha_takes_a_line_for_left_or_right_by_its_half_of_the_picture():
    """The nearer line of a side counts; a crossed left boundary lies right of the camera."""
    view = camera_view(load(CONFIG_DIR / "camera.yaml", Camera))
    lane = boundaries(0.0, 0.0)
    crossed = replace(lane, left=replace(lane.left, y_m=lane.right.y_m + 0.9))
    alone = Boundaries(None, crossed.left)
    assert Sujatha().step(crossed, view, 0.04) == Sujatha().step(alone, view, 0.04)


def test_abdelrahman_drives_by_the_upper_pair_alone_for_as_long_as_it_lasts():
    view = camera_view(load(CONFIG_DIR / "camera.yaml", Camera))
    rule, lane = Abdelrahman(split_m=3.0), boundaries(0.4, 0.0)
    angles = [rule.step(lane, view, 0.2) for _ in range(5)]
    assert angles[-1] == angles[0] and angles[0].angle_rad < -0.001 and angles[0].certainty == 1


@settings(max_examples=30, deadline=None)
@given(e=st.floats(-1, 1), psi=st.floats(-0.1, 0.1))
def test_one_line_steers_like_two(e, psi):
    left, right = pair(e, psi)
    both = mean_angle(tree(Lines(left, right)), Lines())
    assert mean_angle(tree(Lines(left=left)), Lines()) == pytest.approx(both, abs=0.01)
    assert mean_angle(tree(Lines(right=right)), Lines()) == pytest.approx(both, abs=0.01)
