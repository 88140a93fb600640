"""Images in which the bonnet of the own car covers the lowest rows, or in which parts of the car stand still."""

import cv2
import numpy as np

PILLAR = (((0, 1), (0.16, 1), (0.04, 0), (0, 0)),)
WIPER = (((0.5, 1), (0.53, 1), (0.86, 0.62), (0.85, 0.6)),)
VENTS = tuple(
    ((x, 0.98), (x + 0.015, 0.98), (x + 0.06, 0.7), (x + 0.055, 0.7)) for x in (0.3, 0.35, 0.4, 0.45)
)
"""Outlines in shares of width and height: a pillar at the left, a wiper, vents reflected in the windscreen."""


def with_outlines(image, outlines, *, grey=None, lighter=0):
    """``image`` with ``outlines`` in one ``grey``, or lighter by some grey levels."""
    height, width = image.shape[:2]
    share = np.zeros((height, width, 1), np.float32)
    for outline in outlines:
        cv2.fillPoly(share, [np.int32(np.array(outline) * (width, height))], 1.0)
    changed = image.astype(np.float32) + lighter if grey is None else grey
    return np.clip(image + share * (changed - image.astype(np.float32)), 0, 255).astype(np.uint8)


def with_bonnet(image, grey, *, share=0.2, arch=0.3, waves=0.0):
    """``image`` under a bonnet whose rim is ``share`` of the height above the lower edge in the middle.

    At the sides the rim is lower by ``arch`` of that; ``waves``: grey levels of what the paint reflects.
    """
    height, width = image.shape[:2]
    across = np.linspace(-1, 1, width)
    rim = height * (1 - share * (1 - arch * across**2))
    below = np.arange(height)[:, None] >= rim
    paint = np.clip(grey + waves * np.sin(9 * across), 0, 255).astype(np.uint8)
    covered = image.copy()
    covered[below] = np.broadcast_to(paint[None, :, None], image.shape)[below]
    return covered
