"""Images in which the bonnet of the own car covers the lowest rows."""

import numpy as np


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
