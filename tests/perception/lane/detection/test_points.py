import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.detection.grid import lateral_grid
from perception.lane.detection.points import MarkingFilter
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
GRID = lateral_grid(CAMERA, reach_m=45.0, band_m=0.1, max_band_px=3)
FILTER = MarkingFilter(lane_cv_settings().markings, GRID)


def stripes(*left_m: float, grey: int = 200) -> np.ndarray:
    """A grey road with lines of 12 cm along it at these places."""
    image = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)
    columns = np.arange(CAMERA.width_px)
    for top, bottom, metre_px in zip(GRID.top_px, GRID.bottom_px, GRID.metre_px, strict=True):
        place_m = (CAMERA.cx_px - columns) / metre_px
        for left in left_m:
            image[top:bottom, np.abs(place_m - left) < 0.06] = grey
    return image


def near(image: np.ndarray) -> np.ndarray:
    """Places of the points within 8 m, where a line is wider than two pixels."""
    points = FILTER.points(image)
    return points.y_m[points.x_m < 8.0]


@pytest.mark.parametrize("left_m", [1.0, -0.7])
def test_a_line_has_one_point_in_its_middle_in_every_band(left_m):
    places = near(stripes(left_m))
    assert len(places) > 20 and places == pytest.approx(left_m, abs=0.03)


def test_the_two_stripes_of_a_double_line_are_one_boundary_between_them():
    assert near(stripes(1.12, 0.88)) == pytest.approx(1.0, abs=0.04)


def test_two_lines_farther_apart_stay_two():
    places = near(stripes(1.0, 0.5))
    assert np.sort(np.unique(places.round(1))).tolist() == [0.5, 1.0]


def test_an_even_image_has_no_line_at_its_borders():
    assert len(FILTER.points(stripes()).x_m) == 0
