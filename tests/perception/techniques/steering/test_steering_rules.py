"""The corrected steering rules, and the errors of their printed forms (inventory S01–S13)."""

import math
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from steering_rule_rig import HEIGHT_M, PICTURE, WIDTH_M, line, pair

from perception.techniques.steering.centre_line import bisector, dev_angle, tu_angle
from perception.techniques.steering.rule import (
    Hold,
    ImageAngle,
    ImageLine,
    RoadWheel,
    RuleAngle,
    mean_line,
    meeting_point,
    road_wheel,
)
from perception.techniques.steering.sujatha import (
    base_angle,
    case_2,
    case_3a,
    case_3b,
    heading,
    left_and_right,
)
from perception.techniques.steering.umamaheswari import (
    Turn,
    affine_left,
    affine_right,
    crossings,
    decide,
    inclination_deg,
)

slopes = st.floats(-20, 20)
places = st.floats(-500, 1000)
offsets = st.floats(-1.2, 1.2)
headings = st.floats(-0.3, 0.3)


def mirror_line(image_line: ImageLine) -> ImageLine:
    return ImageLine(-image_line.m, 2 * PICTURE.centre_x_px - image_line.k)


def distance_px(image_line: ImageLine, x: float, y: float) -> float:
    return abs(x - image_line.x(y)) / math.hypot(1, image_line.m)


# --- Dev (S01–S03)


@settings(max_examples=60, deadline=None)
@given(ml=slopes, kl=places, mr=slopes, kr=places, y=st.floats(-300, 800))
def test_every_point_of_the_bisector_is_equally_far_from_both_lines(ml, kl, mr, kr, y):
    left, right = ImageLine(ml, kl), ImageLine(mr, kr)
    x = bisector(left, right).x(y)
    assert distance_px(left, x, y) == pytest.approx(distance_px(right, x, y), abs=1e-9 * (1 + abs(x)))


def test_the_printed_bisector_divides_by_zero_for_a_centred_car_and_ours_does_not():
    left, right = ImageLine(-1.5, 680.0), ImageLine(1.5, -40.0)
    s_left, s_right = 1 / left.m, 1 / right.m
    b_left, b_right = math.hypot(1, s_left), math.hypot(1, s_right)
    with pytest.raises(ZeroDivisionError):
        _ = (s_left * b_right - s_right * b_left) / (b_right - b_left)
    assert dev_angle(left, right) == 0


def test_the_printed_angle_of_the_bisector_is_90_degrees_where_the_text_has_0():
    centre = bisector(*pair(1e-9, 0.0))
    (x2, y2), (x1, y1) = (centre.x(479), 479), (centre.x(240), 240)
    assert abs(math.degrees(math.atan2(y2 - y1, x2 - x1))) == pytest.approx(90, abs=1e-5)
    assert dev_angle(*pair(1e-9, 0.0)) == pytest.approx(0, abs=1e-6)


def test_dev_gives_no_angle_without_both_lines():
    left, right = pair(0.2, 0.0)
    assert dev_angle(left, None) is None and dev_angle(None, right) is None


# --- Tu (S13)


@settings(max_examples=40, deadline=None)
@given(e=offsets, psi=headings, y=st.floats(250, 479))
def test_the_mean_of_the_lines_is_the_centre_of_the_lane_in_every_row(e, psi, y):
    centre = line(0.0, e, psi)
    assert mean_line(*pair(e, psi)).x(y) == pytest.approx(centre.x(y), abs=1e-6)


def test_the_mean_of_angles_is_a_third_of_the_mean_of_lines():
    left, right = pair(-0.5, 0.0)
    angles = math.degrees(math.atan(-left.m) + math.atan(-right.m)) / 2
    assert angles == pytest.approx(7.9, abs=0.05)
    assert math.degrees(tu_angle(left, right, PICTURE, width_m=WIDTH_M)) == pytest.approx(22.6, abs=0.05)


@pytest.mark.parametrize("hidden", ["left", "right"])
def test_a_centred_car_with_one_line_goes_straight_where_the_printed_rule_has_55_degrees(hidden):
    left, right = pair(0.0, 0.0)
    seen = (None, right) if hidden == "left" else (left, None)
    printed = math.degrees(math.atan(-(right if hidden == "left" else left).m))
    assert abs(printed) == pytest.approx(55.6, abs=0.05)
    assert tu_angle(*seen, PICTURE, width_m=WIDTH_M) == pytest.approx(0, abs=math.radians(0.5))


@pytest.mark.parametrize(("straight", "held"), [(False, 0.3), (True, 0.0)])
def test_a_lost_line_is_bridged_for_its_limit_and_no_longer(straight, held):
    hold = Hold(limit_s=0.2, straight=straight)
    assert hold.step(None, 0.1) is None  # no line yet
    assert hold.step(RoadWheel(0.3), 0.1) == RuleAngle(0.3)
    bridged = hold.step(None, 0.15)
    assert bridged.angle_rad == held and bridged.certainty == pytest.approx(0.25) and bridged.note
    assert hold.step(None, 0.15) is None
    assert hold.step(None, 0.01) is None


# --- Umamaheswari (S04–S06)


@settings(max_examples=40, deadline=None)
@given(e=offsets, psi=st.floats(-0.05, 0.05))
def test_a_virtual_line_lies_where_the_hidden_one_is(e, psi):
    left, right = pair(e, psi)
    for virtual, true in (
        (PICTURE.beside(right, WIDTH_M), left),
        (PICTURE.beside(left, -WIDTH_M), right),
    ):
        assert virtual.m == pytest.approx(true.m, abs=0.005)  # 1 − cos(0.05) of the width
        assert virtual.x(PICTURE.horizon_px) == pytest.approx(true.x(PICTURE.horizon_px), abs=1e-6)


@given(eta=st.floats(20, 80))
def test_the_exact_virtual_edge_obeys_the_cotangent_rule(eta):
    left = ImageLine(-1 / math.tan(math.radians(eta)), 300.0)
    psi = inclination_deg(PICTURE.beside(left, -WIDTH_M))
    assert 1 / math.tan(math.radians(-psi)) == pytest.approx(WIDTH_M / HEIGHT_M + left.m, abs=1e-9)


@given(eta=st.floats(-90, 90))
def test_the_affine_edges_are_mirror_images(eta):
    left, right = affine_left(eta), affine_right(-eta)
    assert (left is None and right is None) or right == -left


def test_the_affine_edge_means_lanes_of_4_to_33_metres_for_one_road():
    widths = [
        HEIGHT_M * (1 / math.tan(math.radians(-eta)) + 1 / math.tan(math.radians(affine_left(eta))))
        for eta in range(-80, -20)
    ]
    assert min(widths) < 4.4 and max(widths) > 30


def test_the_affine_edge_is_none_where_it_would_fall_the_wrong_way():
    assert affine_left(-15.0) is None and affine_left(-15.1) > 0


def test_a_car_right_of_the_centre_or_pointing_right_has_positive_theta_and_phi():
    for e, psi in ((-0.4, 0.0), (0.0, -0.1)):
        seen = crossings(*pair(e, psi), PICTURE)
        assert seen.theta_rad > 0 and seen.phi_px > 0


def test_theta_grows_with_the_offset_and_with_the_heading():
    for poses in ([(-e / 10, 0.0) for e in range(-8, 9)], [(0.0, -p / 50) for p in range(-8, 9)]):
        theta = [crossings(*pair(*pose), PICTURE).theta_rad for pose in poses]
        assert all(after > before for before, after in pairwise(theta))


@pytest.mark.parametrize(
    ("offset_m", "heading_rad", "turn"),
    [
        (0.0, 0.0, Turn.STRAIGHT),
        (0.02, 0.0, Turn.STRAIGHT),
        (-0.02, 0.01, Turn.STRAIGHT),
        (-0.5, 0.0, Turn.LEFT),
        (0.0, -0.15, Turn.LEFT),
        (0.5, 0.0, Turn.RIGHT),
        (0.0, 0.15, Turn.RIGHT),
    ],
)
def test_the_decision_table_on_seven_poses(offset_m, heading_rad, turn):
    seen = crossings(*pair(offset_m, heading_rad), PICTURE)
    assert decide(seen.phi_px, Turn.STRAIGHT) is turn
    assert turn is Turn.STRAIGHT or (seen.theta_rad > 0) == (turn is Turn.LEFT)


def test_noise_about_the_limit_of_the_table_causes_no_chatter():
    turn, changes = Turn.STRAIGHT, 0
    for number in range(100):
        after = decide(30 + (4 if number % 2 else -4), turn)
        changes, turn = changes + (after is not turn), after
    assert changes == 1


# --- Sujatha (S07–S12)


@settings(max_examples=40, deadline=None)
@given(e=offsets, psi=headings)
def test_the_lines_meet_at_the_vanishing_point(e, psi):
    x, y = meeting_point(*pair(e, psi))
    assert x == pytest.approx(PICTURE.centre_x_px + PICTURE.focal_px * math.tan(psi), abs=0.01 * 640)
    assert y == pytest.approx(PICTURE.horizon_px, abs=0.5)


def test_upright_lines_meet_too():
    assert meeting_point(ImageLine(0.0, 300.0), ImageLine(1.0, 60.0)) == (300.0, 240.0)
    assert meeting_point(ImageLine(0.5, 300.0), ImageLine(0.5, 60.0)) is None


def printed_case_2_deg(heading_rad: float, *, quotient: bool) -> float:
    x, y = meeting_point(*pair(0.3, heading_rad))
    across, down = x - 320, y - 480
    return 90 - math.degrees(math.atan(1 / (across / down if quotient else across - down)))


def test_the_printed_case_2_gives_90_degrees_for_any_pose_or_jumps_by_180():
    for heading_rad in (-0.1, -0.02, 0.02, 0.1):
        assert printed_case_2_deg(heading_rad, quotient=False) == pytest.approx(89.8, abs=0.1)
    assert printed_case_2_deg(math.radians(3), quotient=True) == pytest.approx(176, abs=0.1)
    assert printed_case_2_deg(math.radians(-3), quotient=True) == pytest.approx(4, abs=0.1)


def test_case_2_goes_through_zero_and_turns_against_the_heading():
    angles = [case_2(*pair(0.3, heading_rad / 100), PICTURE) for heading_rad in range(-10, 11)]
    assert angles[10] == pytest.approx(0, abs=1e-9)
    steps = [after - before for before, after in pairwise(angles)]
    assert max(steps) < 0 and min(steps) > -0.02


def test_case_2_takes_the_nearest_line_of_each_side():
    left, right = pair(0.0, 0.0)
    outer = line(3 * WIDTH_M / 2, 0.0, 0.0)
    assert left_and_right([outer, right, left], PICTURE) == (left, right)
    assert left_and_right([right], PICTURE) == (None, right)


@pytest.mark.parametrize("hidden", ["left", "right"])
def test_case_3a_goes_straight_when_centred_where_the_border_of_the_picture_gave_35_degrees(hidden):
    left, right = pair(0.0, 0.0)
    border_y = (640 - left.k) / left.m
    assert math.degrees(math.atan2(640 - 320, 480 - border_y)) == pytest.approx(34.8, abs=0.1)
    seen = (None, right) if hidden == "left" else (left, None)
    assert case_3a(*seen, PICTURE, width_m=WIDTH_M) == pytest.approx(0, abs=math.radians(0.5))
    assert case_3a(None, None, PICTURE, width_m=WIDTH_M) is None
    assert case_3a(left, right, PICTURE, width_m=WIDTH_M) is None


def equi_angular(x_m: float, *, printed: bool, y_m: float = 2.0, z_m: float = 1.2) -> tuple[float, float]:
    """The image point of S11, [x, y] with y up; its x as printed for the second point of the line, or as meant."""
    azimuth = math.degrees(math.atan2(y_m, x_m))
    depression = 90 - math.degrees(math.atan(math.hypot(x_m, y_m) / z_m))
    across, down = azimuth * 640 / 90, depression * 480 / 73.74
    return (640 - 320 + across if printed else 640 - (320 + across)), 480 - (240 + down)


def equi_angular_base_deg(x1_m: float, *, printed: bool) -> float:
    (xa, ya), (xb, yb) = equi_angular(x1_m, printed=False), equi_angular(x1_m + 1, printed=printed)
    return math.degrees(math.atan((yb - ya) / (xb - xa)))


def test_case_3b_has_one_base_angle_where_the_printed_one_depends_on_the_chosen_points():
    assert math.degrees(base_angle(2.0, 1.2)) == pytest.approx(30.96, abs=0.01)
    for x1_m in (3.0, 6.0, 12.0):
        (xa, ya), (xb, yb) = ((320 - 320 * 2 / x, 240 + 320 * 1.2 / x) for x in (x1_m, x1_m + 1))
        pinhole = math.degrees(math.atan((ya - yb) / (xb - xa)))
        assert pinhole == pytest.approx(30.96, abs=0.01)
    meant = [equi_angular_base_deg(x1_m, printed=False) for x1_m in (3.0, 6.0)]
    assert abs(meant[0] - meant[1]) > 1
    assert abs(equi_angular_base_deg(3.0, printed=True) - meant[0]) > 10


def test_case_3b_steers_away_from_a_line_that_is_too_near_and_towards_one_that_is_too_far():
    near, far = line(1.0, 0, 0), line(3.0, 0, 0)
    assert case_3b(near, None, PICTURE, distance_m=2.0) < 0 < case_3b(far, None, PICTURE, distance_m=2.0)
    assert case_3b(line(2.0, 0, 0), None, PICTURE, distance_m=2.0) == pytest.approx(0, abs=1e-9)
    mirror = case_3b(None, mirror_line(near), PICTURE, distance_m=2.0)
    assert mirror == pytest.approx(-case_3b(near, None, PICTURE, distance_m=2.0), abs=1e-12)
    assert case_3b(near, mirror_line(near), PICTURE, distance_m=2.0) is None


@given(e=offsets, psi=headings)
def test_one_line_measures_the_heading_at_the_horizon(e, psi):
    assert heading(line(1.7, e, psi), PICTURE) == pytest.approx(psi, abs=1e-6)


# --- all of them


@settings(max_examples=40, deadline=None)
@given(e=offsets, psi=headings)
def test_the_mirrored_picture_is_steered_the_other_way(e, psi):
    left, right = pair(e, psi)
    other = mirror_line(right), mirror_line(left)
    assert dev_angle(*other) == pytest.approx(-dev_angle(left, right), abs=1e-9)
    assert case_2(*other, PICTURE) == pytest.approx(-case_2(left, right, PICTURE), abs=1e-9)
    tu = [tu_angle(*lines, PICTURE, width_m=WIDTH_M) for lines in ((left, right), other)]
    assert tu[1] == pytest.approx(-tu[0], abs=1e-9)
    one, two = crossings(left, right, PICTURE), crossings(*other, PICTURE)
    assert (one is None) == (two is None)
    assert one is None or two.theta_rad == pytest.approx(-one.theta_rad, abs=1e-9)


def test_an_image_angle_becomes_a_road_wheel_angle_by_a_gain_and_absence_stays_absent():
    assert road_wheel(ImageAngle(0.4), gain=0.25) == pytest.approx(0.1)
    assert road_wheel(None, gain=0.25) is None
