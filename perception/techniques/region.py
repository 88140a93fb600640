"""Which part of the picture is looked at (inventory A01–A03)."""

import numpy as np

from perception.techniques.picture import Boundaries, Box, Region, View


def roi_fixed(
    view: View, predicted: Boundaries | None, speed_mps: float | None, *, reach_m: float = 40.0
) -> Region:
    """The lower part of the picture, down from the row that shows the road ``reach_m`` ahead (A01).

    y ≥ y(reach): the boundaries' intersection lies above it, on the horizon, and follows from the lines; what is
    left out is sky. Source: R II.A, [7]. Cannot see: hills, where the road goes on above the row.
    """
    return Region(_rows(view, reach_m))


def _rows(view: View, reach_m: float) -> Box:
    near = np.flatnonzero(view.ahead_m <= reach_m)
    top = int(near[0]) if len(near) else view.height_px
    return Box(min(top, view.height_px - 2), view.height_px, 0, view.width_px)
