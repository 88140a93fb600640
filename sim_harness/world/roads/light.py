"""Settings of light and exposure."""

from trepid.config import Settings
from trepid.types import NonNegative, Positive, Share


class Light(Settings):
    """Light, exposure and image quality of one frame."""

    gain: Positive = 1.0  # exposure relative to a well-exposed frame
    gamma: Positive = 1.0  # > 1 darkens the middle greys
    glare: Share = 0.0  # low sun ahead: 0 none, 1 blinding
    haze: Share = 0.0  # share of the contrast lost over the whole image
    noise: NonNegative = 2.0  # standard deviation of sensor noise [grey levels]
    blur_px: NonNegative = 0.0  # standard deviation of defocus
