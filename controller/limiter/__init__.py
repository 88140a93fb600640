"""The limiter: last stage before the actuator. It passes a command on within limits, or stops the car.

It runs in the vehicle process, checks every input, and shares no code with the controller: the bicycle equation is
written a second time here, so that one mistake is never in both. It imports only ``trepid``.
"""

from controller.limiter.limiter import Limiter, build
from controller.limiter.limits import Limits

__all__ = ["Limiter", "Limits", "build"]
