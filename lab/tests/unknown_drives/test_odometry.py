"""Unknown cameras on rendered winding drives."""

from functools import cache
from itertools import islice

import numpy as np
import pytest

from lab.bench.perception.unknown_camera import OdometryFrame, unknown_drive
from perception.camera.odometry import MAX_PAIRS, DriveOptics, StateOdometry

SEED, NUMBER = 7, 2  # double yellow line


@cache
def drive():
    one = unknown_drive(SEED, NUMBER)
    return one.camera, tuple(islice(one.moments(), 130))


def assumed_camera(**changes):
    camera = drive()[0]
    wrong = {
        "fx_px": 1.12 * camera.fx_px,
        "fy_px": 1.12 * camera.fy_px,
        "height_m": 0.85 * camera.height_m,
        "yaw_rad": 0.0,
    }
    return camera.model_copy(update=wrong | changes)


def measure(optics: DriveOptics, moments, **changes):
    found = None
    for moment in moments:
        one: OdometryFrame = moment._replace(**changes)
        found = optics.step(one.image, one.t_s, one.speed_mps, one.yaw_rate_radps) or found
    return found


def test_a_winding_drive_measures_lens_height_horizon_and_direction():
    camera, moments = drive()
    first = assumed_camera()
    found = measure(DriveOptics(first), moments)
    assert found.focal_px == pytest.approx(camera.fx_px, rel=0.05)
    assert found.focal_height_pxm == pytest.approx(camera.fx_px * camera.height_m, rel=0.04)
    assert first.horizon_row_px - found.horizon_px == pytest.approx(
        camera.horizon_row_px, abs=0.005 * camera.fx_px
    )
    straight_px = camera.cx_px + camera.fx_px * np.tan(camera.yaw_rad)
    assert first.cx_px - found.aside_px == pytest.approx(straight_px, abs=0.006 * camera.fx_px)


def test_a_wide_image_gives_pixels_of_its_own_size():
    camera, moments = drive()
    large = camera.resize(2 * camera.width_px, 2 * camera.height_px)
    enlarged = [one._replace(image=np.kron(one.image, np.ones((2, 2, 1), np.uint8))) for one in moments[:40]]
    found = measure(DriveOptics(large), enlarged)
    assert found.focal_height_pxm == pytest.approx(2 * camera.fx_px * camera.height_m, rel=0.06)


def test_the_speed_alone_measures_no_focal_length():
    found = measure(DriveOptics(assumed_camera(), StateOdometry.WAY), drive()[1][:60])
    assert found.focal_px is None and found.focal_height_pxm > 0


def test_without_odometry_or_speed_nothing_is_measured():
    moments = drive()[1][:40]
    assert measure(DriveOptics(assumed_camera(), StateOdometry.NONE), moments) is None
    assert measure(DriveOptics(assumed_camera()), moments, speed_mps=None) is None
    assert measure(DriveOptics(assumed_camera()), moments, speed_mps=0.0) is None


def test_frames_of_another_size_and_after_a_pause_are_no_pairs():
    moments = drive()[1][:40]
    assert measure(DriveOptics(assumed_camera().resize(320, 240)), moments) is None
    late = [one._replace(t_s=0.6 * number) for number, one in enumerate(moments)]
    assert measure(DriveOptics(assumed_camera()), late) is None


def test_a_slow_car_measures_over_several_frames():
    """At a tenth of the speed each pair spans as many frames as 0.15 m need."""
    moments = drive()[1]
    slow = [
        one._replace(t_s=0.2 * number, speed_mps=one.speed_mps / 4, yaw_rate_radps=one.yaw_rate_radps / 4)
        for number, one in enumerate(moments[:60])
    ]
    fast = measure(DriveOptics(assumed_camera()), moments[:60])
    assert measure(DriveOptics(assumed_camera()), slow).focal_height_pxm == pytest.approx(
        fast.focal_height_pxm, rel=0.01
    )


def test_the_number_of_pairs_is_bounded():
    optics, moments = DriveOptics(assumed_camera()), drive()[1]
    forth_and_on = [one for _ in range(3) for one in moments]
    steady = [one._replace(t_s=0.05 * number) for number, one in enumerate(forth_and_on)]
    measure(optics, steady)
    assert optics.complete and optics.pairs == MAX_PAIRS
    straight = DriveOptics(assumed_camera(), StateOdometry.WAY)
    measure(straight, steady)
    assert straight.pairs == MAX_PAIRS // 2
