"""What was left at each moment of a run until something goes wrong: one value per sample of a trace.

NaN where there is nothing that could go wrong, inf where it will not as things stand.
"""

from functools import cache

import numpy as np

from sim_harness.lockstep.trace import Column, Trace
from trepid.config import CONFIG_DIR, load
from trepid.vehicle import Vehicle

STANDING_MPS = 0.1  # below it a time gap says nothing: what does not move hits nothing


def time_gap_s(trace: Trace) -> Column:
    """Bumper-to-bumper gap over own speed [s]: 0 in contact, inf standing, NaN without a vehicle ahead.

    UN R157 (2021), 5.2.3.3 states its least following distances as this time.
    """
    gap_m, speed_mps = trace["lead_gap_m"], trace["speed_mps"]
    moving = speed_mps > STANDING_MPS
    time_s = np.where(moving, gap_m / np.where(moving, speed_mps, 1.0), np.inf)
    time_s = np.where(gap_m <= 0.0, 0.0, time_s)
    return np.where(np.isnan(gap_m), np.nan, time_s)


def time_to_collision_s(trace: Trace) -> Column:
    """Gap over closing speed [s]: 0 in contact, inf while the gap grows, NaN without a vehicle ahead.

    TTC = gap / (v - v_lead): Hayward, Near-miss determination through use of a scale of danger (1972). The closing
    speed is minus the backward difference of the gap, which is exact here: the gap is the true one.
    """
    gap_m, t_s = trace["lead_gap_m"], trace["t_s"]
    closing_mps = -np.diff(gap_m, prepend=np.nan) / np.diff(t_s, prepend=np.nan)
    closing = closing_mps > 0.0
    time_s = np.where(closing, gap_m / np.where(closing, closing_mps, 1.0), np.inf)
    time_s = np.where(gap_m <= 0.0, 0.0, time_s)
    return np.where(np.isnan(gap_m) | np.isnan(closing_mps), np.nan, time_s)


def lane_edge_distance_m(trace: Trace, vehicle: Vehicle | None = None) -> Column:
    """DTLE [m]: from the outermost edge of a wheel to the lane edge beside it, < 0 beyond the edge.

    min over wheels of w/2 - |y_wheel| - b/2·cos ψ, with the axle centres at y (rear) and y + L·sin ψ (front), ψ the
    heading error and b the width over the wheels. Euro NCAP, LSS Test Protocol v4.3, section 1.1 (distance to lane
    edge). The lane is taken as straight over the wheelbase (1 cm off at a radius of 150 m, L = 1.75 m).
    ``vehicle``: by default that of ``config/vehicle.yaml``.
    """
    vehicle = vehicle or default_vehicle()
    offset_m, error_rad = trace["lateral_offset_m"], trace["heading_error_rad"]
    front_m = offset_m + vehicle.wheelbase_m * np.sin(error_rad)
    half_m = vehicle.track_m / 2 * np.cos(error_rad)
    return trace["lane_width_m"] / 2 - np.maximum(np.abs(offset_m), np.abs(front_m)) - half_m


@cache
def default_vehicle() -> Vehicle:
    """The vehicle of ``config/vehicle.yaml``."""
    return load(CONFIG_DIR / "vehicle.yaml", Vehicle)
