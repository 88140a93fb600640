"""The vehicles in images, as ``trepid estimate --estimator lead`` prints and draws them."""

from pathlib import Path

import numpy as np
import pytest
from fixed_detector import FixedDetector

from cockpit.footage.frames import FrameResult
from cockpit.footage.leads import Leads, as_row, draw_leads, leads_in
from perception.lead.detection import Detection
from perception.lead.finder import LeadFinder, lead_settings
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load, use_car
from trepid.messages import Frame
from trepid.scale import scaled_settings
from trepid.types import Image

IN_REFERENCE = Detection(15.0, 0.3, 1.8, 0.95)


@pytest.fixture(params=["", "rc-car"])
def car(request, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv("TREPID_CAR", raising=False)
    use_car(CONFIG_DIR / "cars" / request.param if request.param else None)
    yield load(CONFIG_DIR / "camera.yaml", Camera), load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    use_car(None)


def eighth_result(camera: Camera, vehicle: Vehicle) -> FrameResult[Leads]:
    """The result of the eighth frame with the same detection."""
    finder = LeadFinder(FixedDetector([IN_REFERENCE]), lead_settings(), camera, vehicle)
    image = np.full((camera.height_px, camera.width_px, 3), 90, np.uint8)
    for number in range(8):
        leads = leads_in(finder, vehicle.scale, Frame(t_s=0.04 * number, image=image))
    return FrameResult(Path("a.png"), 0, 0.0, image, camera, leads, 0.0)


def test_leader_and_detections_are_in_the_same_metres(car) -> None:
    camera, vehicle = car
    row = as_row(eighth_result(camera, vehicle))
    (detection,) = row["detections"]
    nose_m = vehicle.wheelbase_m + vehicle.front_overhang_m
    assert detection["ahead_m"] - nose_m == pytest.approx(row["distance_m"], abs=0.01)
    assert detection["left_m"] == pytest.approx(row["lateral_m"], abs=0.01)
    assert detection["width_m"] == pytest.approx(1.8 * vehicle.scale, abs=0.01)


def test_the_box_is_where_the_vehicle_is_in_the_image(car) -> None:
    camera, vehicle = car
    (detection,) = as_row(eighth_result(camera, vehicle))["detections"]
    in_reference = scaled_settings(camera, 1 / vehicle.scale)
    assert detection["box_px"] == pytest.approx(IN_REFERENCE.pixels(in_reference), abs=0.06)


def test_the_leader_is_drawn_in_green(car) -> None:
    assert is_green(draw_leads(eighth_result(*car))).sum() > 20


def test_a_vehicle_beside_the_leader_is_not_drawn_as_it(car) -> None:
    camera, vehicle = car
    one = eighth_result(camera, vehicle)
    beside = one.result.detections[0]._replace(left_m=2.0 * vehicle.scale)
    alone = FrameResult(one.path, 0, 0.0, one.image, camera, Leads(one.result.lead, [beside]), 0.0)
    assert not is_green(draw_leads(alone)).any()


def is_green(picture: Image) -> np.ndarray:
    """Pixels in the colour of a leader, also where it is blended with its dark edge."""
    blue, green, red = np.moveaxis(picture.astype(int), 2, 0)
    return (green - red > 40) & (green - blue > 20)
