"""Light and camera conditions. Pure settings."""

from typing import Annotated

from pydantic import Field

from trepid.config import Settings

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]


class Light(Settings):
    """Light and camera conditions of one frame."""

    gain: Positive = 1.0  # exposure relative to a well-exposed frame
    gamma: Positive = 1.0  # > 1 darkens the middle greys
    glare: Share = 0.0  # low sun ahead: 0 none, 1 blinding
    haze: Share = 0.0  # share of the contrast lost over the whole picture
    noise: NonNegative = 2.0  # standard deviation of sensor noise [grey levels]
    blur_px: NonNegative = 0.0  # standard deviation of defocus
