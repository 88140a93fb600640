"""An exact range sensor on the front bumper: the vehicle ahead, for runs without a lead detector."""

import math

from sim_harness.lockstep.contact import along_and_across
from sim_harness.lockstep.traffic import Traffic
from sim_harness.world.plants.state import PlantState
from trepid.messages import LeadVehicle


def measured_lead(
    traffic: Traffic, pose: PlantState, *, station_m: float, nose_m: float, range_m: float, t_s: float
) -> LeadVehicle | None:
    """The nearest vehicle in the lane; confidence 0 where there is none within ``range_m``.

    None in a run without other vehicles, in which this sensor does not run. ``pose`` and ``station_m`` are of the
    rear axle, ``nose_m`` is the distance from there to the front bumper.
    """
    if not traffic.actors:
        return None
    nothing = LeadVehicle(t_s=t_s, distance_m=None, lateral_m=None, speed_mps=None, confidence=0.0)
    ahead = traffic.ahead(station_m + nose_m)
    if ahead is None:
        return nothing
    actor, _ = ahead
    box = actor.box
    ends = [from_axle(pose, *box.at(x_m)) for x_m in (box.rear_m, box.front_m)]
    distance_m = min(from_axle(pose, *corner)[0] for corner in box.corners()) - nose_m
    if distance_m > range_m:
        return nothing
    return LeadVehicle(
        t_s=t_s,
        distance_m=distance_m,
        lateral_m=min(ends)[1],  # of the middle of the nearer end
        speed_mps=actor.speed_mps * math.cos(box.yaw_rad - pose.yaw_rad),
        confidence=1.0,
    )


def from_axle(pose: PlantState, x_m: float, y_m: float) -> tuple[float, float]:
    """A point of the ground in the axes of the vehicle at ``pose``."""
    return along_and_across(x_m - pose.x_m, y_m - pose.y_m, pose.yaw_rad)
