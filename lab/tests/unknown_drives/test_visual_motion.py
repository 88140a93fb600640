from itertools import islice

import numpy as np
import pytest

from lab.bench.perception.unknown_camera import unknown_drive
from sim_harness.footage.visual_motion import speed_mps

pytestmark = pytest.mark.long


@pytest.mark.parametrize("number", [0, 4, 9])
def test_the_speed_of_a_rendered_drive_is_measured(number):
    drive = unknown_drive(5, number)
    moments = list(islice(drive.moments(), 60))
    true_mps = drive.course.speed_along_mps(1.5)
    found = speed_mps([one.image for one in moments], np.array([one.t_s for one in moments]), drive.camera)
    assert found == pytest.approx(true_mps, rel=0.08)


def test_the_speed_has_the_scale_of_the_height():
    drive = unknown_drive(5, 0)
    moments = list(islice(drive.moments(), 6))
    images, t_s = [one.image for one in moments], np.array([one.t_s for one in moments])
    low = drive.camera.model_copy(update={"height_m": drive.camera.height_m / 10})
    assert speed_mps(images, t_s, low) == pytest.approx(speed_mps(images, t_s, drive.camera) / 10, rel=1e-6)


def test_images_without_ground_have_no_speed():
    drive = unknown_drive(5, 0)
    grey = [np.full((360, 480, 3), 90, np.uint8)] * 10
    assert speed_mps(grey, np.arange(10) / 20, drive.camera) is None
