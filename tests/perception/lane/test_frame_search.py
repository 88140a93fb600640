import numpy as np
import pytest

from perception.estimators import lane_cv_settings
from perception.lane.frame_search import FrameSearch
from perception.lane.model.evidence import LaneFit
from perception.lane.model.geometry import PSI, WIDTH, E, LaneState
from perception.lane.view import make_view
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, load

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
SETTINGS = lane_cv_settings()
VIEW = make_view(SETTINGS, CAMERA)
GRID = VIEW.grid
STRIPE_M, WORN_EVERY = 0.12, 4  # from the middle of a double line; bands in a row


def picture(lines_m) -> np.ndarray:
    """Asphalt with lines at the places ``lines_m(band, ahead_m)``, metres to the left."""
    image = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)
    columns = np.arange(CAMERA.width_px)
    for band, (top, bottom, metre_px) in enumerate(
        zip(GRID.top_px, GRID.bottom_px, GRID.metre_px, strict=True)
    ):
        for line_m in lines_m(band, GRID.ahead_m[band]):
            image[top:bottom, np.abs((CAMERA.cx_px - columns) / metre_px - line_m) < 0.06] = 200
    return image


def search(image: np.ndarray) -> FrameSearch:
    return FrameSearch(image, VIEW, SETTINGS)


def lane_beside_a_double_line(*, worn: bool) -> LaneFit:
    """The lane found between a line 1.7 m to the right and a double one 1.7 m to the left.

    Where it is worn, both stripes are there in every third piece of it, and one or the other in between.
    """

    def lines_m(band, ahead_m):
        left = [1.7 + STRIPE_M, 1.7 - STRIPE_M]
        if worn and (piece := band // WORN_EVERY % 3) < 2:
            left.pop(piece)
        return (-1.7, *left)

    return search(picture(lines_m)).lines_anywhere()


@pytest.mark.parametrize("worn", [False, True])
def test_a_lane_ends_in_the_middle_of_a_double_line_also_where_one_stripe_is_worn_away(worn):
    lane = lane_beside_a_double_line(worn=worn)
    assert lane.boundaries_seen == 2
    assert lane.state.mean[WIDTH] == pytest.approx(3.4, abs=0.03)
    assert lane.state.mean[E] == pytest.approx(0.0, abs=0.03)


def test_a_double_line_with_worn_stripes_fits_nearly_as_tightly_as_a_whole_one():
    worn, whole = lane_beside_a_double_line(worn=True), lane_beside_a_double_line(worn=False)
    assert worn.residual < whole.residual + 1.0  # standard deviations; 2.6 if taken as they are


def half_a_dash(*, beside_a_line: bool):
    def lines_m(band, ahead_m):
        dash = [-1.5] if 4.0 < ahead_m < 6.2 else []
        return [1.7, *dash] if beside_a_line else dash

    return picture(lines_m)


def test_half_a_dash_counts_as_a_line_next_to_another_line():
    lane = search(half_a_dash(beside_a_line=True)).lines_anywhere()
    assert lane.boundaries_seen == 2
    assert lane.state.mean[WIDTH] == pytest.approx(3.2, abs=0.03)


def test_half_a_dash_alone_counts_as_a_line_only_where_one_is_predicted():
    alone = search(half_a_dash(beside_a_line=False))
    assert alone.lines_at(SETTINGS.prior.lane).right.seen
    assert alone.lines_anywhere().boundaries_seen == 0


def test_two_dashes_and_specks_leave_the_width_and_heading_of_a_remembered_lane():
    def lines_m(band, ahead_m):
        return [*([1.75] if 7.0 < ahead_m < 9.0 else []), *([-1.75] if 3.5 < ahead_m < 6.5 else [])] + (
            [1.62] if 3.0 < ahead_m < 3.4 else []  # a drop on the lens
        )

    dashes, shape = search(picture(lines_m)), SETTINGS.prior.lane
    known = LaneState(
        np.array([0.0, 0.0, 0.0, 0.0, 3.5, 0.0]),
        np.diag(np.square([0.02, 0.004, 0.001, 0.0002, 0.02, 0.008])),
    )
    alone, continued = (dashes.lines_like(shape, prior).state.mean for prior in (None, known))
    assert abs(continued[WIDTH] - 3.5) < 0.08 < abs(alone[WIDTH] - 3.5)
    assert abs(continued[PSI]) < 0.01
