"""Traces of runs with known scores."""

from sim_harness.judging.trace import Recorder
from trepid.messages import SimTruth, VehicleState


def truth(t_s, **fields):
    values = dict(
        x_m=0.0,
        y_m=0.0,
        yaw_rad=0.0,
        station_m=0.0,
        lateral_offset_m=0.0,
        heading_error_rad=0.0,
        curvature_1pm=0.0,
        lane_width_m=3.5,
        lateral_accel_mps2=0.0,
        longitudinal_accel_mps2=0.0,
        departures=0,
        interventions=0,
        collisions=0,
        section="plain",
        lead_gap_m=None,
        lead_x_m=None,
        lead_y_m=None,
        lead_yaw_rad=None,
        finished=False,
    )
    return SimTruth(t_s=t_s, **(values | fields))


def state(t_s, speed_mps=10.0):
    return VehicleState(
        t_s=t_s, speed_mps=speed_mps, road_wheel_angle_rad=0.0, yaw_rate_radps=0.0, driver_override=False
    )


def trace_of(truths, decisions=None, speed_mps=10.0):
    recorder = Recorder()
    for i, sample in enumerate(truths):
        chosen = decisions[i] if decisions else None
        recorder.add(sample, state(sample.t_s, speed_mps), None, chosen, {})
    return recorder.trace()
