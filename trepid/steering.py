"""Road-wheel angle of a kinematic vehicle."""

import math
from typing import Annotated

from pydantic import Field

from trepid.config import Settings


class SteeringSettings(Settings):
    """Section ``steering`` of ``config/perception.yaml``."""

    lookahead_m: Annotated[float, Field(gt=0)]


def road_wheel_angle(curvature_1pm: float, *, wheelbase_m: float) -> float:
    """Road-wheel angle [rad], + left, that drives ``curvature_1pm`` without slip: δ = atan(L·κ).

    Rajamani, Vehicle Dynamics and Control (2012), section 2.2. The controller adds understeer.
    """
    return math.atan(wheelbase_m * curvature_1pm)
