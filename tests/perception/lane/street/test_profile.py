"""Profiles of drawn streets for a level camera whose horizon is known."""

import numpy as np
import pytest
from drawn_road_rig import CAMERA, GRASS, SETTINGS, WHITE, YELLOW, ribbon, road

from perception.lane.street.profile import MIN_ROWS, StreetCourse
from perception.lane.street_finder import horizon_of, street_view

DASHCAM = CAMERA.model_copy(
    update=dict(fx_px=288.0, fy_px=288.0, height_m=1.3, pitch_down_rad=0.0, cx_px=159.5, cy_px=119.5, x_m=1.7)
)
STRAIGHT = (0.0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="module")
def view():
    return street_view(SETTINGS, DASHCAM)


def profile_of(view, image, near=None):
    return view.profile(image, horizon_of(DASHCAM), near)[0]


def at(profile, place_m):
    return int(np.abs(profile.left_m - place_m).argmin())


def plain(*strips):
    """A street wider than the image, with ``strips`` (place, width, colour) on it."""
    image = np.full((240, 320, 3), 100, np.uint8)
    image[:120] = (220, 180, 150)
    for place_m, width_m, colour in strips:
        ribbon(image, DASHCAM, STRAIGHT, place_m, width_m, colour)
    noise = np.random.default_rng(0).normal(0, 2, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("place_m", [2.4, 1.2, -0.7, -2.0])
def test_a_line_is_the_highest_peak_at_its_place(view, place_m):
    profile = profile_of(view, plain((place_m, 0.12, WHITE)))
    assert profile.left_m[profile.line.argmax()] == pytest.approx(place_m, abs=0.11)
    assert profile.line.max() > 0.7


def test_a_dashed_line_has_the_share_of_its_dashes(view):
    image = plain()
    ribbon(image, DASHCAM, STRAIGHT, 1.2, 0.12, WHITE, lambda station_m: station_m % 6 < 3)
    profile = profile_of(view, image)
    assert 0.25 < profile.line[at(profile, 1.2)] < 0.75


def test_only_yellow_paint_is_yellow(view):
    profile = profile_of(view, plain((1.5, 0.12, YELLOW), (-1.5, 0.12, WHITE)))
    left, right = (slice(at(profile, place) - 1, at(profile, place) + 2) for place in (1.5, -1.5))
    assert profile.yellow[left].max() > 0.8 and profile.yellow[right].max() < 0.2


@pytest.mark.parametrize(("side", "sign"), [(1, -1), (-1, 1)])
def test_a_step_has_the_sign_of_the_change_to_the_right(view, side, sign):
    """The pavement beside the street is lighter: on the left, light changes to dark."""
    profile = profile_of(view, plain((side * 4.0, 4.0, (170, 170, 170))))
    place = at(profile, 2.0 * side)
    assert sign * profile.step[place - 2 : place + 3].mean() > 0.3
    assert abs(profile.step[at(profile, -1.0 * side)]) < 0.1


def test_grass_is_another_surface_and_the_street_is_not(view):
    profile = profile_of(view, plain((4.0, 4.0, GRASS)))
    assert profile.other[at(profile, 3.0)] > 0.8 and profile.other[at(profile, -1.0)] < 0.2


def test_places_beside_the_image_are_not_seen(view):
    profile = profile_of(view, plain())
    assert profile.seen[at(profile, 0.0)]
    rows = view.inside.sum(axis=0)
    assert not profile.seen[rows < MIN_ROWS / 2].any()


@pytest.mark.parametrize("heading_rad", [-0.15, -0.05, 0.1])
def test_the_heading_against_the_road_is_that_of_the_course(view, heading_rad):
    image = road((0.0, heading_rad, 0.0, 0.0), camera=DASHCAM)
    assert profile_of(view, image).course.heading_rad == pytest.approx(heading_rad, abs=0.03)


@pytest.mark.parametrize("curvature_1pm", [-0.012, 0.012])
def test_a_bend_has_the_curvature_of_the_course(view, curvature_1pm):
    course = profile_of(view, road((0.0, 0.0, curvature_1pm, 0.0), camera=DASHCAM)).course
    assert course.curvature_1pm == pytest.approx(curvature_1pm, abs=0.008)


def test_a_course_near_the_one_before_wins_where_nothing_is_drawn(view):
    near = StreetCourse(0.1, 0.0, horizon_of(DASHCAM))
    course = profile_of(view, plain(), near).course
    assert course.heading_rad == pytest.approx(0.1, abs=0.05)


def test_points_of_a_step_lie_on_the_kerb(view):
    image = plain((4.0, 4.0, (170, 170, 170)))
    profile, levelled = view.profile(image, horizon_of(DASHCAM))
    state = np.array([0.0, profile.course.heading_rad, profile.course.curvature_1pm, 0.0, 3.3, 0.0])
    points = view.step_points(levelled, state, 2.0)
    near = points.x_m < 15.0
    assert near.sum() > 15
    assert np.median(points.y_m[near]) == pytest.approx(2.0, abs=0.12)
