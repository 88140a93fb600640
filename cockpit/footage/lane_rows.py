"""Estimates of lanes as rows: objects for JSON, and cells of a table."""

import math
from typing import Any

from cockpit.footage.annotate import annotate, as_path, number
from cockpit.footage.frames import FrameResult, Sheet
from trepid.messages import SteeringEstimate

COLUMNS = [
    "file",
    "frame",
    "offset m",
    "heading °",
    "curv. 1/m",
    "wheel °",
    "width m",
    "lines",
    "conf.",
    "ms",
    "reason",
]


def as_row(one: FrameResult[SteeringEstimate]) -> dict[str, Any]:
    """The JSON object of one frame."""
    return {"file": str(one.path), "frame": one.number, **estimate_fields(one.result, one.latency_ms)}


def estimate_fields(result: SteeringEstimate, latency_ms: float | None) -> dict[str, Any]:
    """The fields of an estimate in JSON; None where it has none. ``speed_mps`` is there where one is proposed."""
    proposal = {} if result.speed_mps is None else {"speed_mps": result.speed_mps}
    return {
        "estimator": result.estimator,
        "lateral_offset_m": result.lateral_offset_m,
        "heading_error_rad": result.heading_error_rad,
        "curvature_1pm": result.curvature_1pm,
        "road_wheel_angle_rad": result.road_wheel_angle_rad,
        "confidence": result.confidence,
        "lanes_detected": result.lanes_detected,
        "lane_width_m": result.lane_width_m,
        "latency_ms": latency_ms,
        "reason": result.reason,
        "left_boundary_px": as_path(result.left_boundary_px) or None,
        "right_boundary_px": as_path(result.right_boundary_px) or None,
        **proposal,
    }


def _cells(one: FrameResult[SteeringEstimate]) -> list[str]:
    result = one.result
    heading, wheel = result.heading_error_rad, result.road_wheel_angle_rad
    return [
        one.path.name,
        str(one.number),
        number(result.lateral_offset_m, "{:+z.2f}"),
        number(None if heading is None else math.degrees(heading), "{:+z.2f}"),
        number(result.curvature_1pm, "{:+z.4f}"),
        number(None if wheel is None else math.degrees(wheel), "{:+z.2f}"),
        number(result.lane_width_m, "{:z.2f}"),
        str(result.lanes_detected),
        f"{result.confidence:z.2f}",
        number(one.latency_ms, "{:z.1f}"),
        result.reason,
    ]


LANES = Sheet(
    as_row=as_row,
    columns=COLUMNS,
    left={"file", "reason"},
    cells=_cells,
    draw=lambda one: annotate(one.image, one.result),
)
