"""A frozen camera: no new image while the vehicle moves. Sensor noise never repeats."""

import math


def is_frozen(
    frozen_s: float | None, speed_mps: float | None, *, after_s: float, from_mps: float, if_unknown: bool
) -> bool:
    """Whether no new image has come for more than ``after_s`` at a speed of at least ``from_mps``.

    ``if_unknown`` stands for a comparison with None or NaN: True where the lane in the image would be used, False
    where evidence of a frozen camera is needed.
    """
    still = if_unknown if frozen_s is None or math.isnan(frozen_s) else frozen_s > after_s
    moves = if_unknown if speed_mps is None or math.isnan(speed_mps) else abs(speed_mps) >= from_mps
    return still and moves
