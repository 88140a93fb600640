"""Line segments of an image."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from trepid.types import Array, Image, Mask


@dataclass(frozen=True)
class Segments:
    """Line segments of an image."""

    middle_px: Array  # (n, 2)
    direction: Array  # (n, 2), unit vectors pointing up
    length_px: Array  # (n,)

    def part(self, chosen: Mask) -> "Segments":
        """The segments where ``chosen``, shape (n,), is true."""
        return Segments(self.middle_px[chosen], self.direction[chosen], self.length_px[chosen])

    def angle_to_rad(self, point_px: Array) -> Array:
        """Angle between each segment and the ray from its middle to a point; π for a segment above the point."""
        to = point_px - self.middle_px
        distance = np.hypot(*to.T) + 1e-9
        sine = (to[:, 0] * self.direction[:, 1] - to[:, 1] * self.direction[:, 0]) / distance
        below = (to * self.direction).sum(axis=1) > 0
        return np.where(below, np.arcsin(np.clip(sine, -1, 1)), np.pi)


def segments(grey: Image) -> Segments:
    """All segments of a grey image: Grompone von Gioi et al., LSD: a Line Segment Detector, IPOL 2012."""
    found = cv2.createLineSegmentDetector().detect(grey)[0]
    ends = np.empty((0, 4)) if found is None else np.asarray(found, float).reshape(-1, 4)
    start, end = ends[:, :2], ends[:, 2:]
    span = end - start
    span *= np.where(span[:, 1] > 0, -1.0, 1.0)[:, None]
    length_px = np.hypot(span[:, 0], span[:, 1])
    return Segments((start + end) / 2, span / np.maximum(length_px, 1e-9)[:, None], length_px)


def joined(images: Sequence[Segments]) -> Segments:
    """The segments of several images."""
    return Segments(
        np.concatenate([one.middle_px for one in images]),
        np.concatenate([one.direction for one in images]),
        np.concatenate([one.length_px for one in images]),
    )
