"""The camera of a route whose camera file is not known."""

import numpy as np

from learning.dataset.dataset import Dataset, Rows
from perception.camera.self_calibration import CALIBRATION_FRAMES, calibrate_by_images
from perception.estimators import lane_cv_settings
from trepid.car.camera import Camera


def route_camera(dataset: Dataset, rows: Rows) -> Camera:
    """The camera of the ``rows`` of one route, calibrated by frames that are spread evenly over them."""
    some = rows[np.linspace(0, len(rows) - 1, CALIBRATION_FRAMES).astype(int)]
    return calibrate_by_images([*dataset.images(some)], lane_cv_settings().self_calibration)
