"""The direction of texture and the vanishing point computed from it."""

import numpy as np
import pytest
from technique_rig import CAMERA, VIEW, below_horizon, ribbon, straight_boundaries

from perception.techniques.boundaries.orientation import dominant_edges, gabor
from perception.techniques.boundaries.outliers import near_prediction
from perception.techniques.image.picture import Evidence, FeatureKind, Features

PLAIN = np.full((240, 320), 100, np.uint8)
OFFSET_M, HEADING_RAD, WIDTH_M = 0.3, 0.06, 4.6


def grating(along_deg, wavelength_px=12.0):
    """Stripes along ``along_deg``, from the columns to the rows."""
    rows, columns = np.mgrid[:240, :320]
    across = columns * np.sin(np.deg2rad(along_deg)) - rows * np.cos(np.deg2rad(along_deg))
    return (120 + 60 * np.sin(2 * np.pi * across / wavelength_px)).astype(np.uint8)


def between_deg(one, other):
    return np.abs((one - other + 90) % 180 - 90)


def edges(image, **how):
    lower, view = below_horizon(image)
    return dominant_edges(Evidence(gabor(lower, view), view), **how)


def unmarked_road(sign=1.0):
    """A road in soil, which is brighter than it."""
    lane = (sign * OFFSET_M, sign * HEADING_RAD, 0.0, 0.0)
    image = np.full((240, 320, 3), 170, np.uint8)
    ribbon(image, CAMERA, lane, 0.0, WIDTH_M, (90, 90, 90))
    return image


@pytest.mark.parametrize("along_deg", [-60, -37, -10, 0, 22.5, 45, 71, 90])
def test_four_filters_measure_the_direction_of_stripes(along_deg):
    """Within 4 degrees, also between the directions of the filters."""
    seen = gabor(grating(along_deg), VIEW)
    sure = seen.response[150:220, 40:280]
    assert (sure > 0.4).all()
    found = np.rad2deg(seen.direction_rad[150:220, 40:280])
    assert np.max(between_deg(found, along_deg)) < 4.0


def test_an_even_picture_and_sensor_noise_have_no_direction():
    noise = (PLAIN + np.random.default_rng(3).normal(0, 2, PLAIN.shape)).astype(np.uint8)
    assert not gabor(PLAIN, VIEW).response.any()
    assert (gabor(noise, VIEW).response > 0).mean() < 0.1
    assert edges(np.dstack([PLAIN] * 3)).side_count == 0


def test_the_vanishing_point_of_an_unmarked_road_gives_its_heading_and_its_edges():
    found = edges(unmarked_road())
    assert found.side_count == 2 and found.reason == ""
    for side, sign in ((found.left, 1), (found.right, -1)):
        at_m, slope = side.at(8.0), side.polynomial(1)[1]
        assert slope == pytest.approx(-HEADING_RAD, abs=np.deg2rad(1.5))
        assert at_m == pytest.approx(sign * WIDTH_M / 2 - OFFSET_M - HEADING_RAD * 8.0, abs=0.35)
        assert side.residual_m < 0.3 and 0 < side.support <= 1


def test_the_mirrored_road_has_the_mirrored_edges():
    one, other = edges(unmarked_road()), edges(unmarked_road(-1.0))
    assert one.left.at(8.0) == pytest.approx(-other.right.at(8.0), abs=0.25)
    assert one.right.at(8.0) == pytest.approx(-other.left.at(8.0), abs=0.25)


def test_without_directions_there_is_a_reason_and_no_edge():
    found = dominant_edges(Evidence(Features(np.ones((240, 320), np.float32), FeatureKind.LINE), VIEW))
    assert found.side_count == 0 and "gabor" in found.reason


def test_a_line_without_texture_along_it_is_no_edge():
    """A grating across the road points nowhere near it."""
    lower, view = below_horizon(np.dstack([grating(0.0)] * 3))
    assert dominant_edges(Evidence(gabor(lower, view), view)).side_count == 0


def test_outlier_stages_keep_the_directions():
    seen = gabor(grating(0.0), VIEW)
    left = near_prediction(Evidence(seen, VIEW, straight_boundaries()))
    assert np.count_nonzero(left.response) < np.count_nonzero(seen.response)
    assert left.direction_rad is seen.direction_rad
