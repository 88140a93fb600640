"""A box detector in a file is run once before it counts, and its outputs are read in one way or refused."""

import math
from pathlib import Path

import numpy as np
import pytest
from onnx import TensorProto
from table_network_rig import (
    CAR_CORNERS,
    SCORE,
    SHAPE,
    SIDE_PX,
    end_to_end,
    plain,
    with_objectness,
    write_table,
)

from perception.lead.boxes import BoxDetector, BoxSettings
from perception.lead.detection import NotFinite
from perception.lead.finder import LeadFinder, LeadSettings
from perception.lead.tables import Misfit, reading_of, ssd_anchors, ssd_boxes
from trepid.car.camera import Camera
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, InputError, load
from trepid.messages import Frame

CAMERA = load(CONFIG_DIR / "camera.yaml", Camera)
SETTINGS = load(CONFIG_DIR / "lead.yaml", LeadSettings)
YOLO = BoxSettings(layout="yolo", classes={"vehicle": (2,)}, min_score=0.3, tile_share=1.0)
IMAGE = np.full((CAMERA.height_px, CAMERA.width_px, 3), 90, np.uint8)
SCALE = np.array([CAMERA.width_px, CAMERA.height_px] * 2) / SIDE_PX
NAMES_7 = [f"class {k}" for k in range(7)]

READ = {
    "of YOLOv8": dict(table=plain(189)),
    "of YOLOv8, turned": dict(table=plain(189).T),
    "with fewer boxes than columns": dict(table=plain(20)),
    "with fewer boxes than columns, turned": dict(table=plain(20).T),
    "without a batch": dict(table=plain(189), flat=True),
    "of YOLOv5": dict(table=with_objectness(567)),
    "with objectness and few boxes": dict(table=with_objectness(20)),
    "with objectness, turned": dict(table=with_objectness(189).T),
    "end to end": dict(table=end_to_end(300)),
    "of seven named classes": dict(table=plain(189, 7), names=NAMES_7),
    "of seven named classes with objectness": dict(table=with_objectness(567, 7), names=NAMES_7),
    "of seven named classes, end to end": dict(table=end_to_end(300), names=NAMES_7),
    "of three classes by the settings": dict(table=plain(189, 3), class_count=3),
    "of half precision": dict(table=plain(189), kind=TensorProto.FLOAT16),
    "of whole numbers": dict(table=plain(189), kind=TensorProto.UINT8),
    "with the colours last": dict(table=plain(189), shape=(1, SIDE_PX, SIDE_PX, 3)),
    "of any batch": dict(table=plain(189), shape=("batch", 3, SIDE_PX, SIDE_PX)),
    "in shares of the picture": dict(table=plain(189), shares=True),
    "end to end in shares of the picture": dict(table=end_to_end(300), shares=True),
}


def write_network(path: Path, form) -> Path:
    form = dict(form)
    table = form.pop("table").copy()
    if form.pop("shares", False):
        turned = table.shape[0] == 84
        (table if turned else table.T)[:4] /= SIDE_PX
    return write_table(path, table if form.pop("flat", False) else table[None], **form)


@pytest.mark.parametrize("name", READ)
def test_the_car_in_a_table_is_found_where_it_is(tmp_path, name):
    form = dict(READ[name])
    settings = YOLO.model_copy(update={"class_count": form.pop("class_count", None)})
    found = BoxDetector(write_network(tmp_path / "d.onnx", form), settings, CAMERA).boxes(IMAGE)
    assert len(found) == 1
    assert found[0].corners == pytest.approx(np.array(CAR_CORNERS) * SCALE, rel=1e-3)
    assert found[0].confidence == pytest.approx(SCORE, abs=1e-3)


def test_a_car_is_found_by_its_own_class_alone(tmp_path):
    for table in (plain(189), with_objectness(567), end_to_end(300)):
        path = write_table(tmp_path / "d.onnx", table[None])
        other = YOLO.model_copy(update={"classes": {"vehicle": (5, 7), "person": (0,)}})
        assert BoxDetector(path, other, CAMERA).boxes(IMAGE) == []


def score_table(value: float, row: int = 4):
    table = plain(189)
    table[row, 5] = value
    return table


REFUSED = {
    "four pictures": (
        dict(shape=(4, 3, 96, 96)),
        "takes (4, 3, 96, 96), 4 pictures at a time: export it with a batch",
    ),
    "grey pictures": (
        dict(shape=(1, 1, 96, 96)),
        "takes (1, 1, 96, 96), expected one picture, (1, 3, height, width)",
    ),
    "any size": (
        dict(shape=(1, 3, "h", "w")),
        "takes (1, 3, h, w): export it with a fixed size",
    ),
    "a picture larger than memory": (
        dict(shape=(1, 3, 64_000, 64_000)),
        "takes (1, 3, 64000, 64000): export it with a fixed size of at most 8192 px",
    ),
    "four bytes": (
        dict(kind=TensorProto.INT32),
        "kind tensor(int32), expected tensor(float), tensor(float16)",
    ),
    "two inputs": (dict(inputs=2), "takes images, images1, expected one picture alone"),
    "unknown classes": (dict(table=plain(189, 7)), "(1, 11, 189) says not how many classes it has"),
    "other classes": (
        dict(table=plain(189, 9), names=NAMES_7),
        "(1, 13, 189) does not fit 7 classes: expected 11 columns, 12 with objectness",
    ),
    "two classes or a finished table": (dict(table=plain(189, 2).T), "(1, 189, 6) says not how many classes"),
    "a class that is not there": (
        dict(table=plain(189, 2), names=["car", "van"]),
        "it has 2 classes, and boxes: classes in lead.yaml names number 2",
    ),
    "two pictures in the table": (dict(table=np.zeros((2, 84, 189))), "(2, 84, 189), expected one table"),
    "logits": (
        dict(table=score_table(-7.5, 4 + 2)),
        "its scores for a grey picture are -7.5 to 0.75, expected 0 to 1",
    ),
    "no numbers": (dict(table=score_table(math.nan)), "its outputs for a grey picture are not finite"),
    "no finite boxes": (
        dict(table=score_table(math.inf, 2)),
        "its outputs for a grey picture are not finite",
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_network_of_another_contract_is_refused_with_what_was_found_and_what_fits(tmp_path, fault):
    form, text = REFUSED[fault]
    form = dict(form)
    table = form.pop("table", plain(189))
    path = write_table(tmp_path / "d.onnx", table if table.ndim == 3 else table[None], **form)
    with pytest.raises(InputError) as refused:
        BoxDetector(path, YOLO, CAMERA)
    assert str(refused.value).startswith(f"{path}: ") and "\n" not in str(refused.value)
    assert text in str(refused.value)


def test_boxes_scores_and_classes_apart_are_no_table(tmp_path):
    path = write_table(tmp_path / "d.onnx", np.zeros((1, 100, 4)), np.zeros((1, 100)), np.zeros((1, 100)))
    with pytest.raises(InputError, match=r"\(1, 100, 4\) and \(1, 100\) and \(1, 100\), expected one table"):
        BoxDetector(path, YOLO, CAMERA)


def test_a_finished_ssd_is_refused_with_the_raw_outputs_that_fit(tmp_path):
    path = write_table(
        tmp_path / "d.onnx", np.zeros((1, 10, 4)), np.zeros((1, 10)), np.zeros((1, 10)), np.zeros(1)
    )
    anchors = len(ssd_anchors(SIDE_PX))
    with pytest.raises(
        InputError, match=rf"raw boxes \(1, {anchors}, 4\) and logits \(1, {anchors}, classes\)"
    ):
        BoxDetector(path, SETTINGS.boxes, CAMERA)


def test_how_a_file_is_read_is_one_line_with_the_names_of_its_classes(tmp_path):
    path = write_table(tmp_path / "d.onnx", with_objectness(567, 7)[None], names=NAMES_7)
    settings = YOLO.model_copy(update={"classes": {"vehicle": (2, 3), "person": (0,)}})
    assert BoxDetector(path, settings, CAMERA).text == (
        "d.onnx: YOLO with objectness, 7 classes, boxes in pixels, picture 96 x 96 float32; "
        "vehicle = class 2, class 3; person = class 0"
    )


def test_a_picture_reaches_the_network_in_its_range_and_order_of_colours(tmp_path):
    blue = np.zeros((SIDE_PX, SIDE_PX, 3), np.uint8)
    blue[..., 0] = 255
    for kind, high in ((TensorProto.FLOAT, 1.0), (TensorProto.FLOAT16, 1.0), (TensorProto.UINT8, 255)):
        path = write_table(tmp_path / "d.onnx", plain(189)[None], kind=kind)
        pixels = BoxDetector(path, YOLO, CAMERA)._pixels(blue)
        assert pixels.shape == SHAPE and pixels.flags.c_contiguous
        assert pixels[0].max(axis=(1, 2)).tolist() == [0, 0, high]


def test_an_output_that_is_not_finite_is_no_empty_road(tmp_path):
    """A table of NaN has no box above any score; the lead finder then knows nothing."""
    detector = BoxDetector(write_table(tmp_path / "d.onnx", plain(189)[None]), YOLO, CAMERA)
    broken = detector._network._replace(run=lambda pixels: [np.full((1, 84, 189), np.nan, np.float32)])
    detector._network = broken
    with pytest.raises(NotFinite):
        detector(IMAGE)
    vehicle = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
    finder = LeadFinder(detector, SETTINGS, CAMERA, vehicle)
    lead = finder.step(Frame(t_s=1.0, image=IMAGE), None, [], now_s=1.0)
    assert math.isnan(lead.confidence) and finder.road_users is None


@pytest.mark.parametrize("name", ["none.onnx", "none.txt"])
def test_a_detector_that_is_none_is_refused(tmp_path, name):
    if name.endswith("txt"):
        (tmp_path / name).write_text("no network")
    with pytest.raises(InputError, match=name):
        BoxDetector(tmp_path / name, YOLO, CAMERA)


def test_an_ssd_box_without_offsets_is_its_anchor():
    anchors = ssd_anchors(300)
    logits = np.full((1, len(anchors), 3), -9.0, np.float32)
    logits[0, 7, 2] = 2.0
    outputs = [np.zeros((1, len(anchors), 4), np.float32), logits]
    read = reading_of(outputs, layout="ssd", classes=[2], class_count=None, size=(300, 300))
    for corners, scores in (ssd_boxes(outputs, [2], (300, 300)), read.boxes(outputs)):
        y, x, height, width = anchors[7]
        assert corners[7] == pytest.approx(
            (x - width / 2, y - height / 2, x + width / 2, y + height / 2), abs=1e-6
        )
        assert int(scores.argmax()) == 7
        assert scores[7] == pytest.approx(1 / (1 + math.exp(-2.0)))


def test_a_raw_table_of_one_class_is_told_from_a_finished_one_by_the_grids_of_the_picture():
    """Objectness and one class are six columns too; a raw table has a box, or three, a cell of 8, 16 and 32 px."""
    cells = sum((SIDE_PX // stride) ** 2 for stride in (8, 16, 32))
    for boxes, kind in ((3 * cells, "with objectness"), (cells, "with objectness"), (300, "end to end")):
        outputs = [np.zeros((1, boxes, 6), np.float32)]
        read = reading_of(outputs, layout="yolo", classes=[0], class_count=1, size=(SIDE_PX, SIDE_PX))
        assert kind in read.text
    with pytest.raises(Misfit, match="says not how many classes"):
        reading_of(
            [np.zeros((1, cells, 6), np.float32)],
            layout="yolo",
            classes=[0],
            class_count=None,
            size=(SIDE_PX, SIDE_PX),
        )
