"""The limiter: last word before the actuator. It passes a command on, bounded, or stops the car by itself.

It runs in the vehicle process, trusts nothing that it is sent, and shares no code with the controller: even the
bicycle equation is written a second time here, so that no mistake can be in both. It depends on ``trepid`` alone.
"""

from controller.limiter.limiter import Limiter, build
from controller.limiter.limits import Limits

__all__ = ["Limiter", "Limits", "build"]
