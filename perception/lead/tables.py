"""How the outputs of a box detector are read: decided once, on a grey picture, and never guessed.

Detectors write their boxes in few forms, which look alike:

- raw outputs of TensorFlow's SSD: encodings of anchors, and a logit a class;
- one table of YOLO, (columns, boxes) or (boxes, columns), with x y w h and a score a class (YOLOv8, v9, v11, v12),
  or with the probability of any object before the classes (YOLOv5, v7, YOLOX);
- one table of six columns, left top right bottom score class, after a suppression in the network (YOLOv10, v26, or
  an export with NMS).

The number of classes tells them apart: that of the setting, that of the names in the file, else the 80 of COCO.
What fits no form, or two, is refused with what was found.
"""

import itertools
from collections.abc import Callable, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from trepid.types import Floats

Boxes = tuple[Floats, Floats]
"""Corners (n, 4) as left, top, right, bottom in shares of the picture, and scores (n, classes)."""
Outputs = Sequence[Floats]
COCO_CLASSES = 80
BOX, BOX_AND_OBJECT, END_TO_END = (
    4,
    5,
    6,
)  # columns: a box, with the probability of an object, of a finished table
STRIDES_PX = (8, 16, 32)
SHARES_MOST = 1.5  # coordinates up to here are shares of the picture, no pixels
SCORE_TOLERANCE = 1e-3


class Misfit(Exception):
    """Outputs that no form fits; the text says what was found and what fits."""


class Reading(NamedTuple):
    """A form of the outputs."""

    text: str  # for people
    boxes: Callable[[Outputs], Boxes]


def reading_of(
    outputs: Outputs,
    *,
    layout: str,
    classes: Sequence[int],
    class_count: int | None,
    size: tuple[int, int],
) -> Reading:
    """The form of ``outputs``, those of a grey picture of ``size`` (width, height) [px]. Raises Misfit.

    ``classes``: the classes that are read, in the order of the scores; ``class_count``: how many the network has,
    None where neither a setting nor the file says it.
    """
    reading = _ssd(outputs, classes, size) if layout == "ssd" else _yolo(outputs, classes, class_count, size)
    scores = reading.boxes(outputs)[1]
    if scores.size and not (scores.min() >= -SCORE_TOLERANCE and scores.max() <= 1 + SCORE_TOLERANCE):
        raise Misfit(
            f"its scores for a grey picture are {scores.min():.3g} to {scores.max():.3g}, expected 0 to 1:"
            " export the network with its last sigmoid"
        )
    return reading


def _ssd(outputs: Outputs, classes: Sequence[int], size: tuple[int, int]) -> Reading:
    anchors = len(ssd_anchors(size[0]))
    shapes = [output.shape for output in outputs]
    fits = sorted(shape[-1] == BOX for shape in shapes) == [False, True]
    if not fits or any(shape[:-1] != (1, anchors) for shape in shapes):
        raise Misfit(
            f"its outputs are {_shapes_text(shapes)}; the layout ssd has raw boxes (1, {anchors}, 4) and logits"
            f" (1, {anchors}, classes) for a picture {size[0]} px wide, without post-processing"
        )
    count = next(shape[-1] for shape in shapes if shape[-1] != BOX)
    _has(classes, count)
    return Reading(f"raw SSD, {count} classes", lambda found: ssd_boxes(found, classes, size))


def _yolo(
    outputs: Outputs, classes: Sequence[int], class_count: int | None, size: tuple[int, int]
) -> Reading:
    tables = [output for output in outputs if output.ndim <= 3]
    if len(tables) != 1 or tables[0].ndim < 2 or (tables[0].ndim == 3 and tables[0].shape[0] != 1):
        raise Misfit(
            f"its outputs are {_shapes_text([o.shape for o in outputs])}, expected one table (1, n, columns)"
        )
    place = next(number for number, output in enumerate(outputs) if output is tables[0])
    rows, columns = tables[0].shape[-2:]
    forms = [
        (turned, form, number)
        for turned, number, boxes in ((False, columns, rows), (True, rows, columns))
        for form in _forms(number, boxes, turned, class_count, size)
    ]
    if len(forms) != 1:
        raise Misfit(_no_single_form(tables[0].shape, class_count, two=len(forms) > 1))
    turned, form, number = forms[0]
    count = class_count if form == END_TO_END else number - form
    _has(classes, count)
    in_shares = _in_shares(tables[0], turned, form)
    scale = np.ones(2, np.float32) if in_shares else np.array(size, np.float32)

    def boxes(found: Outputs) -> Boxes:
        table = found[place].reshape(found[place].shape[-2:])
        return _DECODERS[form](table.T if turned else table, classes, scale)

    unit = "shares of the picture" if in_shares else "pixels"
    kind = {BOX: "YOLO", BOX_AND_OBJECT: "YOLO with objectness", END_TO_END: "YOLO end to end"}[form]
    return Reading(f"{kind}, {count or 'unknown number of'} classes, boxes in {unit}", boxes)


def _forms(
    columns: int, boxes: int, turned: bool, class_count: int | None, size: tuple[int, int]
) -> list[int]:
    """The forms of a table with so many ``columns`` and ``boxes``."""
    count = COCO_CLASSES if class_count is None else class_count
    raw = [form for form in (BOX, BOX_AND_OBJECT) if columns == form + count]
    if class_count is None and columns == END_TO_END:
        return [] if turned or boxes in _grid_sizes(size) else [END_TO_END]
    if columns == END_TO_END and not turned:
        return raw if raw and boxes in _grid_sizes(size) else [END_TO_END]
    return raw


@cache
def _grid_sizes(size: tuple[int, int]) -> frozenset[int]:
    """The numbers of boxes of raw tables: one or three a cell of grids of 8 to 32 px, or with 4 or 64."""
    cells = [(size[0] // stride) * (size[1] // stride) for stride in (STRIDES_PX[0] // 2, *STRIDES_PX, 64)]
    sums = {sum(cells[1:4]), sum(cells[:4]), sum(cells[1:]), sum(cells[2:4])}
    return frozenset(each * number for each in (1, 3) for number in sums)


def _no_single_form(shape: tuple[int, ...], class_count: int | None, *, two: bool) -> str:
    if class_count is None:
        return (
            f"its table {_shapes_text([shape])} says not how many classes it has, and neither does the file: state"
            " boxes: class_count in lead.yaml"
        )
    if two:
        return f"its table {_shapes_text([shape])} can be read in two ways with {class_count} classes"
    return (
        f"its table {_shapes_text([shape])} does not fit {class_count} classes: expected {BOX + class_count}"
        f" columns, {BOX_AND_OBJECT + class_count} with objectness, or (n, {END_TO_END}) from left to class"
    )


def _has(classes: Sequence[int], count: int | None) -> None:
    if count is not None and max(classes) >= count:
        raise Misfit(f"it has {count} classes, and boxes: classes in lead.yaml names number {max(classes)}")


def _in_shares(table: Floats, turned: bool, form: int) -> bool:
    """Whether coordinates are shares of the picture; a table of zeros has pixels."""
    rows = table.reshape(table.shape[-2:])
    most = float(np.abs((rows.T if turned else rows)[:, :BOX]).max(initial=0.0))
    return 0.0 < most <= SHARES_MOST


def _shapes_text(shapes: Sequence[tuple[int, ...]]) -> str:
    return " and ".join(f"({', '.join(map(str, shape))})" for shape in shapes)


def ssd_boxes(outputs: Outputs, classes: Sequence[int], size: tuple[int, int]) -> Boxes:
    """Boxes of raw SSD outputs: encodings (1, n, 4) and class logits (1, n, c), by TensorFlow's box coder.

    y = y_a + h_a·t_y/10, h = h_a·exp(t_h/5), likewise x and w; Liu et al., SSD (ECCV 2016), section 2.2.
    """
    encoded = next(o for o in outputs if o.shape[-1] == BOX)[0]
    logits = next(o for o in outputs if o.shape[-1] != BOX)[0]
    anchors = ssd_anchors(size[0])
    centre = anchors[:, :2] + anchors[:, 2:] * encoded[:, :2] / 10  # y, x
    half = anchors[:, 2:] * np.exp(encoded[:, 2:] / 5) / 2
    corners = np.column_stack([(centre - half)[:, ::-1], (centre + half)[:, ::-1]]).astype(np.float32)
    scores = 1 / (1 + np.exp(-logits[:, list(classes)]))
    return corners, scores.astype(np.float32)


@cache
def ssd_anchors(size_px: int) -> Floats:
    """Anchors (n, 4) as y, x, height, width: six layers, scales 0.2 to 0.95, the lowest layer with three shapes."""
    scales = np.append(np.linspace(0.2, 0.95, 6), 1.0)
    rows: list[tuple[float, float, float, float]] = []
    cells = -(-size_px // 16)
    for layer in range(6):
        if layer == 0:
            shapes = [(0.1, 1.0), (scales[0], 2.0), (scales[0], 0.5)]
        else:
            shapes = [(scales[layer], ratio) for ratio in (1.0, 2.0, 0.5, 3.0, 1 / 3)]
            shapes.append((float(np.sqrt(scales[layer] * scales[layer + 1])), 1.0))
        for y, x in itertools.product(range(cells), repeat=2):
            rows += [
                ((y + 0.5) / cells, (x + 0.5) / cells, scale / ratio**0.5, scale * ratio**0.5)
                for scale, ratio in shapes
            ]
        cells = -(-cells // 2)
    return np.array(rows, np.float32)


def _plain(table: Floats, classes: Sequence[int], scale: Floats) -> Boxes:
    """Rows of centre, width, height, then a score a class."""
    return _boxes_of_centres(table, scale), table[:, [BOX + number for number in classes]]


def _with_object(table: Floats, classes: Sequence[int], scale: Floats) -> Boxes:
    """Rows of centre, width, height, P(an object), then P(class | an object)."""
    scores = table[:, BOX : BOX + 1] * table[:, [BOX_AND_OBJECT + number for number in classes]]
    return _boxes_of_centres(table, scale), scores


def _finish_boxes(table: Floats, classes: Sequence[int], scale: Floats) -> Boxes:
    """Rows of left, top, right, bottom, score and class."""
    corners = table[:, :BOX] / np.tile(scale, 2)
    of_class = np.rint(table[:, 5:6]) == np.array(classes, np.float32)
    return corners.astype(np.float32), np.where(of_class, table[:, 4:5], 0).astype(np.float32)


def _boxes_of_centres(table: Floats, scale: Floats) -> Floats:
    centre, half = table[:, :2], table[:, 2:4] / 2
    corners = np.column_stack([centre - half, centre + half]) / np.tile(scale, 2)
    return corners.astype(np.float32)


_DECODERS = {BOX: _plain, BOX_AND_OBJECT: _with_object, END_TO_END: _finish_boxes}
