"""Every boundary model fits its own family, in spite of outliers, and reports a missing boundary (B08–B32)."""

import math

import numpy as np
import pytest
from boundary_rig import VIEW, WIDTH_M, Course, arc, errors_px, features

from perception.techniques.boundaries.arcs import arc_lane, arcs
from perception.techniques.boundaries.curves import (
    histogram_cubic,
    hyperbola,
    near_line_far_parabola,
    pchip,
)
from perception.techniques.boundaries.evidence import Points, histogram_peaks, road_points
from perception.techniques.boundaries.lines import hough_standard
from perception.techniques.boundaries.ransac import (
    bezier_points,
    consensus,
    control_points,
    cubic_spline,
    polynomial,
    ransac_bezier,
    ransac_bspline,
    ransac_line,
    ransac_parabola,
    straight_curve,
)
from perception.techniques.image.picture import Boundaries, Boundary, Evidence, FeatureKind, Features

STRAIGHT = arc(math.inf, offset_m=0.2, heading_rad=0.03)


def late_bend(x: np.ndarray) -> np.ndarray:
    """Straight for 12 m, then R = 60 m: the family of B21 and B27."""
    return 0.1 + np.maximum(0.0, x - 12.0) ** 2 / 120


def s_bend(x: np.ndarray) -> np.ndarray:
    return 0.6 * np.sin(x / 7.0)


RANSAC = {
    "line": (ransac_line, STRAIGHT),
    "parabola": (ransac_parabola, arc(60.0, offset_m=-0.2)),
    "bspline": (ransac_bspline, s_bend),
    "straight_curve": (straight_curve, late_bend),
}
FAMILIES = RANSAC | {
    "hough_standard": (hough_standard, STRAIGHT),
    "near_line_far_parabola": (near_line_far_parabola, late_bend),
    "histogram_cubic": (histogram_cubic, s_bend),
    "hyperbola": (hyperbola, arc(-50.0)),
    "pchip": (pchip, s_bend),
    "bezier": (ransac_bezier, arc(60.0)),
}
BENDING = ["parabola", "bspline", "histogram_cubic", "hyperbola", "bezier", "near_line_far_parabola"]


def fit(name: str, seen: Features, predicted: Boundaries | None = None) -> Boundaries:
    return FAMILIES[name][0](Evidence(seen, VIEW, predicted))


@pytest.mark.parametrize("name", FAMILIES)
def test_each_model_fits_its_own_family_to_a_pixel(name):
    course: Course = FAMILIES[name][1]
    assert max(errors_px(fit(name, features(course)), course)) < 1.0


@pytest.mark.parametrize("name", FAMILIES)
def test_each_model_joins_dashes(name):
    course: Course = (
        STRAIGHT if name == "pchip" else FAMILIES[name][1]
    )  # the course of an S in a gap is undetermined
    assert max(errors_px(fit(name, features(course, dashes=True)), course)) < 2.0


@pytest.mark.parametrize("name", RANSAC)
def test_with_half_of_all_points_wrong_consensus_is_within_two_pixels(name):
    course: Course = RANSAC[name][1]
    errors = [
        max(errors_px(fit(name, features(course, outliers=0.5, seed=seed)), course)) for seed in range(6)
    ]
    # Six free coefficients follow the clutter in one picture of six: 3.1 px is the worst of twenty.
    assert np.median(errors) < 2.0 if name == "bspline" else max(errors) < 2.0


@pytest.mark.parametrize("name", FAMILIES)
def test_the_same_seed_gives_the_same_curve(name):
    seen = features(FAMILIES[name][1], outliers=0.3)
    one, two = fit(name, seen), fit(name, seen)
    assert (one.left is None) == (two.left is None)
    assert one.left is None or np.array_equal(one.left.y_m, two.left.y_m)


@pytest.mark.parametrize("name", FAMILIES)
@pytest.mark.parametrize("response", [np.zeros((240, 320), np.uint8), np.full((240, 320), 255, np.uint8)])
def test_an_empty_map_has_no_boundaries_and_a_full_one_no_good_ones(name, response):
    found = fit(name, Features(response, FeatureKind.LINE))
    if not response.any():
        assert found.side_count == 0 and found.reason
    for side in (found.left, found.right):
        assert side is None or np.isfinite(side.y_m).all()


@pytest.mark.parametrize("name", FAMILIES)
def test_of_one_boundary_only_that_side_is_found(name):
    found = fit(name, features(FAMILIES[name][1], shown=(True, False)))
    assert found.left is not None and found.right is None and "right" in found.reason


@pytest.mark.parametrize("name", BENDING)
@pytest.mark.parametrize("radius_m", [50.0, -50.0, 120.0])
def test_the_radius_of_a_bend_is_right_to_a_tenth(name, radius_m):
    course = arc(radius_m) if name != "near_line_far_parabola" else None
    if course is None:  # its bend begins where its line ends

        def course(x):
            return np.maximum(0.0, x - 12.0) ** 2 / 2 / radius_m

    found = fit(name, features(course))
    side = found.left if radius_m > 0 else found.right  # the longer one
    assert side is not None, found.reason
    x_m = side.x_m[side.x_m > 12.5] if name == "near_line_far_parabola" else side.x_m
    c2 = np.polynomial.polynomial.polyfit(x_m, side.at(x_m), 2)[2]
    inner = radius_m - math.copysign(WIDTH_M / 2, radius_m) * (1 if side is found.left else -1)
    assert 2 * c2 == pytest.approx(1 / inner, rel=0.12)


def test_a_prediction_selects_one_of_two_lines():
    near = features(arc(math.inf))
    far = features(lambda x: 0 * x + 1.2)
    seen = Features(np.maximum(near.response, far.response), FeatureKind.LINE)
    x_m = np.array([3.0, 30.0])
    for y_m in (1.7, 2.9):
        predicted = Boundaries(Boundary(x_m, np.full(2, y_m), 0.0, 1.0), None)
        left = fit("line", seen, predicted).left
        assert left.at(10.0) == pytest.approx(y_m, abs=0.1)


def test_a_hyperbola_of_the_picture_is_a_parabola_of_the_road():
    x_m = np.linspace(5, 30, 60)
    y_m = 1.5 - 0.05 * x_m + x_m**2 / 160
    level_v, level_u = 300 * 1.4 / x_m, -300 * y_m / x_m  # f = 300 px, h = 1.4 m, horizon in row 0
    basis = np.column_stack([1 / level_v, level_v, np.ones_like(level_v)])
    residual = np.linalg.lstsq(basis, level_u, rcond=None)[1]
    assert residual[0] < 1e-15


def test_histogram_peaks_lie_at_the_lines():
    peaks = histogram_peaks(road_points(Evidence(features(arc(math.inf)), VIEW)))
    assert any(abs(peak - 1.7) < 0.2 for peak in peaks) and any(abs(peak + 1.7) < 0.2 for peak in peaks)


def test_bezier_curves_pass_their_ends_and_determine_their_control_points():
    control = np.array([[0.0, 1.0], [5.0, 1.2], [12.0, 2.0], [20.0, 4.0]])
    points = bezier_points(control, np.linspace(0, 1, 200))
    assert points[0] == pytest.approx(control[0]) and points[-1] == pytest.approx(control[-1])
    again = bezier_points(control_points(points), np.linspace(0, 1, 200))
    order = np.interp(points[:, 0], again[:, 0], again[:, 1])
    assert order == pytest.approx(points[:, 1], abs=0.02)


def test_the_b_spline_basis_sums_to_one_and_holds_every_cubic():
    x_m = np.linspace(0, 40, 100)
    basis = cubic_spline(x_m)
    assert basis.sum(axis=1) == pytest.approx(1)
    cubic = 1 + 0.2 * x_m - 0.01 * x_m**2 + 0.0005 * x_m**3
    assert basis @ np.linalg.lstsq(basis, cubic, rcond=None)[0] == pytest.approx(cubic, abs=1e-9)


def test_too_few_points_give_no_curve():
    points = Points(np.array([1.0, 2.0, 3.0]), np.zeros(3))
    rng = np.random.default_rng(0)
    assert consensus(points, polynomial(1), rng, size=2, inlier_m=0.1, tries=5) is None


def circle(radius_m: float, offset_m: float) -> Course:
    """The lane centre on an exact circle."""
    return lambda x: (
        -offset_m
        + radius_m
        - math.copysign(1, radius_m) * np.sqrt(radius_m**2 - np.minimum(x**2, 0.95 * radius_m**2))
    )


@pytest.mark.parametrize("radius_m", [10.0, -10.0, 14.0, 1e4])
def test_arcs_follow_bends_that_are_too_tight_for_a_parabola(radius_m):
    course = circle(radius_m, 0.2)
    evidence = Evidence(features(course, far_m=8.0), VIEW, None)
    lane = arc_lane(arcs(evidence, width_m=WIDTH_M, bend_1pm=0.1), VIEW, width_m=WIDTH_M).lane
    assert lane.curvature_at(5.0) == pytest.approx(1 / radius_m, abs=0.015)
    assert lane.y_m(6.0) == pytest.approx(float(course(np.array([6.0]))[0]), abs=0.25)


def test_arcs_remember_a_boundary_that_has_left_the_picture():
    """The inner line of a bend is beside the picture; its width stays known, with a lower score."""
    course = circle(12.0, 0.0)
    both_seen = arcs(Evidence(features(course, far_m=8.0), VIEW, None), width_m=WIDTH_M, bend_1pm=0.1)
    outer = features(course, far_m=8.0, shown=(False, True))
    after = arcs(Evidence(outer, VIEW, both_seen), width_m=WIDTH_M, bend_1pm=0.1)
    assert after.left.support < both_seen.left.support and "left" in after.reason
    assert arc_lane(after, VIEW).width_m == pytest.approx(WIDTH_M, rel=0.1)


def test_arcs_find_nothing_in_an_empty_picture():
    nothing = arcs(Evidence(Features(np.zeros((240, 320), np.uint8), FeatureKind.LINE), VIEW, None))
    assert nothing.side_count == 0 and nothing.reason and arc_lane(nothing, VIEW) is None
