"""Fusion: agreeing estimates are joined, contradicting ones never averaged, and memory is short."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from supervisor.fusion import Fused, Fusion
from supervisor.lane import Lane, Motion
from supervisor.sightings import Sighting
from supervisor.supervisor import SupervisorSettings
from trepid.config import CONFIG_DIR, load

SETTINGS = load(CONFIG_DIR / "supervisor.yaml", SupervisorSettings).fusion
DRIVING = Motion(speed_mps=8.0, yaw_rate_radps=0.0)
STRAIGHT = Lane(0.0, 0.0, 0.0, 0.0)
LEFT = Lane(0.0, 0.0, 0.06, 0.0)  # a road that bends left ...
RIGHT = Lane(0.0, 0.0, -0.06, 0.0)  # ... and one that bends right


def sighting(lane: Lane | None, name: str = "cv", *, t_s: float = 0.0, confidence: float = 0.9) -> Sighting:
    return Sighting(
        estimator=name,
        age_s=0.0,
        t_s=t_s,
        broken=False,
        confidence=confidence,
        lane=lane,
        lookahead_m=10.0,
        width_error_m=0.0,
        measures_width=True,
    )


def fuse(
    *sightings: Sighting, motion: Motion = DRIVING, fusion: Fusion | None = None, now_s: float = 0.0
) -> Fused:
    return (fusion or Fusion(SETTINGS)).step(list(sightings), motion, now_s=now_s)


def lane_of(fused: Fused) -> Lane:
    assert fused.path is not None
    return fused.path.lane


def mirrored(lane: Lane) -> Lane:
    return Lane(-lane.offset_m, -lane.heading_rad, -lane.curvature_1pm, -lane.curvature_rate_1pm2)


LANES = st.builds(
    Lane,
    offset_m=st.floats(-1, 1),
    heading_rad=st.floats(-0.2, 0.2),
    curvature_1pm=st.floats(-0.06, 0.06),
    curvature_rate_1pm2=st.floats(-0.003, 0.003),
)


def test_agreeing_estimates_are_averaged_by_trust_times_confidence() -> None:
    fused = fuse(
        sighting(Lane(0.1, 0.0, 0.0, 0.0), "cv", confidence=0.9),
        sighting(Lane(0.4, 0.0, 0.0, 0.0), "cnn", confidence=0.6),
    )
    cv, cnn = 0.9 * SETTINGS.trust["cv"], 0.6 * SETTINGS.trust["cnn"]
    assert fused.sources == ("cv", "cnn")
    assert fused.trust == pytest.approx((cv / (cv + cnn), cnn / (cv + cnn)))
    assert lane_of(fused).offset_m == pytest.approx((cv * 0.1 + cnn * 0.4) / (cv + cnn))


@settings(max_examples=60, deadline=None)
@given(LANES, LANES)
def test_two_contradicting_roads_are_never_averaged(one: Lane, other: Lane) -> None:
    fused = fuse(sighting(one, "cv"), sighting(other, "cnn"))
    apart_m = abs(one.y_m(8.0) - other.y_m(8.0)), abs(one.offset_m - other.offset_m)
    if apart_m[0] > SETTINGS.gate_lookahead_m or apart_m[1] > SETTINGS.gate_offset_m:
        assert lane_of(fused) == one  # without a memory the more trusted
    else:
        assert len(fused.sources) == 2


@pytest.mark.parametrize(("remembered", "taken"), [(LEFT, "cnn"), (RIGHT, "cv")])
def test_of_two_roads_the_one_that_was_being_driven_is_kept(remembered: Lane, taken: str) -> None:
    fusion = Fusion(SETTINGS)
    fuse(sighting(remembered), fusion=fusion)
    fused = fuse(sighting(RIGHT, "cv", t_s=0.04), sighting(LEFT, "cnn", t_s=0.04), fusion=fusion, now_s=0.04)
    assert fused.sources == (taken,)
    assert lane_of(fused) == remembered


def test_disagreement_is_in_lateral_acceleration_and_counts_less_beside_a_sure_estimate() -> None:
    fused = fuse(sighting(LEFT, "cv", confidence=0.9), sighting(RIGHT, "cnn", confidence=0.3))
    assert fused.disagreement_mps2 == pytest.approx(0.12 * DRIVING.speed_mps**2)
    share = 0.3 / 0.9
    assert fused.weighted_disagreement_mps2 == pytest.approx(0.12 * DRIVING.speed_mps**2 * share)


def test_separation_is_how_far_apart_the_car_is_placed() -> None:
    aside = Lane(0.6, 0.0, 0.0, 0.0)
    assert fuse(sighting(STRAIGHT), sighting(aside, "cnn")).weighted_separation_m == pytest.approx(0.6)
    unsure = fuse(sighting(STRAIGHT), sighting(aside, "cnn", confidence=0.3))
    assert unsure.weighted_separation_m == pytest.approx(0.2)


def test_one_estimate_cannot_disagree() -> None:
    fused = fuse(sighting(LEFT, "cv"), sighting(None, "cnn"))
    assert fused.disagreement_mps2 is None
    assert fused.sources == ("cv",)
    assert fused.trust == (1.0,)


def test_without_estimates_the_path_is_remembered_for_a_second_and_then_gone() -> None:
    fusion = Fusion(SETTINGS)
    fuse(sighting(Lane(0.2, 0.01, 0.0, 0.0)), fusion=fusion)
    coasting = fuse(fusion=fusion, now_s=0.5)
    assert coasting.path is not None
    assert coasting.path.source == "memory"
    assert coasting.sources == ()
    assert lane_of(coasting).offset_m == pytest.approx(0.2 + 0.01 * 8.0 * 0.5)
    assert fuse(fusion=fusion, now_s=SETTINGS.memory_s + 0.01).path is None


def test_without_estimates_ever_there_is_no_path() -> None:
    assert fuse().path is None


def test_estimates_of_different_frames_are_brought_to_the_newest() -> None:
    """8 m/s, heading 0.01 rad left of the lane: 0.04 s later the car is 0.0032 m further left."""
    fused = fuse(
        sighting(Lane(0.0, 0.01, 0.0, 0.0), "cv", t_s=0.0),
        sighting(Lane(0.0032, 0.01, 0.0, 0.0), "cnn", t_s=0.04),
        now_s=0.05,
    )
    assert fused.path is not None
    assert fused.path.t_s == 0.04
    assert lane_of(fused).offset_m == pytest.approx(0.0032)
    assert fused.disagreement_mps2 == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("radius_m", [15.0, -15.0, 200.0])
def test_a_car_on_the_arc_of_its_lane_stays_on_it(radius_m: float) -> None:
    lane, motion = Lane(0.0, 0.0, 1 / radius_m, 0.0), Motion(5.0, 5.0 / radius_m)
    for _ in range(25):
        lane = lane.after(motion, 0.04)
    assert lane.offset_m == pytest.approx(0.0, abs=0.01)
    assert lane.heading_rad == pytest.approx(0.0, abs=0.002)
    assert lane.curvature_1pm == pytest.approx(1 / radius_m)


@settings(max_examples=40, deadline=None)
@given(LANES, st.floats(0, 20), st.floats(-0.5, 0.5), st.floats(0, 0.1))
def test_prediction_there_and_back_returns_the_lane(lane: Lane, speed: float, yaw: float, dt: float) -> None:
    motion = Motion(speed, yaw)
    back = lane.after(motion, dt).after(motion, -dt)
    assert back.offset_m == pytest.approx(
        lane.offset_m, abs=0.15
    )  # small angles: second order in way · heading
    assert back.curvature_1pm == pytest.approx(lane.curvature_1pm, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(LANES, LANES, st.floats(-0.4, 0.4))
def test_the_mirror_image_of_the_estimates_gives_the_mirror_image_of_the_path(
    one: Lane, other: Lane, yaw: float
) -> None:
    here = fuse(sighting(one), sighting(other, "cnn", t_s=0.04), motion=Motion(8.0, yaw))
    there = fuse(
        sighting(mirrored(one)), sighting(mirrored(other), "cnn", t_s=0.04), motion=Motion(8.0, -yaw)
    )
    assert lane_of(there) == mirrored(lane_of(here))
    assert there.sources == here.sources
    assert there.disagreement_mps2 == here.disagreement_mps2
    assert math.isfinite(lane_of(here).offset_m)
