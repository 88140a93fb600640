import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from perception.lane.model.fit import _residuals, fit_lane
from perception.lane.model.geometry import (
    PITCH,
    PSI,
    WIDTH,
    E,
    RoadPoints,
    lane_coordinates,
    lane_curve,
    parallel_curve,
)
from perception.lane.settings import LaneCvSettings
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "perception.yaml", LaneCvSettings)
CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)

lanes = st.tuples(
    st.floats(-0.8, 0.8), st.floats(-0.2, 0.2), st.floats(-0.07, 0.07), st.just(0.0), st.floats(2.8, 4.0)
).map(lambda values: np.array([*values, 0.0]))


def boundary_points(mean: np.ndarray) -> tuple[RoadPoints, np.ndarray]:
    """Exact points of both boundaries of the lane ``mean``, and their sides."""
    curve = lane_curve(mean, np.arange(0.0, 15.0, 0.25))
    x, y = curve[:, 12:].real.ravel(), curve[:, 12:].imag.ravel()
    side = np.repeat([1.0, -1.0], len(x) // 2)
    points = RoadPoints(
        x_m=x,
        y_m=y,
        sigma_m=np.full(len(x), 0.02),
        weight=np.ones(len(x)),
        band=np.arange(len(x)),
        half_m=np.zeros(len(x)),
    )
    return points, side


@settings(max_examples=40, deadline=None)
@given(mean=lanes)
def test_points_of_a_boundary_lie_half_a_width_from_the_lane_centre(mean):
    points, side = boundary_points(mean)
    _, distance, _ = lane_coordinates(points.x_m, points.y_m, mean)
    assert distance == pytest.approx(side * mean[WIDTH] / 2, abs=2e-3)


@settings(max_examples=40, deadline=None)
@given(mean=lanes, pitch=st.floats(-0.02, 0.02))
def test_the_derivatives_of_the_residuals_agree_with_finite_differences(mean, pitch):
    points, side = boundary_points(mean)
    at = mean + np.array([0.02, 0.01, 0.001, 0.0005, 0.05, pitch])
    _, jacobian = _residuals(points, side, at, CAMERA)
    for number, step in enumerate([1e-5, 1e-5, 1e-6, 1e-7, 1e-5, 1e-6]):
        change = np.zeros(6)
        change[number] = step
        above, _ = _residuals(points, side, at + change, CAMERA)
        below, _ = _residuals(points, side, at - change, CAMERA)
        scale = np.abs(jacobian[number]).max() + 1e-9
        # The pitch moves a point along its ray: to first order only.
        assert np.abs((above - below) / (2 * step) - jacobian[number]).max() < 0.15 * scale


@settings(max_examples=25, deadline=None)
@given(mean=lanes)
def test_the_fit_recovers_the_lane_from_a_rough_start(mean):
    """To a decimetre and 2.9 degrees at R = 14 m, because of the model error of far points and the prior."""
    points, side = boundary_points(mean)
    start = mean + np.array([0.1, 0.02, 0.004, 0.0, 0.1, 0.0])
    fitted = fit_lane(points, side, SETTINGS.prior.lane, start, CAMERA, SETTINGS.fit)
    assert fitted.state.mean[E] == pytest.approx(mean[E], abs=0.10)
    assert fitted.state.mean[PSI] == pytest.approx(mean[PSI], abs=0.05)
    assert fitted.state.mean[WIDTH] == pytest.approx(mean[WIDTH], abs=0.06)


def test_without_model_error_the_fit_is_exact_to_two_centimetres():
    mean = np.array([0.4, 0.1, 0.06, 0.0, 3.4, 0.0])
    points, side = boundary_points(mean)
    trusting = SETTINGS.fit.model_copy(update={"bend_doubt": 0.0})
    fitted = fit_lane(points, side, SETTINGS.prior.lane, mean, CAMERA, trusting)
    assert fitted.state.mean[:3] == pytest.approx(mean[:3], abs=0.02)


def test_a_third_of_outliers_moves_the_fit_by_centimetres_only():
    mean = np.array([0.2, 0.03, 0.02, 0.0, 3.5, 0.0])
    points, side = boundary_points(mean)
    y = points.y_m.copy()
    y[::3] += np.random.default_rng(3).uniform(-1.0, 1.0, len(y[::3]))
    fitted = fit_lane(points._replace(y_m=y), side, SETTINGS.prior.lane, mean, CAMERA, SETTINGS.fit)
    assert fitted.state.mean[E] == pytest.approx(0.2, abs=0.05)
    assert fitted.state.mean[PSI] == pytest.approx(0.03, abs=0.02)


def test_a_pitching_camera_is_distinguished_from_a_widening_lane():
    mean = np.array([0.0, 0.0, 0.0, 0.0, 3.5, 0.0])
    points, side = boundary_points(mean)
    grown = (
        1 + 0.01 * (points.x_m - CAMERA.x_m) / CAMERA.height_m
    )  # points 0.01 rad further down than its pitch
    seen = points._replace(x_m=CAMERA.x_m + (points.x_m - CAMERA.x_m) * grown, y_m=points.y_m * grown)
    fitted = fit_lane(seen, side, SETTINGS.prior.lane, mean, CAMERA, SETTINGS.fit)
    assert fitted.state.mean[PITCH] == pytest.approx(0.01, abs=0.002)
    assert fitted.state.mean[WIDTH] == pytest.approx(3.5, abs=0.05)


@settings(max_examples=40, deadline=None)
@given(heading=st.floats(-0.3, 0.3), bend=st.floats(-0.07, 0.07), place=st.floats(-3, 3), x=st.floats(2, 10))
def test_a_parallel_curve_keeps_its_distance(heading, bend, place, x):
    y = parallel_curve(np.array([x]), np.array(heading), np.array(bend), np.array(place))
    if abs(math.sin(-heading) + bend / (1 - bend * place) * (x + place * math.sin(-heading))) > 0.9:
        return  # the curve has turned away before it reaches x
    _, distance, _ = lane_coordinates(np.array([x]), y, np.array([0.0, heading, bend, 0.0, 3.5, 0.0]))
    assert distance[0] == pytest.approx(place, abs=1e-8)
