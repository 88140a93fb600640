"""Safety margins of a run: one value per sample of a trace.

NaN where the margin is undefined, inf where the event will not occur in the present motion.
"""

import numpy as np

from sim_harness.judging.trace import Trace
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load
from trepid.types import Column

STANDING_MPS = 0.1  # below it a time gap is infinite


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

    TTC = gap / (v - v_lead): Hayward, Near-miss determination through use of a scale of danger (1972). The
    closing speed is minus the backward difference of the gap, which is exact here: the gap is the true one.
    """
    gap_m, t_s = trace["lead_gap_m"], trace["t_s"]
    closing_mps = -np.diff(gap_m, prepend=np.nan) / np.diff(t_s, prepend=np.nan)
    closing = closing_mps > 0.0
    time_s = np.where(closing, gap_m / np.where(closing, closing_mps, 1.0), np.inf)
    time_s = np.where(gap_m <= 0.0, 0.0, time_s)
    return np.where(np.isnan(gap_m) | np.isnan(closing_mps), np.nan, time_s)


def lane_edge_distance_m(trace: Trace) -> Column:
    """DTLE [m]: from the outermost edge of a wheel to the lane edge beside it, < 0 beyond the edge.

    min over wheels of w/2 - |y_wheel| - b/2·cos ψ with the axle centres at y (rear) and y + L·sin ψ (front),
    ψ the heading error and b the width over the wheels. Euro NCAP, Test Protocol - Lane Support Systems
    v2.0.2 (2018), definitions; its limits are -0.3 m at a line and -0.1 m at a road edge. The lane is taken
    as straight over the wheelbase (1 cm off at a radius of 150 m, L = 1.75 m).
    """
    vehicle = default_vehicle()
    offset_m, error_rad = trace["lateral_offset_m"], trace["heading_error_rad"]
    front_m = offset_m + vehicle.wheelbase_m * np.sin(error_rad)
    half_m = vehicle.track_m / 2 * np.cos(error_rad)
    return trace["lane_width_m"] / 2 - np.maximum(np.abs(offset_m), np.abs(front_m)) - half_m


def default_vehicle() -> Vehicle:
    """The vehicle of ``vehicle.yaml``."""
    return load(CONFIG_DIR / "vehicle.yaml", Vehicle)


def time_to_crossing_s(trace: Trace) -> Column:
    """TLC [s]: until a wheel is over the lane edge if the steering is held; 0 beyond it, inf if it never will be.

    With d the distance from the wheel to an edge, u its speed towards it and a its acceleration towards it,
    the first t > 0 with u·t + a·t²/2 = d: the second-order formula of van Winsum, Brookhuis and de Waard, A
    comparison of different ways to approximate time-to-line crossing (TLC) during car driving, Accident
    Analysis and Prevention 32 (2000), after Godthelp, Milgram and Blaauw, Human Factors 26 (1984). Relative
    to the lane, y' = v·sin ψ, ψ' = r - κ·v and y'' = v·ψ', so lane and path may both bend; of both axles and
    both edges, the least time. v and r are those that the vehicle reports.
    """
    vehicle = default_vehicle()
    speed_mps, error_rad = trace["speed_mps"], trace["heading_error_rad"]
    turn_radps = trace["yaw_rate_radps"] - trace["curvature_1pm"] * speed_mps
    room_m = trace["lane_width_m"] / 2 - vehicle.track_m / 2 * np.cos(error_rad)
    time_s = np.full(len(trace), np.inf)
    for ahead_m in (0.0, vehicle.wheelbase_m):
        offset_m = trace["lateral_offset_m"] + ahead_m * np.sin(error_rad)
        drift_mps = speed_mps * np.sin(error_rad) + ahead_m * np.cos(error_rad) * turn_radps
        for side in (1.0, -1.0):
            gap_m = room_m - side * offset_m
            time_s = np.minimum(time_s, _first_s(gap_m, side * drift_mps, side * speed_mps * turn_radps))
    return time_s


def _first_s(gap_m: Column, speed_mps: Column, accel_mps2: Column) -> Column:
    """The first t ≥ 0 with speed·t + accel·t²/2 = gap, as 2·gap / (speed + √(speed² + 2·accel·gap)); else inf.

    This form of the root has no division by a vanishing acceleration.
    """
    square = speed_mps**2 + 2.0 * accel_mps2 * gap_m
    below = speed_mps + np.sqrt(np.maximum(square, 0.0))
    comes = (square >= 0.0) & (below > 1e-9)
    time_s = np.where(comes, 2.0 * gap_m / np.where(comes, below, 1.0), np.inf)
    return np.where(gap_m <= 0.0, 0.0, time_s)
