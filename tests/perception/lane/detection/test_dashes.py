import cv2
import numpy as np
import pytest
from drawn_road_rig import CAMERA, WHITE, ribbon, road

from perception.lane.detection.dashes import dash_period

STRAIGHT = (0.1, 0.0, 0.0, 0.0)
SCALE_PXM = CAMERA.fy_px * CAMERA.height_m


def line(place_m: float, camera=CAMERA, lane=STRAIGHT) -> tuple[tuple[float, float], ...]:
    """The middle of the line ``place_m`` left of the lane centre, one point every ten rows from the bottom up."""
    x_m = camera.x_m + np.geomspace(0.5, 60.0, 2000)
    y_m = -lane[0] - lane[1] * x_m + lane[2] * x_m**2 / 2 + place_m
    pixels = camera.pixel_from_road(np.column_stack([x_m, y_m]))
    rows = np.arange(camera.height_px - 1, pixels[-1, 1], -10.0)
    return tuple((float(np.interp(row, pixels[::-1, 1], pixels[::-1, 0])), float(row)) for row in rows)


def dashed_line(period_m: float, dash_m: float, *, shift_m: float = 0.0, camera=CAMERA):
    image = road(STRAIGHT, left=None, camera=camera)
    fine = 0.1
    for start in np.arange(-period_m + shift_m, 60.0, period_m):
        x_m = np.arange(start, start + dash_m + fine / 2, fine)
        x_m = x_m[x_m > camera.x_m + 0.5]
        if len(x_m) > 1:
            edges = [
                np.column_stack([x_m, np.full(len(x_m), -STRAIGHT[0] + 1.7 + side)]) for side in (0.06, -0.06)
            ]
            corners = camera.pixel_from_road(np.vstack([edges[0], edges[1][::-1]]))
            cv2.fillPoly(image, [np.round(corners * 16).astype(np.int32)], WHITE, cv2.LINE_AA, 4)
    return image


@pytest.mark.parametrize(("period_m", "dash_m"), [(12.2, 3.05), (9.0, 3.0), (6.0, 2.0), (9.0, 5.0)])
def test_the_period_on_the_road_is_measured_in_the_frames_that_show_it(period_m, dash_m):
    camera = CAMERA.resize(960, 720)
    images = [dashed_line(period_m, dash_m, shift_m=period_m * n / 12, camera=camera) for n in range(12)]
    found = [dash_period(image, line(1.7, camera), camera.horizon_row_px) for image in images]
    periods = np.array([one for one in found if one is not None])
    assert len(periods) >= 4
    assert np.median(periods) * camera.fy_px * camera.height_m == pytest.approx(period_m, rel=0.06)


def test_the_mirrored_line_has_the_same_period():
    image = dashed_line(6.0, 2.0)
    path = line(1.7)
    mirrored = tuple((CAMERA.width_px - 1 - x, y) for x, y in path)
    one = dash_period(image, path, CAMERA.horizon_row_px)
    other = dash_period(np.ascontiguousarray(image[:, ::-1]), mirrored, CAMERA.horizon_row_px)
    assert one == pytest.approx(other, rel=0.02)


def test_a_darker_image_has_the_same_period():
    image = dashed_line(6.0, 2.0)
    one, other = (dash_period(picture, line(1.7), CAMERA.horizon_row_px) for picture in (image, image // 2))
    assert one == pytest.approx(other, rel=0.03)


def test_reflectors_between_the_dashes_do_not_count():
    camera = CAMERA.resize(960, 720)
    image = dashed_line(12.0, 3.0, shift_m=3.0, camera=camera)
    for stud_m in (9.0, 10.5, 12.0):
        ribbon(image, camera, STRAIGHT, 1.7, 0.12, WHITE, lambda station_m, at_m=stud_m: station_m == at_m)
    found = dash_period(image, line(1.7, camera), camera.horizon_row_px)
    assert found * camera.fy_px * camera.height_m == pytest.approx(12.0, rel=0.06)


@pytest.mark.parametrize(
    "image",
    [road(STRAIGHT), road(STRAIGHT, left=None), np.zeros((CAMERA.height_px, CAMERA.width_px, 3), np.uint8)],
    ids=["solid", "none", "dark"],
)
def test_no_dashes_have_no_period(image):
    assert dash_period(image, line(1.7), CAMERA.horizon_row_px) is None


def test_a_path_outside_the_image_or_above_the_horizon_has_no_period():
    image = dashed_line(6.0, 2.0)
    assert dash_period(image, (), CAMERA.horizon_row_px) is None
    assert dash_period(image, ((-500.0, 230.0), (-400.0, 180.0)), CAMERA.horizon_row_px) is None
    assert dash_period(image, ((160.0, 60.0), (160.0, 20.0)), CAMERA.horizon_row_px) is None


def test_a_line_that_leaves_the_image_at_its_side_ends_no_dash_there():
    camera = CAMERA.resize(960, 720)
    periods = []
    for n in range(12):
        image = dashed_line(9.0, 3.0, shift_m=0.75 * n, camera=camera)[:, 200:]
        path = tuple((x - 200.0, y) for x, y in line(1.7, camera))
        periods.append(dash_period(np.ascontiguousarray(image), path, camera.horizon_row_px))
    known = [one * camera.fy_px * camera.height_m for one in periods if one is not None]
    assert known and all(one == pytest.approx(9.0, rel=0.1) for one in known)
