"""Recall and precision of the detector of people on labelled pictures of streets (CamVid)."""

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from perception.lead.boxes import BoxDetector
from perception.lead.finder import box_detector, lead_settings
from perception.lead.kinds import CYCLIST, PERSON, Box, with_cyclists
from trepid.car.camera import Camera
from trepid.config import CONFIG_DIR, InputError, load
from trepid.images.files import read_image

SET = "camvid_road"
PERSON_LABELS = (9, 10)  # pedestrian and bicyclist of the 11 classes (Badrinarayanan et al., SegNet, 2017)
EVERY, QUICK_EVERY = 2, 24
HEIGHTS_SHARE = (0.05, 0.1, 0.15, 0.25, 1.0)  # of the picture; 0.1: 14 m with the default camera
LEAST_SHARE = 0.0005  # of the area of the picture
SURE = 0.5  # least confidence
OVERLAP = 0.3  # of areas, intersection over union
INSIDE = 0.2  # least share of people in a box that is right
Corners = tuple[float, float, float, float]


class ScoredPicture(NamedTuple):
    """One picture: labelled people with whether they were found, and boxes with whether they are right."""

    people: list[tuple[float, bool]]  # height as a share of the picture
    boxes: list[bool]


def real_pictures(folder: Path, detector: Path, *, quick: bool = False) -> dict[str, Any]:
    """Recall by the height of a person, and the share of right boxes; a line where something is missing."""
    pictures = folder / SET
    if not pictures.is_dir():
        return {"people": f"not measured: no folder {pictures}"}
    try:
        found = list(_score_pictures(pictures, detector, QUICK_EVERY if quick else EVERY))
    except InputError as error:
        return {"people": f"not measured: {error}"}
    people = [person for one in found for person in one.people]
    boxes = [right for one in found for right in one.boxes]
    rows: dict[str, Any] = {}
    for low, high in pairwise(HEIGHTS_SHARE):
        some = [seen for share, seen in people if low <= share < high]
        name = f"people of {low:g} to {high:g} of the height of the picture"
        rows[name] = {"people": len(some), "recall": round(float(np.mean(some)), 2) if some else None}
    return rows | {
        "boxes": {"boxes": len(boxes), "precision": round(float(np.mean(boxes)), 2) if boxes else None},
        "pictures": len(found),
    }


def _score_pictures(pictures: Path, detector: Path, every: int) -> Iterator[ScoredPicture]:
    found: BoxDetector | None = None
    for path in sorted(pictures.glob("train/*.jpg"))[::every]:
        image = read_image(path)
        label = cv2.imread(str(pictures / "train_road" / f"{path.stem}.png"), cv2.IMREAD_GRAYSCALE)
        if label is None:
            raise InputError(f"{pictures}: no label of {path.name}")
        if found is None:  # all pictures have one size
            camera = load(CONFIG_DIR / "camera.yaml", Camera).resize(image.shape[1], image.shape[0])
            found = box_detector(lead_settings(detector), camera)
        sure = [box for box in with_cyclists(found.boxes(image)) if box.confidence >= SURE]
        people = [box for box in sure if box.kind in (PERSON, CYCLIST)]
        yield score_picture(np.isin(label, PERSON_LABELS), [_corners(box) for box in people])


def _corners(box: Box) -> Corners:
    left, top, right, bottom = box.corners.tolist()
    return left, top, right, bottom


def score_picture(people: NDArray[np.bool_], boxes: list[Corners]) -> ScoredPicture:
    """The boxes beside the connected areas of labelled ``people``; neighbours that touch are one area."""
    height, width = people.shape
    _, _, areas, _ = cv2.connectedComponentsWithStats(people.astype(np.uint8))
    labelled: list[tuple[float, bool]] = []
    for left, top, wide, high, area in areas[1:].tolist():
        if area >= LEAST_SHARE * height * width:
            there = (left, top, left + wide, top + high)
            labelled.append((high / height, any(overlap(there, box) >= OVERLAP for box in boxes)))
    return ScoredPicture(labelled, [_is_right(people, box) for box in boxes])


def overlap(one: Corners, other: Corners) -> float:
    """Intersection over union of two boxes."""
    wide = min(one[2], other[2]) - max(one[0], other[0])
    high = min(one[3], other[3]) - max(one[1], other[1])
    shared = max(wide, 0.0) * max(high, 0.0)
    areas = [(box[2] - box[0]) * (box[3] - box[1]) for box in (one, other)]
    return shared / (sum(areas) - shared)


def _is_right(people: NDArray[np.bool_], box: Corners) -> bool:
    left, top, right, bottom = (max(round(corner), 0) for corner in box)
    inside = people[top : bottom + 1, left : right + 1]
    return bool(inside.size and inside.mean() >= INSIDE)
