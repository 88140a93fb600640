"""Vehicles, people, cyclists and animals from a box detector in an ONNX or TensorFlow Lite file.

The lower edge of a box is where it stands on the road; the camera geometry turns it into metres
 (Stein, Mano and Shashua, Vision-based ACC with a Single Camera, IEEE Intelligent Vehicles 2003).
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BeforeValidator, Field

from perception.lead.detection import Detection, NotFinite, Platt
from perception.lead.kinds import KINDS, VEHICLE, Box, detected_kinds, standing, with_cyclists
from perception.lead.runtimes import open_network
from perception.lead.tables import Boxes, Misfit, Reading, reading_of
from perception.net.session import first_run
from trepid.car.camera import Camera
from trepid.config import InputError, Settings
from trepid.spelling import did_you_mean
from trepid.types import Floats, Image, OpenShare

GREY = 128
T = TypeVar("T")
NMS_OVERLAP = 0.5
WIDTH_M = (0.7, 4.0)  # of vehicles: a motorcycle to a truck at an angle; an assumed camera errs by a fifth
REAR_M = (1.4, 2.6)  # widths of the rears of cars to lorries
LENGTH_M = 4.0  # of a vehicle: a longer one is taken for nearer to the lane than it is
FARTHEST_M = 120.0
BONNET_SHARE = (
    0.9  # of the image; of the nearest row, 3.2 m wide by the default camera, a lorry of 2.55 m covers 0.8
)
CUT_SHARE = 0.02  # of a part of the image: a box that ends nearer to its edge is cut off there


def _of_vehicles(classes: Any) -> Any:
    """The form of earlier versions, which detected vehicles only, as a mapping."""
    return classes if isinstance(classes, Mapping) else {VEHICLE: classes}


def _are_kinds(values: dict[str, T]) -> dict[str, T]:
    unknown = [kind for kind in values if kind not in KINDS]
    if unknown:
        raise ValueError(f"unknown kind {unknown[0]!r}; {did_you_mean(unknown[0], KINDS)}")
    return values


def _is_some(classes: dict[str, tuple[int, ...]]) -> dict[str, tuple[int, ...]]:
    if not any(classes.values()):
        raise ValueError("no class of any kind")
    return classes


class BoxSettings(Settings):
    """Section ``boxes`` of ``config/lead.yaml``."""

    layout: Literal["ssd", "yolo"]
    class_count: Annotated[int, Field(ge=1)] | None = (
        None  # of the network; None: by the file, else COCO's 80
    )
    # kind of perception.lead.kinds -> its classes; a list is that of vehicles
    classes: Annotated[
        dict[str, tuple[int, ...]],
        BeforeValidator(_of_vehicles),
        AfterValidator(_are_kinds),
        AfterValidator(_is_some),
    ]
    min_score: OpenShare
    tile_share: Annotated[float, Field(gt=0, le=1)]  # 1: no second detection around the horizon
    calibration: Platt = Platt(
        bias=0.0, slope=1.0
    )  # of the scores to probabilities; these values change nothing
    # of kinds with a calibration of their own
    calibrations: Annotated[dict[str, Platt], AfterValidator(_are_kinds)] = Field(default_factory=dict)

    @property
    def kinds(self) -> tuple[str, ...]:
        """The kinds with classes."""
        return tuple(kind for kind, classes in self.classes.items() if classes)


class BoxDetector:
    """A box detector for one camera."""

    def __init__(self, path: Path, settings: BoxSettings, camera: Camera) -> None:
        """Raises InputError when the file is missing, of another kind, or its runtime is not installed.

        The network is run once, on a grey picture: one that fails on it, or whose outputs are not those of the
        settings, is refused with what was found.
        """
        self._path, self._network = path, open_network(path)
        self._settings, self._camera = settings, camera
        self._classes = [number for classes in settings.classes.values() for number in classes]
        self._kinds = [kind for kind, classes in settings.classes.items() for _ in classes]
        self._reading = self._first_reading()
        grey = np.full((camera.height_px, camera.width_px, 3), GREY, np.uint8)
        first_run(path, lambda: self.boxes(grey), lambda found: [box.corners for box in found])

    def _first_reading(self) -> Reading:
        """How the outputs are read, from those of a grey picture. Raises InputError."""
        names, entry = self._network.names, self._network.input
        grey = np.full((entry.height, entry.width, 3), GREY, np.uint8)
        outputs = first_run(self._path, lambda: self._network.run(self._pixels(grey)), tuple)
        count = self._settings.class_count or (None if names is None else len(names))
        try:
            return reading_of(
                outputs,
                layout=self._settings.layout,
                classes=self._classes,
                class_count=count,
                size=(entry.width, entry.height),
            )
        except Misfit as error:
            raise InputError(f"{self._path}: {error}") from error

    @property
    def text(self) -> str:
        """How the file is read, in one line: the form of its outputs, its picture, and its classes by name."""
        entry, names = self._network.input, self._network.names
        named = (
            {}
            if names is None
            else {k: [names[n] for n in some] for k, some in self._settings.classes.items()}
        )
        classes = "; ".join(f"{kind} = {', '.join(some)}" for kind, some in named.items() if some)
        picture = f"{entry.width} x {entry.height} {np.dtype(entry.kind).name}"
        return (
            f"{self._path.name}: {self._reading.text}, picture {picture}{f'; {classes}' if classes else ''}"
        )

    @property
    def detects(self) -> tuple[str, ...]:
        """The kinds of road users besides vehicles that it finds at all."""
        return detected_kinds(self._settings.kinds)

    def __call__(self, image: Image) -> list[Detection]:
        """The road users in ``image``, in falling order of confidence."""
        boxes = self.boxes(image)
        seen = [on_road(self._camera, b.corners, b.confidence) for b in boxes if b.kind == VEHICLE]
        seen += [standing(self._camera, box) for box in with_cyclists(boxes)]
        return sorted(filter(None, seen), key=lambda detection: -detection.confidence)

    def boxes(self, image: Image) -> list[Box]:
        """The boxes in ``image``, those of a kind without overlaps."""
        found: dict[str, list[tuple[Floats, float]]] = {kind: [] for kind in self._kinds}
        whole = (0, 0, self._camera.width_px, self._camera.height_px)
        for left, top, right, bottom in self._tiles():
            corners, scores = self._look(image[top:bottom, left:right])
            uncut = _uncut(corners, (left, top, right, bottom), whole)
            corners, scores = corners[uncut], scores[uncut]
            scale = np.array([right - left, bottom - top] * 2, np.float32)
            shift = np.array([left, top] * 2, np.float32)
            for kind in found:
                best = scores[:, [k == kind for k in self._kinds]].max(axis=1)
                sure = best >= self._settings.min_score
                found[kind] += zip(corners[sure] * scale + shift, best[sure].tolist(), strict=True)
        of_kind, usual = self._settings.calibrations, self._settings.calibration
        return [
            Box(kind, some[i][0], of_kind.get(kind, usual)(some[i][1]))
            for kind, some in found.items()
            for i in _suppress_overlaps(some, self._settings.min_score)
        ]

    def _tiles(self) -> list[tuple[int, int, int, int]]:
        """The whole image, and a part around the horizon in which far vehicles are larger."""
        width, height = self._camera.width_px, self._camera.height_px
        tiles = [(0, 0, width, height)]
        share = self._settings.tile_share
        if share < 1:
            w, h = round(width * share), round(height * share)
            left = round(min(max(self._camera.cx_px - w / 2, 0), width - w))
            top = round(min(max(self._camera.horizon_row_px - h / 3, 0), height - h))
            tiles.append((left, top, left + w, top + h))
        return tiles

    def _look(self, image: Image) -> Boxes:
        corners, scores = self._reading.boxes(self._network.run(self._pixels(image)))
        if not np.isfinite(scores).all():
            raise NotFinite(self._path.name)
        sure = scores.max(axis=1) >= self._settings.min_score
        return corners[sure], scores[sure]

    def _pixels(self, image: Image) -> NDArray[np.generic]:
        low = -1.0 if self._settings.layout == "ssd" else 0.0  # SSD takes -1..1, YOLO 0..1
        return self._network.input.pixels(image, low=low)


def on_road(camera: Camera, corners: Sequence[float] | Floats, confidence: float) -> Detection | None:
    """The vehicle of a box [px]; None where it would not stand on the road or not have the width of a vehicle.

    The place is that of its rear: a flank widens the box of a vehicle beside the lane (:func:`rear`). A box
    about as wide as the image that ends at its lower edge is the bonnet of the ego vehicle, or the whole
    scene taken for a vehicle, as beside a parked van: no vehicle is so wide so near.
    """
    left, _, right, bottom = (float(c) for c in corners)
    if right - left >= BONNET_SHARE * camera.width_px and bottom >= BONNET_SHARE * camera.height_px:
        return None
    feet = camera.road_from_pixel([(left, bottom), (right, bottom)])
    ahead_m, left_m = feet.mean(axis=0).tolist()
    if not camera.x_m < ahead_m <= FARTHEST_M:
        return None
    width_m = float(np.hypot(*(feet[0] - feet[1])))
    if not WIDTH_M[0] <= width_m <= WIDTH_M[1]:
        return None
    aside_m = left_m - camera.y_m
    ends_m = rear(aside_m + width_m / 2, aside_m - width_m / 2, ahead_m - camera.x_m)
    left_m, width_m = sum(ends_m) / 2 + camera.y_m, ends_m[0] - ends_m[1]
    return Detection(ahead_m, left_m, width_m, min(max(confidence, 1e-3), 1 - 1e-3))


def rear(left_m: float, right_m: float, depth_m: float) -> tuple[float, float]:
    """The left and the right end of the rear of a vehicle, whose box has these ends at the distance of its foot.

    They are measured from the axis of the lens, left positive, ``depth_m`` along it. A vehicle beside the
    axis shows its flank to the lens. Its rear, at the distance D, ends at the outer end of the box, but the
    inner end of the box is the front end of the flank, L farther away, which a box at D shows at D/(D + L) of
    its distance from the axis. L is at least LENGTH_M. A rear that would be wider than REAR_M is none of a
    vehicle along the road: one that stands askew or across keeps its box. None gets narrower than REAR_M.
    """
    inner_m, outer_m = sorted((left_m, right_m), key=abs)
    if inner_m * outer_m <= 0.0:
        return left_m, right_m
    beside_m = min(abs(inner_m) * (1.0 + LENGTH_M / depth_m), abs(outer_m) - REAR_M[0])
    if beside_m <= abs(inner_m) or abs(outer_m) - beside_m > REAR_M[1]:
        return left_m, right_m
    return (outer_m, beside_m) if outer_m > 0.0 else (-beside_m, outer_m)


def _uncut(
    corners: Floats, part: tuple[int, int, int, int], whole: tuple[int, int, int, int]
) -> NDArray[np.bool_]:
    """Which boxes [shares of ``part``] no edge of ``part`` cuts off; an edge of the ``whole`` image cuts none.

    What is cut off would stand elsewhere and be of another size; the whole image shows it.
    """
    inner = np.array(part) != np.array(whole)
    near = np.concatenate([corners[:, :2] < CUT_SHARE, corners[:, 2:] > 1 - CUT_SHARE], axis=1)
    return np.asarray(~(near & inner).any(axis=1))


def _suppress_overlaps(found: list[tuple[Floats, float]], min_score: float) -> list[int]:
    """Indices in ``found`` of the boxes that non-maximum suppression keeps."""
    if not found:
        return []
    boxes = [(b[0], b[1], b[2] - b[0], b[3] - b[1]) for b, _ in found]
    kept = cv2.dnn.NMSBoxes(boxes, [score for _, score in found], min_score, NMS_OVERLAP)
    return [int(i) for i in np.asarray(kept).ravel()]
