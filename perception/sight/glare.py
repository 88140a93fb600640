"""Glare instead of fog: stray light of a lens veils a scene as fog does, with the light of a source in the image.

The veil of a lamp or of the sun falls off with the angle from the source (CIE 146), while the light of fog is that
of the whole sky: in fog the sky is even, also where it is white.
"""

import numpy as np

from perception.camera.grey import small_grey
from perception.sight.settings import GlareSettings
from trepid.types import Image

DARKEST = 10  # percentile of the sky: away from the source


def is_glare(image: Image, over_exposed: float, horizon: float, settings: GlareSettings) -> bool:
    """Whether a source of light stands in a darker sky.

    ``over_exposed``: share of white pixels; ``horizon``: share of the rows of ``image`` above the horizon. False
    where the image shows no sky.
    """
    if over_exposed < settings.least_source:
        return False
    grey = small_grey(image)
    sky = grey[: round(min(max(horizon, 0.0), 1.0) * len(grey)) : 2, ::2]
    return sky.size > 0 and float(np.percentile(sky, DARKEST)) < 255 * settings.darker_sky
