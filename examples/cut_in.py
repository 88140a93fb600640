"""How near may a car cut in, and at what speed? Run it: trepid sim run cut_in.py --jobs 2"""

from sim_harness.scenarios.scenario import Scenario


def cut_in(gap_m: float, speed_mps: float) -> Scenario:
    phases = [
        {"kind": "change_lane", "at_s": 2, "over_s": 3},
        {"kind": "change_speed", "at_s": 8, "to_mps": 2, "rate_mps2": 2},
    ]
    return Scenario.model_validate(
        {
            "name": f"cut-in {gap_m} m ahead at {speed_mps} m/s",
            "description": "a car from the left lane cuts in, then brakes",
            "tags": ["traffic"],
            "road": "straight",
            "sight": "truth",  # this scenario examines the gap, not the camera
            "start": {"speed_mps": 8},
            "traffic": [{"gap_m": gap_m, "lane": 1, "speed_mps": speed_mps, "phases": phases}],
            "duration_s": 20,
            "expect": {"conditions": ["lead_gap >= 1 m", "time_gap >= 1.5 s from t = 15 s on"]},
        }
    )


scenarios = [cut_in(gap_m, speed_mps) for gap_m in (4, 8, 16) for speed_mps in (5, 7)]
