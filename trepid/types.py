"""Types that every package shares: numbers with a range, for settings, and arrays by their element type."""

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(ge=0, le=1)]  # [0, 1]
PositiveShare = Annotated[float, Field(gt=0, le=1)]  # (0, 1]
OpenShare = Annotated[float, Field(gt=0, lt=1)]  # (0, 1)

Array = NDArray[np.float64]
Floats = NDArray[np.float32]
Column = NDArray[np.float64]  # one dimension: a value per sample
Image = NDArray[np.uint8]  # (height, width) grey or (height, width, 3) BGR
Mask = NDArray[np.bool_]
