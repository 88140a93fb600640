"""Sight without a camera: exact, with image statistics that cause no fear."""

import pytest
from trace_rig import truth

from sim_harness.lockstep.oracle import Oracle, clear_view
from sim_harness.scenarios.scenario import load_scenario
from supervisor.rules.inference import FearRules
from supervisor.situation.features import IMAGE_FEATURES
from trepid.car.vehicle import Vehicle
from trepid.config import CONFIG_DIR, load

SHUTTLE = load(CONFIG_DIR / "vehicle.yaml", Vehicle)
S_CURVE = load_scenario("s_curve").build_road()


@pytest.mark.parametrize("station_m", [10.0, 55.0, 80.0])
def test_its_clothoid_has_the_curvature_of_the_road_at_the_axle_and_at_the_look_ahead(station_m):
    here = S_CURVE.curvature_at(station_m)
    fields = dict(station_m=station_m, curvature_1pm=here, lateral_offset_m=0.3, heading_error_rad=-0.1)
    seen = Oracle("cv", S_CURVE, SHUTTLE).step(truth(2.0, speed_mps=10.0, **fields))
    assert seen.lookahead_m == 10.0
    assert seen.curvature_1pm == S_CURVE.curvature_at(station_m + 10.0)
    assert seen.curvature_1pm - seen.curvature_rate_1pm2 * seen.lookahead_m == pytest.approx(here)
    assert (seen.lateral_offset_m, seen.heading_error_rad, seen.confidence) == (0.3, -0.1, 1.0)
    assert (seen.t_s, seen.estimator) == (2.0, "cv")


def test_the_statistics_of_the_oracle_cause_no_fear():
    """With every other input at its calm end, fear is 0 as for a perfect picture."""
    rules = FearRules.load(CONFIG_DIR / "fear.yaml")
    calm = {
        name: one.range[0] if one.risk == "rising" else one.range[1]
        for name, one in rules.file.inputs.items()
    }
    view = clear_view(1.0)
    measured = {name: getattr(view, field) for name, field in IMAGE_FEATURES.items()}
    assert rules.evaluate({**calm, **measured}).fear == rules.evaluate(calm).fear == 0.0
